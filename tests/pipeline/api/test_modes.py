"""Modes of the library: their table, their pictures, what `identify` refuses."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pilewatch as pw
import pytest
from pilewatch.modes import Modes, draw_shapes
from pilewatch.structure import StructureModes

from pipeline.messages import ModalEstimate, Mode
from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.layout import SIDE_SIDE, Accelerometer, SensorLayout

START_NS = 1_700_000_000 * NANOSECONDS
NOISE = np.random.default_rng(3).standard_normal((2000, 2))


def estimate(
    window: int, channels: Sequence[str], shape: Sequence[float], start_ns: int = START_NS
) -> ModalEstimate:
    mode = Mode("m1", 0.5, 0.001, 0.01, 0.001, np.array(shape), np.zeros((2 + len(shape), 1)), 1)
    end_ns = start_ns + 600 * NANOSECONDS
    return ModalEstimate("t1", window, start_ns, end_ns, "l", tuple(channels), (mode,))


def modes_of(*estimates: ModalEstimate) -> Modes:
    return Modes(estimates, (), estimates[-1].channels if estimates else ("a", "b"))


def test_a_table_has_each_component_under_its_own_channel() -> None:
    pytest.importorskip("pandas", reason="the extra `notebook` is not installed")
    table = modes_of(
        estimate(0, "abc", [1.0, 0.5, 0.2]),
        estimate(1, "cba", [0.2, 0.5, 1.0]),
        estimate(2, "bd", [0.5, -1.0]),
    ).to_dataframe()
    assert list(table.columns[8:]) == ["a", "b", "c", "d"]
    nan = np.nan
    expected = [[1.0, 0.5, 0.2, nan], [1.0, 0.5, 0.2, nan], [nan, 0.5, nan, -1.0]]
    np.testing.assert_array_equal(table[["a", "b", "c", "d"]], expected)


def test_a_channel_that_is_called_like_a_column_has_one_of_its_own() -> None:
    pytest.importorskip("pandas", reason="the extra `notebook` is not installed")
    names = ("mode", "frequency_hz", "mode (shape)")
    table = modes_of(estimate(0, names, [1.0, 0.5, 0.2])).to_dataframe()
    assert table.loc[0, ["mode", "frequency_hz"]].tolist() == ["m1", 0.5]
    assert table.iloc[0, 8:].to_dict() == {
        "mode (shape)": 1.0,
        "frequency_hz (shape)": 0.5,
        "mode (shape) (shape)": 0.2,
    }
    modelled = StructureModes(("1",), np.array([0.5]), np.array([[1.0, 0.3]]), ("label", "x"))
    assert modelled.to_dataframe().iloc[0].tolist() == ["1", 0.5, 1.0, 0.3]


def test_a_table_without_a_mode_has_its_columns() -> None:
    pytest.importorskip("pandas", reason="the extra `notebook` is not installed")
    columns = list(modes_of().to_dataframe().columns)
    assert columns[:3] + columns[-2:] == ["window", "start", "mode", "a", "b"]


@pytest.mark.parametrize(("clocked", "places"), [(True, [0.0, 600.0, 1800.0]), (False, [0, 1, 2])])
def test_windows_are_drawn_one_after_the_other_though_a_restart_numbers_them_again(
    clocked: bool, places: list[float]
) -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("agg")
    first_ns = START_NS if clocked else 0
    starts = [first_ns + n * 600 * NANOSECONDS for n in (0, 1, 3)]
    windows = zip((0, 1, 0), starts, strict=True)
    axis = modes_of(*(estimate(n, "ab", [1.0, 0.5], start) for n, start in windows)).plot()
    drawn = np.concatenate([each[0].get_xdata() for each in axis.containers])
    if clocked:
        drawn = (drawn - np.datetime64(START_NS, "ns")) / np.timedelta64(1, "s")
    assert drawn.tolist() == places
    assert axis.get_xlabel() == ("start of the window (UTC)" if clocked else "window")
    pyplot.close("all")


def drawn_lines(shape: list[float], *channels: Accelerometer) -> dict[str, list[tuple[float, ...]]]:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("agg")
    layout = SensorLayout("l", "t1", "tower", channels)
    axes = draw_shapes(np.array([shape]), np.array([0.5]), layout.channel_names, layout)
    lines = {line.get_label(): line.get_xydata() for line in axes[0, 0].lines[:-1]}
    pyplot.close("all")
    return {name: [tuple(np.round(at, 9)) for at in points] for name, points in lines.items()}


def test_a_sensor_that_points_the_other_way_is_drawn_as_one_that_does_not() -> None:
    up = Accelerometer("up", 80.0, (-1.0, 0.0, 0.0))
    low = Accelerometer("low", 40.0, (1.0, 0.0, 0.0))
    side = Accelerometer("side", 40.0, SIDE_SIDE)
    assert drawn_lines([-1.0, 0.4, 0.1], up, low, side) == {
        "fore-aft": [(0.4, 40.0), (1.0, 80.0)],
        "side-side": [(0.1, 40.0)],
    }


def test_sensors_askew_are_drawn_along_the_axes_of_the_tower() -> None:
    half = np.sqrt(0.5)
    ahead = Accelerometer("ahead", 40.0, (half, half, 0.0))
    behind = Accelerometer("behind", 40.0, (-half, half, 0.0))
    nearly = Accelerometer("nearly", 80.0, (0.6, 0.8, 0.0))
    assert drawn_lines([1.0, 0.0, 1.0], ahead, behind, nearly) == {
        "fore-aft": [(round(half, 9), 40.0)],
        "side-side": [(round(half, 9), 40.0), (0.8, 80.0)],
    }


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


def test_water_is_drawn_where_there_is_some() -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("agg")
    offshore = pw.Structure().description
    levels = []
    for description in (offshore.with_water_level(1.5), replace(offshore, water=None)):
        axis = pw.Structure(description).plot()
        levels.append([line.get_ydata()[0] for line in axis.lines])
        assert ("mean water" in axis.get_ylabel()) == (description.water is not None)
    assert levels == [[1.5, offshore.mudline], [offshore.mudline]]
    pyplot.close("all")
