"""A measurement of the library: times, parts, tables, by hand."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pilewatch._own_packages import require_own_packages
from pilewatch.errors import InputError
from pilewatch.measurement import Measurement, measurement_of, simulate

from sensors.acquisition.layout import FORE_AFT, Accelerometer, SensorLayout

SAMPLES = np.arange(10.0).reshape(5, 2)
BARE = Measurement(SAMPLES, 2.0, ("a", "b"), ("g", ""))
START_NS = 1_700_000_000_500_000_000


def dated(start_ns: int = START_NS) -> Measurement:
    stamps = np.array([0.0, 0.5, 1.0, 3.0, 3.5])  # a gap
    speed = np.arange(5.0)
    return Measurement(
        SAMPLES, 2.0, ("a", "b"), ("", ""), start_ns, rotor_speed=speed, stamps=stamps
    )


def test_what_is_not_stated_of_a_measurement_is_not_known() -> None:
    assert (BARE.start_ns, BARE.layout, BARE.quantities, BARE.rotor_speed) == (0, None, None, None)
    assert list(BARE.times) == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert BARE.duration == 2.5
    assert repr(BARE) == "<Measurement: 2 channels, 2.5 s at 2 Hz>"


@pytest.mark.parametrize(
    ("start", "end", "rows"),
    [(0.0, 1.0, [0, 1]), (0.5, 1.5, [1, 2]), (0.74, 1.26, [1, 2]), (1.0, 9.0, [2, 3, 4])],
)
def test_a_part_has_the_samples_nearest_to_its_ends_and_counts_from_its_own_first(
    start: float, end: float, rows: list[int]
) -> None:
    part = dated().between(start, end)
    assert np.array_equal(part.samples, SAMPLES[rows])
    assert part.rotor_speed is not None
    assert list(part.rotor_speed) == rows
    began = dated().times[rows[0]]
    assert list(part.times) == list(dated().times[rows] - began)
    assert part.start_ns == START_NS + began * 1e9


def test_a_table_is_indexed_by_date_where_the_start_is_known_and_by_seconds_where_not() -> None:
    pytest.importorskip("pandas")
    index = dated().to_dataframe().index
    assert str(index[0]) == "2023-11-14 22:13:20.500000+00:00"
    assert str(index[3]) == "2023-11-14 22:13:23.500000+00:00"
    assert list(BARE.to_dataframe().index) == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert list(BARE.to_dataframe().columns) == ["a", "b"]


def test_a_plot_has_an_axis_a_channel_with_its_unit_where_it_has_one() -> None:
    pytest.importorskip("matplotlib.pyplot").switch_backend("agg")
    axes = BARE.plot()
    assert [axis.get_ylabel() for axis in axes] == ["a\n[g]", "b"]
    assert [axis.get_xlabel() for axis in axes] == ["", "time [s]"]
    assert np.array_equal(
        axes[1].lines[0].get_xydata(), np.column_stack([BARE.times, SAMPLES[:, 1]])
    )


def test_a_plot_of_one_channel_is_an_array_too() -> None:
    pytest.importorskip("matplotlib.pyplot").switch_backend("agg")
    (axis,) = Measurement(SAMPLES[:, :1], 2.0, ("a",), ("g",)).plot()
    assert (axis.get_ylabel(), axis.get_xlabel()) == ("a\n[g]", "time [s]")


def test_channels_of_an_array_are_numbered_from_one() -> None:
    made, note = measurement_of(SAMPLES, 2.0, None, None)
    assert made.channels == ("ch1", "ch2")
    assert made.units == ("", "")
    assert (made.start_ns, made.sampling_rate, note) == (0, 2.0, "")
    assert measurement_of(SAMPLES, 2.0, ["x", "y"], None)[0].channels == ("x", "y")


def layout_of(*names: str) -> SensorLayout:
    return SensorLayout(
        "l", "t1", "tower", tuple(Accelerometer(name, 40.0, FORE_AFT) for name in names)
    )


def test_a_layout_gives_the_places_of_the_channels_that_it_lists_in_its_order() -> None:
    layout = layout_of("b", "a")
    unscaled = Measurement(SAMPLES, 2.0, ("a", "b"), ("", ""), quantities=None)
    pandas = pytest.importorskip("pandas", reason="the extra `notebook` is not installed")
    table = pandas.DataFrame(SAMPLES, columns=["a", "b"])
    for samples, rate, names in (
        (unscaled, 2.0, None),
        (table, 2.0, None),
        (SAMPLES, 2, ["a", "b"]),
    ):
        made, _ = measurement_of(samples, rate, names, layout)
        assert (made.layout, made.channels, made.units) == (layout, ("b", "a"), ("m/s²", "m/s²"))
        assert np.array_equal(made.samples, SAMPLES[:, ::-1])
    one, _ = measurement_of(unscaled, None, None, layout_of("b"))
    assert np.array_equal(one.samples, SAMPLES[:, 1:])


def test_a_layout_names_the_channels_of_an_array_without_these_names() -> None:
    layout = layout_of("x", "y")
    made, _ = measurement_of(SAMPLES, 2.0, None, layout)
    assert (made.layout, made.channels) == (layout, ("x", "y"))
    assert np.array_equal(made.samples, SAMPLES)


@pytest.mark.parametrize(
    ("samples", "rate", "channels", "layout", "said"),
    [
        (BARE, 4.0, None, None, "sampling_rate is 4 Hz; the Measurement is sampled at 2 Hz"),
        (BARE, "2", None, None, "sampling_rate is '2'"),
        (
            BARE,
            None,
            ["x", "y"],
            None,
            r"channels are \['x', 'y'\]; a file or a Measurement has its",
        ),
        (
            "a.csv",
            None,
            ["x", "y"],
            None,
            r"channels are \['x', 'y'\]; a file or a Measurement has",
        ),
        (BARE, None, None, layout_of("b", "z"), "has the channel 'z'; the measurement has a, b"),
        (BARE, None, None, layout_of("a"), "'a' is in m/s² by the layout, in g by the measurement"),
        (SAMPLES, 2.0, ["a", "b"], layout_of("x", "y"), "channels are a, b; the layout has x, y"),
        (SAMPLES, 2.0, ["a", "a"], None, "channel name 'a' appears more than once"),
        (
            Measurement(SAMPLES, 2.0, ("a", "a"), ("", "")),
            None,
            None,
            None,
            "'a' appears more than",
        ),
    ],
)
def test_an_argument_that_contradicts_the_samples_is_refused(
    samples: Any, rate: Any, channels: list[str] | None, layout: SensorLayout | None, said: str
) -> None:
    with pytest.raises(InputError, match=said):
        measurement_of(samples, rate, channels, layout)


def test_a_tables_time_stamps_are_followed_whatever_rate_is_stated() -> None:
    pandas = pytest.importorskip("pandas", reason="the extra `notebook` is not installed")
    index = pandas.to_datetime([0, 50, 100, 150, 200], unit="ms")
    table = pandas.DataFrame(SAMPLES, index=index)
    made, note = measurement_of(table, 40.0, None, None)
    assert made.sampling_rate == 20.0
    assert list(made.times) == [0.0, 0.05, 0.1, 0.15, 0.2]
    assert note == (
        "the table runs at 20 Hz by its own time, not at the 40 Hz given; its own time is followed"
    )
    assert measurement_of(table, 20.0, None, None)[1] == ""
    counted, note = measurement_of(table.set_index(index[[0, 1, 1, 3, 4]]), 400.0, None, None)
    assert (counted.sampling_rate, counted.stamps) == (400.0, None)
    assert "stand still or go back" in note


def test_a_row_without_a_time_is_named() -> None:
    pandas = pytest.importorskip("pandas", reason="the extra `notebook` is not installed")
    index = pandas.to_datetime([None, 50, 100, 150, 200], unit="ms")
    with pytest.raises(InputError, match="row 0 of the table has no time"):
        measurement_of(pandas.DataFrame(SAMPLES, index=index), None, None, None)


@pytest.mark.parametrize(("places", "ours"), [(["own", "other"], True), (["other"], False)])
def test_a_folder_that_hides_the_packages_is_refused_and_one_beside_them_is_not(
    tmp_path_factory: pytest.TempPathFactory,
    monkeypatch: pytest.MonkeyPatch,
    places: list[str],
    ours: bool,
) -> None:
    """A package that lies in several folders, as an editable installation makes them."""
    folder = tmp_path_factory.mktemp("packages")
    for name in ("own", "other"):
        (folder / name).mkdir()
    for module in ("streams.py", "arrays.py"):
        (folder / "own" / module).touch()
    found = SimpleNamespace(submodule_search_locations=[str(folder / each) for each in places])
    monkeypatch.setattr("pilewatch._own_packages.find_spec", lambda name: found)
    if ours:
        require_own_packages()
    else:
        with pytest.raises(ImportError, match=r"other hides pilewatch's own package 'pipeline'"):
            require_own_packages()


SHORT = """
[turbine]
id = "t1"

