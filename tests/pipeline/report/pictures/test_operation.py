"""Control charts, tide, wind and rotor speed are drawn where there is enough, else left out."""

import re
from dataclasses import replace

import numpy as np
import pytest

from pipeline.messages import ModalEstimate
from pipeline.report.page import page
from pipeline.report.pictures import identification, operation
from pipeline.report.recorded_session import RecordedSession, TurbineRecord
from tests.pipeline.example_messages import LAYOUT
from tests.pipeline.report.example_session import estimate, event, posterior


def record_of(estimates: list[ModalEstimate]) -> TurbineRecord:
    record = TurbineRecord("t1")
    for each in (LAYOUT, *estimates):
        record.run.fold(each)
    return record


def tidal(n_windows: int = 30) -> list[ModalEstimate]:
    """Frequencies that fall by 1 % a metre of water, in windows of a tide of 2 m."""
    levels = 2.0 * np.sin(np.arange(n_windows))
    return [
        replace(
            estimate(number, drop=0.01 * level), water_level=level, wind_speed=8.0, rotor_speed=0.0
        )
        for number, level in enumerate(levels.tolist())
    ]


def test_three_blades_of_a_rotor_at_ten_rounds_a_minute_pass_every_two_seconds() -> None:
    assert operation.passing_frequency(1, 10.0) == pytest.approx(1 / 6)
    assert operation.passing_frequency(3, 10.0) == pytest.approx(0.5)


def test_limits_are_three_robust_standard_deviations_of_the_reference() -> None:
    values = np.random.default_rng(4).normal(5.0, 0.1, 10_000)
    values[::100] = 50.0  # outliers do not widen the limits
    limits = operation.control_limits(values, len(values))
    assert limits.centre == pytest.approx(5.0, abs=0.01)
    assert limits.deviation == pytest.approx(0.1, rel=0.05)
    assert limits.outside(values).mean() == pytest.approx(0.01 + 0.0027, abs=0.002)


def test_a_change_leaves_the_limits_of_what_came_before_it() -> None:
    estimates = [estimate(n) for n in range(20)] + [estimate(n, drop=0.05) for n in range(20, 30)]
    record = record_of(estimates)
    record.run.fold(event(window=20))
    assert operation.control_charts(record).startswith("<?xml")
    outside = int(operation.beyond_limits(record).split()[0])
    assert outside >= 4 * 10  # every window after the change, of four modes


def test_of_windows_that_only_scatter_next_to_none_lie_outside() -> None:
    """Three standard deviations leave .3 % out; two would leave 5 %."""
    record = record_of([estimate(n) for n in range(200)])
    outside, _, total, *_ = operation.beyond_limits(record).split()
    assert int(total) == 200 * operation.CHARTED
    assert int(outside) <= 0.015 * int(total)


def test_frequencies_are_drawn_against_a_tide_and_not_against_a_steady_wind() -> None:
    record = record_of(tidal())
    drawn = operation.frequencies_against(record, "water_level")
    correlations = [float(each) for each in re.findall(r"r = ([+-][\d.]+)", drawn)]
    assert len(correlations) == operation.CHARTED
    assert max(correlations) < -0.95
    assert operation.frequencies_against(record, "wind_speed") == ""
    assert operation.campbell(record) == ""


def test_a_turning_rotor_gives_a_campbell_diagram_with_its_harmonics() -> None:
    turning = [replace(estimate(n), rotor_speed=5.0 + 0.1 * n) for n in range(10)]
    drawn = operation.campbell(record_of(turning))
    assert all(f">{harmonic}P<" in drawn for harmonic in (1, 3, 6))


def test_few_windows_leave_the_section_out() -> None:
    record = record_of([estimate(n) for n in range(3)])
    assert operation.control_charts(record) == ""
    session = RecordedSession("a", (), (), {}, None, (record,))
    assert "Over time and operation" not in page(session)


def test_the_predictive_check_has_every_pair_with_a_misfit() -> None:
    drawn = identification.prediction(posterior(3))
    assert drawn.count(">mode ") == len(posterior(3).pairs)
    assert identification.prediction(None) == ""
