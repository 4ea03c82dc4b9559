"""A first period of tides makes a structure's figures surer, and later intervals still hold."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.updating.prior import UpdatingError
from pipeline.updating.settings import UpdatingSettings
from pipeline.updating.structural.alternatives import JointInference
from pipeline.updating.structural.inference import joint_inference
from pipeline.updating.structural.periods.calibration import (
    DesignSprings,
    calibrated,
)
from pipeline.updating.structural.settings import UNCERTAIN, structure_settings
from sensors.errors import InputError
from sensors.structure.calibration import AlternativeFigures, Calibration
from sensors.structure.description import TurbineDescription, load_turbine
from tests.benchmarks.first_weeks import (
    LATER,
    LAYOUT,
    Answer,
    FirstPeriod,
    answer,
    calibration,
    drawn,
    first_period,
    refreshed,
)

TURBINE = load_turbine("iea15mw_monopile")
WINDOWS = 24  # of the first period


DESCRIBED = replace(UNCERTAIN, stds=(("flooding", 0.0), ("tube_shear", 0.0), ("blade_model", 0.0)))
"""Without alternatives: a fit takes a sixth of the time."""


def inference_of(turbine: TurbineDescription) -> JointInference:
    """Without alternatives."""
    found = joint_inference(turbine, LAYOUT, UpdatingSettings(structure=DESCRIBED), seed=1)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def inference() -> JointInference:
    return inference_of(TURBINE)


@pytest.fixture(scope="module")
def first_days():
    return drawn(62001, "published", WINDOWS)


@pytest.fixture(scope="module")
def period(inference, first_days) -> FirstPeriod:
    return first_period(inference, first_days[1][:-LATER])


@pytest.fixture(scope="module")
def section(inference, period) -> Calibration:
    return calibration(inference, period, "published")


@pytest.fixture(scope="module")
def before(inference, first_days) -> Answer:
    """By the later windows alone."""
    truth, modal = first_days
    return answer(refreshed(inference, modal[-LATER:]), truth)


def test_the_tide_narrows_the_later_intervals(first_days, before, section) -> None:
    truth, modal = first_days
    later = inference_of(replace(TURBINE, calibration=section))
    after = answer(refreshed(later, modal[-LATER:]), truth)
    assert np.all(after.half_width < 0.8 * before.half_width)
    assert all(after.held)


def test_a_period_at_one_level_reports_less_than_one_of_tides(period) -> None:
    middle = min(period.levels, key=lambda level: abs(level[0]))
    by_tide = calibrated(period.found.result, period.levels)[0]
    still = calibrated(period.found.result, [middle])[0]
    added_mass = by_tide.names.index("added_mass")
    assert (
        by_tide.covariance[added_mass, added_mass] < 0.5 * still.covariance[added_mass, added_mass]
    )


def test_levels_share_tracks_and_hold_every_window_once(period) -> None:
    whole, levels = period.whole, period.levels
    assert whole.n_windows == WINDOWS
    assert sum(evidence.n_windows for _, evidence in levels) <= WINDOWS
    rises = [rise for rise, _ in levels]
    assert rises == sorted(rises)
    assert 3 <= len(levels) <= 9
    for mode in whole.modes:
        seen = [m for _, level in levels for m in level.modes if m.track == mode.track]
        assert {m.unit_component for m in seen} <= {mode.unit_component}


def test_a_design_of_the_springs_moves_them_and_the_figures(inference, first_days, before) -> None:
    truth, modal = first_days
    design = DesignSprings(tuple(truth.theta.tolist()), 0.02)
    after = answer(refreshed(inference.with_springs(design.belief), modal[-LATER:]), truth)
    assert np.all(after.half_width < before.half_width)
    assert after.half_width[0] < 3.5  # 1.645 × 2 % by the design alone


def test_impossible_design_springs_are_refused() -> None:
    with pytest.raises(UpdatingError, match="not positive definite"):
        DesignSprings((1e9, 1e11, 1e11), 0.2)
    with pytest.raises(UpdatingError, match="standard deviation is 3"):
        DesignSprings((1e10, 1e12, 1e10), 3.0)


def test_a_calibration_with_other_priors_is_refused(section) -> None:
    wide = structure_settings({"uncertain": {"steel_modulus": 0.05}}, "test")
    with pytest.raises(UpdatingError, match=r"prior of std 0.01 for steel_modulus, used with 0.05"):
        joint_inference(
            replace(TURBINE, calibration=section),
            LAYOUT,
            UpdatingSettings(structure=wide),
        )


def test_a_calibration_with_the_other_springs_is_refused(section) -> None:
    turbine = replace(TURBINE.with_sign("embedded-pile"), calibration=section)
    with pytest.raises(UpdatingError, match="springs of sign 'published'"):
        joint_inference(turbine, LAYOUT, UpdatingSettings(structure=UNCERTAIN))


def test_sensors_that_were_replaced_begin_with_their_own_priors(section) -> None:
    renamed = replace(
        LAYOUT,
        channels=tuple(replace(each, name=f"new {each.name}") for each in LAYOUT.channels),
    )
    turbine = replace(TURBINE, calibration=section)
    found = joint_inference(turbine, renamed, UpdatingSettings(structure=UNCERTAIN))
    assert found is not None
    coordinates = found.fits[0][1].coordinates
    place = coordinates.names.index("gain new z41-fa")
    assert coordinates.prior_precision[place, place] == pytest.approx(1.0)
    figure = coordinates.names.index("added_mass")
    assert coordinates.prior_precision[figure, figure] > 1.5


def test_a_damaged_section_is_refused() -> None:
    with pytest.raises(InputError, match="covariance has 2 values; the lower triangle of 2"):
        AlternativeFigures("x", 1.0, (0.0, 0.0), (1.0, 0.0))
    with pytest.raises(InputError, match="not positive definite"):
        AlternativeFigures("x", 1.0, (0.0, 0.0), (1.0, 2.0, 1.0))
    whole = AlternativeFigures("x", 1.0, (0.0,), (1.0,))
    with pytest.raises(InputError, match="2 names, 1 stds and 1 means"):
        Calibration("published", ("a", "b"), (1.0,), (whole,))
