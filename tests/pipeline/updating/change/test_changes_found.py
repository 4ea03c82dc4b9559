"""Years and trials on drawn estimates of the real structure's modes, in short: the whole study is
`python -m tests.benchmarks change`."""

from functools import partial

import numpy as np
import pytest

from pipeline.updating.change.settings import ChangeSettings
from sensors.dynamics.modal_model import ModalModel
from sensors.structure.description import load_turbine
from tests.benchmarks.change import LAYOUT, RIDE, Watched, changes_found, quiet, shifted, softened

OFTEN = ChangeSettings(years_between_false_alarms=360 / 8766)  # 10 % false alarms per 36 h
NAMED = tuple(str(number) for number in range(1, 12))  # [foundation-updating] Table 1


@pytest.fixture(scope="module")
def modes():
    """The publication's eleven modes and nine others, found in nine windows of ten."""
    model = ModalModel(load_turbine("iea15mw_monopile"), LAYOUT)
    labels = NAMED + tuple(label for label in model.labels if label not in NAMED)[10:19]
    n = len(labels)
    return Watched(model, labels, stds=np.full(n, 0.0015), presence=np.full(n, 0.9))


@pytest.mark.parametrize(("high_water", "ride"), [(1.0, 0.0), (1.5, RIDE)])
def test_a_tenth_of_k22_is_found_measured_and_then_held_by_the_interval(modes, high_water, ride):
    """In springs that are still otherwise, and in such that ride with the tide by 2 %."""
    case_at = partial(softened, modes, high_water=high_water, ride=ride)
    outcome = changes_found(modes, case_at, OFTEN, range(3))
    assert len(outcome.delays) == 3
    assert max(outcome.delays) <= 4
    assert outcome.false == 0
    assert np.median([each.ratios[1] for each in outcome.sizes]) == pytest.approx(-0.1, abs=0.02)
    assert np.mean(outcome.covered) >= 0.88


def test_a_fifth_of_a_percent_of_five_modes_is_found_within_twelve_hours(modes):
    outcome = changes_found(modes, partial(shifted, modes), ChangeSettings(), range(3))
    assert len(outcome.delays) == 3
    assert outcome.false == 0


def test_four_quiet_days_under_a_tide_that_no_model_knows_raise_no_alarm(modes):
    assert quiet(modes, 576, 5).alarms == 0
