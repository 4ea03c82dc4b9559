"""Modes of the library: what `identify` takes and refuses."""

from typing import Any

import numpy as np
import pilewatch as pw
import pytest

from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.layout import SIDE_SIDE, Accelerometer, SensorLayout

NOISE = np.random.default_rng(3).standard_normal((2000, 2))


def test_a_layout_beside_a_measurement_is_that_of_its_modes() -> None:
    layout = SensorLayout(
        "l", "t1", "tower", tuple(Accelerometer(name, 40.0, SIDE_SIDE) for name in "ab")
    )
    measured = pw.Measurement(NOISE, 20.0, ("a", "b"), ("m/s²", "m/s²"))
    modes = pw.identify(measured, layout=layout)
    assert modes.layout == layout
    assert {each.turbine for each in (*modes.estimates, *modes.rejected)} == {"t1"}


def test_a_window_lasts_as_long_as_asked_for_whatever_rate_is_stated() -> None:
    pandas = pytest.importorskip("pandas", reason="the extra `notebook` is not installed")
    index = pandas.date_range("2026-01-01", periods=len(NOISE), freq="50ms")
    modes = pw.identify(pandas.DataFrame(NOISE, index=index), 40.0, window=50.0)
    answers = sorted((*modes.estimates, *modes.rejected), key=lambda each: each.start_ns)
    assert [each.end_ns - each.start_ns for each in answers] == [50 * NANOSECONDS] * 2
    assert "sampling-rate" in {each.code for each in modes.warnings} or not modes.estimates


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"rotor_speed": float("nan")}, "rotor_speed is nan rpm; a finite number, 0 or more"),
        ({"rotor_speed": -5}, "rotor_speed is -5 rpm; a finite number, 0 or more"),
        ({"rotor_speed": [7.0] * 1999 + [-1.0]}, "rotor_speed is -1 rpm at sample 1999;"),
        ({"rotor_speed": "five"}, "rotor_speed is 'five'; numbers are needed"),
        ({"window": 0.001}, r"window is 0.001 s; at 20 Hz a sample takes 0.05 s"),
        ({"window": 101.0}, "window 101 s does not fit: the record is 100 s long"),
    ],
)
def test_an_argument_that_cannot_be_is_refused_in_one_line(
    arguments: dict[str, Any], said: str
) -> None:
    with pytest.raises(pw.InputError, match=said):
        pw.identify(NOISE, 20.0, **arguments)