[simulation]
duration = 12.0
transient = 2.0
"""
UNEQUAL = [
    '{ name = "lower", elevations = [41.0] }',
    '{ name = "upper", elevations = [80.0, 106.0, 145.0], start = 6.0 }',
]


def simulated(folder: Path, *more: str) -> Measurement:
    file = folder / "short.toml"
    file.write_text(SHORT + "\n".join(more))
    return simulate(str(file))


def test_simulated_units_of_different_channels_stand_side_by_side(tmp_path: Path) -> None:
    """Each sample is the tower's of that instant; before a unit starts there is none of it."""
    whole = simulated(tmp_path)
    joined = simulated(tmp_path, f"units = [{', '.join(UNEQUAL)}]")
    assert len(joined.channels) == joined.samples.shape[1] == 8
    assert joined.layout is not None
    assert joined.layout.channel_names == joined.channels
    assert list(joined.times) == pytest.approx(list(whole.times))
    columns = [whole.channels.index(name) for name in joined.channels]
    expected = whole.samples[:, columns]
    expected[: 6 * 40, [not name.startswith("z41-") for name in joined.channels]] = np.nan
    np.testing.assert_array_equal(joined.samples, expected)


def test_simulated_blocks_stand_where_their_stamps_are_and_missing_ones_are_a_gap(
    tmp_path: Path,
) -> None:
    faults = (
        '{ kind = "dropped", start = 3.0, duration = 3.0 }',
        '{ kind = "repeated", start = 7.0, duration = 2.0 }',
        '{ kind = "out-of-order", start = 9.0, duration = 3.0 }',
    )
    whole = simulated(tmp_path)
    faulty = simulated(tmp_path, f"faults = [{', '.join(faults)}]")
    (rows,) = np.nonzero(np.isin(np.round(whole.times * 40), np.round(faulty.times * 40)))
    assert len(rows) == len(faulty.samples) < len(whole.samples)
    assert np.diff(faulty.times).min() == pytest.approx(0.025)
    assert np.diff(faulty.times).max() == pytest.approx(3.025)
    np.testing.assert_array_equal(faulty.samples, whole.samples[rows])


def test_a_simulation_of_which_no_block_arrives_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"short.toml holds no acceleration blocks"):
        simulated(tmp_path, 'faults = [{ kind = "dropped", start = 0.0, duration = 60.0 }]')


def test_what_a_logger_writes_for_no_value_is_missing_in_an_array_too(
    caplog: pytest.LogCaptureFixture,
) -> None:
    samples = np.random.default_rng(8).standard_normal((2000, 2))
    samples[300:310, 1] = -9999.0
    given = samples.copy()
    found, _ = measurement_of(samples, 40.0, None, None)
    assert np.argwhere(np.isnan(found.samples)).tolist() == [[i, 1] for i in range(300, 310)]
    np.testing.assert_array_equal(samples, given)  # the caller's own array stays as it is
    assert any("the table: ch2 has -9999 again and again" in each for each in caplog.messages)
