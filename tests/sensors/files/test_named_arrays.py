"""Arrays with notes as programs leave them: odd shapes, odd clocks, counts with a scale."""

import re
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import obspy
import pyarrow as pa
import pytest
from nptdms import ChannelObject, TdmsWriter
from pyarrow import parquet
from scipy.io import savemat

from sensors.files.formats import channels_in, read_file
from sensors.files.named_arrays import _find_names
from sensors.files.table import FileError, Wanted

RATE = 50.0  # [Hz]
START = np.datetime64("2024-03-13T12:00:00.250", "ns")
START_NS = int(START.astype(np.int64))
SAMPLES = np.round(np.random.default_rng(6).normal(size=(60, 2)), 6)
COUNTS = np.round(1000 * SAMPLES).astype(np.int16)
SECONDS = np.arange(len(SAMPLES)) / RATE
STAMPS = START + np.round(SECONDS * 1e9).astype("timedelta64[ns]")
TABLE = np.array(
    list(zip(SECONDS, *SAMPLES.T, strict=True)), dtype=[("time", "f8"), ("a", "f8"), ("b", "f8")]
)

Notes = dict[str, Any]


def npz(folder: Path, **arrays: Any) -> Path:
    np.savez(folder / "a.npz", **{name: np.asarray(each) for name, each in arrays.items()})
    return folder / "a.npz"


def hdf5(folder: Path, fill: Callable[[h5py.File], None]) -> Path:
    with h5py.File(folder / "a.h5", "w") as file:
        fill(file)
    return folder / "a.h5"


@pytest.mark.parametrize(
    "arrays",
    [
        {"acc": SAMPLES.T, "fs": 50},
        {"acc": SAMPLES, "fs": "50 Hz"},
        {"acc": SAMPLES, "fs": [[50.0]]},
        {"acc": SAMPLES, "dt": "0.02"},
        {"acc": SAMPLES, "dt": "20 ms"},
        {"acc": SAMPLES, "f_s": 50.0},
        {"acc": SAMPLES, "Ts": 0.02},
        {"acc": SAMPLES, "sampling_time": "20 ms"},
        {"acc": SAMPLES.astype(">f8"), "t": SECONDS[:, None]},
        {"acc": SAMPLES, "time_ms": np.arange(60) * 20},
        {"table": TABLE},
        {"acc": SAMPLES[None], "fs": 50.0},
    ],
)
def test_shapes_and_rates_are_understood(tmp_path: Path, arrays: Notes) -> None:
    table = read_file(npz(tmp_path, **arrays))
    np.testing.assert_array_equal(table.samples, SAMPLES)
    assert table.sampling_rate == pytest.approx(RATE, rel=1e-9)
    assert table.start_ns == 0


@pytest.mark.parametrize(
    "arrays",
    [
        {"time": STAMPS.astype(np.int64)},
        {"time": STAMPS.astype(np.int64) // 10**6},
        {"time": STAMPS.astype("datetime64[ms]")},
        {"fs": 50, "start_time": START_NS // 10**6},
        {"fs": 50, "start_time": START_NS / 1e9},
    ],
)
def test_what_counts_from_1970_has_a_date(tmp_path: Path, arrays: Notes) -> None:
    table = read_file(npz(tmp_path, acc=SAMPLES, **arrays))
    assert abs(table.start_ns - START_NS) < 1000
    assert table.sampling_rate == pytest.approx(RATE, rel=1e-9)


def test_the_times_say_which_side_of_a_matrix_is_time(tmp_path: Path) -> None:
    many = np.arange(400.0).reshape(10, 40)
    table = read_file(npz(tmp_path, acc=many, t=SECONDS[:10]))
    np.testing.assert_array_equal(table.samples, many)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"fs": "fast"}, "sampling rate is 'fast'; one number"),
        ({"dt": 0.0}, "sampling interval is 0 s"),
        ({"fs": np.nan}, "sampling rate is nan; one number"),
        ({"fs": 50, "start_time": np.inf}, "the start is inf"),
        ({"time": np.where(np.arange(60) == 3, np.datetime64("NaT"), STAMPS)}, "in sample 4"),
    ],
)
def test_notes_that_make_no_sense_are_one_line(tmp_path: Path, arrays: Notes, message: str) -> None:
    with pytest.raises(FileError, match=message) as error:
        read_file(npz(tmp_path, acc=SAMPLES, **arrays))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("kind", ["h5", "mat", "tdms"])
def test_a_time_holds_for_its_own_group_and_none_whose_name_begins_alike(
    tmp_path: Path, kind: str
) -> None:
    groups = {"T1": 40.0, "T10": 20.0, "T2": 40.0}
    content = {
        group: {"time": START_NS / 1e9 + 3600 * i + np.arange(60) / rate, f"acc_{group}": each}
        for i, ((group, rate), each) in enumerate(
            zip(groups.items(), np.column_stack([SAMPLES, SAMPLES[:, 1]]).T, strict=True)
        )
    }
    path = tmp_path / f"a.{kind}"
    if kind == "mat":
        savemat(path, content)
    elif kind == "tdms":
        with TdmsWriter(path) as writer:
            writer.write_segment(
                [
                    ChannelObject(group, name, np.ascontiguousarray(values))
                    for group, inside in content.items()
                    for name, values in inside.items()
                ]
            )
    else:
        with h5py.File(path, "w") as file:
            for group, inside in content.items():
                for name, values in inside.items():
                    file[f"{group}/{name}"] = values
    for i, (group, rate) in enumerate(groups.items()):
        table = read_file(path, None, Wanted(frozenset({f"acc_{group}"})))
        assert table.sampling_rate == pytest.approx(rate, rel=1e-5)
        assert abs(table.start_ns - START_NS - i * 3600 * 10**9) < 1000


def slow_and_fast(folder: Path, unit: str = "g") -> Path:
    """Accelerations at 50 Hz beside a strain at 500 Hz, over the same time."""
    slow, fast = {"wf_increment": 1 / RATE, "unit_string": unit}, {"wf_increment": 0.1 / RATE}
    with TdmsWriter(folder / "a.tdms") as writer:
        writer.write_segment(
            [
                ChannelObject("strain", "s1", np.repeat(SAMPLES[:, 1], 10), properties=fast),
                ChannelObject("tower", "z1", np.ascontiguousarray(SAMPLES[:, 0]), properties=slow),
                ChannelObject("tower", "mode", np.arange(7.0)),
            ]
        )
    return folder / "a.tdms"


def test_channels_of_another_rate_are_read_where_they_are_wanted_by_name(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = slow_and_fast(tmp_path)
    for name, rate in (("z1", RATE), ("s1", 10 * RATE)):
        table = read_file(path, None, Wanted(frozenset({name})))
        assert (table.names, table.sampling_rate) == ((name,), pytest.approx(rate))
    assert not caplog.records
    with pytest.raises(FileError, match="differ in sampling rate"):
        read_file(path, None, Wanted(frozenset({"z1", "s1"})))


@pytest.mark.parametrize(("unit", "read", "left"), [("g", "z1", "s1"), ("V", "s1", "z1")])
def test_accelerations_are_the_measurement_else_the_longest_and_the_others_are_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, unit: str, read: str, left: str
) -> None:
    path = slow_and_fast(tmp_path, unit)
    assert read_file(path).names == channels_in(path).names == (read,)
    assert re.search(rf"{left}, mode|mode, {left}", caplog.text)
    assert "--layout" in caplog.text


def test_accelerations_that_last_a_moment_are_not_the_measurement(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        file.attrs["fs"] = RATE
        file["top"], file["mid"] = SAMPLES.T
        file["pulse/acc"] = SAMPLES[:20, 0]

    assert set(read_file(hdf5(tmp_path, fill)).names) == {"top", "mid"}


def test_names_of_the_measurement_are_as_if_there_were_nothing_beside_it(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        file["mean/x"], file["mean/pair"] = SAMPLES[::10, 0], SAMPLES[::10]
        file["raw/x"], file["raw/y"], file["raw/pair"] = *SAMPLES.T, SAMPLES
        for each in ("mean", "raw"):
            file[each].attrs["fs"] = RATE if each == "raw" else RATE / 10
            file[f"{each}/pair"].attrs["names"] = ["a", "b"]

    path = hdf5(tmp_path, fill)
    assert read_file(path).names == ("a", "b", "x", "y")
    slow = frozenset({"mean/x", "mean/pair/a", "mean/pair/b"})
    table = read_file(path, None, Wanted(slow))
    assert (frozenset(table.names), table.sampling_rate) == (slow, RATE / 10)


def test_notes_that_do_not_fit_what_is_beside_the_measurement_stop_nothing(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = npz(tmp_path, acc=SAMPLES, names=["a", "b"], fs=RATE, gains=np.eye(5)[:, :3])
    assert read_file(path).names == ("a", "b")
    assert "gains not read" in caplog.text


def test_a_time_holds_for_the_groups_inside_its_own(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        file["run1/time"] = SECONDS
        file["run1/tower/acc"], file["run10/tower/acc10"] = SAMPLES.T

    path = hdf5(tmp_path, fill)
    inside = read_file(path, None, Wanted(frozenset({"acc"})))
    outside = read_file(path, None, Wanted(frozenset({"acc10"})))
    assert inside.sampling_rate == pytest.approx(RATE)
    assert outside.sampling_rate is None


def test_a_single_array_is_read_and_an_object_is_not(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", SAMPLES)
    np.testing.assert_array_equal(read_file(tmp_path / "a.npy").samples, SAMPLES)
    with pytest.raises(FileError, match="no readable NPZ file"):
        read_file(npz(tmp_path, acc=np.array([SAMPLES, "x"], dtype=object)))


def test_counts_are_scaled_and_fill_values_are_nothing(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        counts = COUNTS.copy()
        counts[5, 1] = -32768
        file["acc"] = counts
        file["acc"].attrs.update(
            fs=50, units="m s-2", scale_factor=1e-3, add_offset=2.0, _FillValue=-32768
        )

    table = read_file(hdf5(tmp_path, fill))
    assert np.argwhere(np.isnan(table.samples)).tolist() == [[5, 1]]
    assert table.units == ("m/s²", "m/s²")
    kept = ~np.isnan(table.samples)
    np.testing.assert_allclose(table.samples[kept], (COUNTS * 1e-3 + 2.0)[kept], atol=1e-12)


@pytest.mark.parametrize("key", ["_FillValue", "missing_value"])
@pytest.mark.parametrize("fill_value", [-999.9, np.float32(-999.9), np.array([-999.9]), np.nan])
def test_a_fill_value_of_another_type_is_nothing_too(
    tmp_path: Path, key: str, fill_value: float
) -> None:
    def fill(file: h5py.File) -> None:
        values = SAMPLES.astype(np.float32)
        values[5:7, 1] = np.float32(-999.9)
        file["acc"] = values if np.isfinite(fill_value).all() else SAMPLES
        file["acc"].attrs[key] = fill_value

    missing = np.argwhere(np.isnan(read_file(hdf5(tmp_path, fill)).samples)).tolist()
    assert missing == ([[5, 1], [6, 1]] if np.isfinite(fill_value).all() else [])


@pytest.mark.parametrize(
    ("fill_value", "missing"), [(-32768.0, [[5, 1]]), (32768, []), (-32768.5, []), (np.nan, [])]
)
def test_a_fill_value_that_counts_cannot_have_is_in_none(
    tmp_path: Path, fill_value: float, missing: list[list[int]]
) -> None:
    def fill(file: h5py.File) -> None:
        counts = COUNTS.copy()
        counts[5, 1] = -32768
        file["acc"] = counts
        file["acc"].attrs["_FillValue"] = fill_value

    table = read_file(hdf5(tmp_path, fill))
    assert np.argwhere(np.isnan(table.samples)).tolist() == missing


def test_a_fill_value_of_unsigned_counts_is_the_same_bits(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        counts = (COUNTS.astype(np.int32) + 32_000).astype(">u2")
        counts[5, 1] = 65_535
        file["acc"] = counts
        file["acc"].attrs["_FillValue"] = np.int16(-1)

    table = read_file(hdf5(tmp_path, fill))
    assert np.argwhere(np.isnan(table.samples)).tolist() == [[5, 1]]


def test_datasets_of_one_value_are_notes_wherever_they_stand(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        file["acc"] = SAMPLES.T
        file["fs"] = np.array([[50.0]])
        file["names"] = np.array(["top", "mid"], dtype=h5py.string_dtype())
        file["elsewhere"] = h5py.ExternalLink("nowhere.h5", "/x")

    table = read_file(hdf5(tmp_path, fill))
    assert (table.names, table.sampling_rate) == (("top", "mid"), RATE)
    np.testing.assert_array_equal(table.samples, SAMPLES)


def test_a_dataset_that_shares_its_name_with_a_note_is_a_channel(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        file.attrs.update(time="local", acc_y="broken", fs=RATE / 2)
        file["acc_x"], file["acc_y"] = SAMPLES.T
        file["time"] = SECONDS
        file["info/acc_x"] = "the first one"
        file["inner/fs"], file["inner/acc_x"] = np.array([RATE]), SAMPLES[:, 0]

    table = read_file(hdf5(tmp_path, fill))
    assert set(table.names) == {"acc_x", "acc_y", "inner/acc_x"}
    assert table.sampling_rate == pytest.approx(RATE)


def test_what_stands_beside_arrays_of_its_structure_holds_for_no_other_structure(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a.mat"
    own, other = {"acc_x": SAMPLES[:, 0], "fs": RATE / 2}, {"acc_y": SAMPLES[:, 1]}
    savemat(path, {"first": own, "second": other})
    assert not read_file(path, None, Wanted(frozenset({"acc_y"}))).sampling_rate
    table = read_file(path, None, Wanted(frozenset({"acc_x"})))
    assert table.sampling_rate == pytest.approx(RATE / 2)


@pytest.mark.parametrize("kind", ["h5", "h5 attributes", "mat"])
def test_units_in_a_group_of_their_own_are_those_of_the_arrays_by_name(
    tmp_path: Path, kind: str
) -> None:
    units = {"acc_x": "g", "acc_y": "mm/s2", "t": "ms", "fs": "Hz"}
    arrays = {"acc_x": SAMPLES[:, 0], "acc_y": SAMPLES[:, 1], "temp": SAMPLES[:, 0]}
    path = tmp_path / f"a.{kind[:3].strip()}"
    if kind == "mat":
        savemat(path, {"run": arrays | {"t": np.arange(60) * 20}, "units": units})
    else:
        with h5py.File(path, "w") as file:
            for name, each in (arrays | {"t": np.arange(60) * 20}).items():
                file[f"run/{name}"] = each
            file.create_group("units")
            for name, unit in units.items():
                if kind == "h5":
                    file[f"units/{name}"] = unit
                else:
                    file["units"].attrs[name] = unit
    table = read_file(path)
    found = dict(zip(table.names, table.units, strict=True))
    assert found == {"acc_x": "m/s²", "acc_y": "m/s²", "temp": ""}
    assert table.sampling_rate == pytest.approx(RATE)
    factors = {"acc_x": 9.80665, "acc_y": 1e-3, "temp": 1.0}
    for name, samples in zip(table.names, table.samples.T, strict=True):
        np.testing.assert_allclose(samples, arrays[name] * factors[name])


def test_a_unit_of_its_own_goes_before_one_in_a_group_of_units(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        file.attrs["fs"] = RATE
        file["acc"] = SAMPLES[:, 0]
        file["acc"].attrs["units"] = "mm/s2"
        file["units/acc"] = "g"

    np.testing.assert_allclose(read_file(hdf5(tmp_path, fill)).samples[:, 0], 1e-3 * SAMPLES[:, 0])


def test_the_unit_of_a_time_says_since_when(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        file["acc"] = SAMPLES
        file["time"] = SECONDS
        file["time"].attrs["units"] = "seconds since 2024-03-13 12:00:00.25"

    assert read_file(hdf5(tmp_path, fill)).start_ns == START_NS


@pytest.mark.parametrize(
    ("attribute", "message"), [("ticks", r"is in \[ticks\]"), ("pandas", "a table of pandas")]
)
def test_what_a_file_leaves_open_is_one_line(tmp_path: Path, attribute: str, message: str) -> None:
    def fill(file: h5py.File) -> None:
        file["g/acc"], file["g/time"] = SAMPLES, SECONDS
        file["g/time"].attrs["units"] = attribute
        if attribute == "pandas":
            file["g"].attrs["pandas_type"] = "frame"

    with pytest.raises(FileError, match=message):
        read_file(hdf5(tmp_path, fill))


def test_a_waveform_of_labview_begins_at_its_offset(tmp_path: Path) -> None:
    notes = {"wf_increment": 0.02, "wf_start_time": START.astype("datetime64[us]"),
             "wf_start_offset": 10.0}  # fmt: skip
    with TdmsWriter(tmp_path / "a.tdms") as writer:
        writer.write_segment(
            [ChannelObject("g", "a", np.ascontiguousarray(SAMPLES[:, 0]), properties=notes)]
        )
    assert read_file(tmp_path / "a.tdms").start_ns == START_NS + 10 * 10**9


def test_a_log_among_miniseed_records_is_no_channel(tmp_path: Path) -> None:
    def trace(code: str, data: np.ndarray) -> obspy.Trace:
        header = {"channel": code, "sampling_rate": RATE if code != "LOG" else 0.0}
        return obspy.Trace(data, header)

    log = trace("LOG", np.frombuffer(b"text" * 20, dtype="S1"))
    with pytest.warns(UserWarning, match="different encodings"):
        obspy.Stream([trace("HNX", SAMPLES[:, 0].copy()), log]).write(
            str(tmp_path / "a.mseed"), format="MSEED"
        )
    assert read_file(tmp_path / "a.mseed").names == ("...HNX",)


def test_columns_of_parquet_are_understood_by_their_types(tmp_path: Path) -> None:
    columns = {
        "when": pa.array(STAMPS).cast(pa.timestamp("us", "Europe/Copenhagen")),
        "a": pa.array(np.round(SAMPLES[:, 0])).dictionary_encode(),
        "b": pa.array(SAMPLES[:, 1].astype(np.float16)),
        "turbine": ["t1"] * 60,
        "__index_level_0__": np.arange(60),
    }
    parquet.write_table(pa.table(columns), tmp_path / "a.parquet")
    table = read_file(tmp_path / "a.parquet")
    assert (table.names, table.start_ns, table.sampling_rate) == (("a", "b"), START_NS, RATE)
    half = SAMPLES[:, 1].astype(np.float16)
    np.testing.assert_array_equal(table.samples.T, [np.round(SAMPLES[:, 0]), half])


def test_dates_in_text_and_parts_of_a_clock_in_parquet_are_the_time(tmp_path: Path) -> None:
    written = [f"{stamp}Z" for stamp in np.array(STAMPS, "datetime64[ns]").astype(str)]
    columns = {"when": written, "Hour": np.full(60, 12), "Minute": np.full(60, 0)}
    parquet.write_table(pa.table({**columns, "a": SAMPLES[:, 0]}), tmp_path / "a.parquet")
    table = read_file(tmp_path / "a.parquet")
    assert (table.names, table.start_ns, table.sampling_rate) == (("a",), START_NS, RATE)


def test_structures_of_matlab_are_groups_with_their_own_notes(tmp_path: Path) -> None:
    content = {
        "tower": {"acc": SAMPLES, "fs": RATE, "units": "g", "labels": np.array(["a", "b"], object)},
        "comment": "made today",
        "settings": {"empty": np.zeros((0, 0)), "flag": True},
    }
    savemat(tmp_path / "a.mat", content)
    table = read_file(tmp_path / "a.mat")
    assert table.names == ("a", "b")
    assert table.units == ("m/s²", "m/s²")
    assert table.sampling_rate == RATE
    np.testing.assert_allclose(table.samples, 9.80665 * SAMPLES)


def test_a_header_beside_the_measurements_has_their_rate_start_and_unit(tmp_path: Path) -> None:
    header = {"fs": RATE, "startTime": "13-Mar-2024 12:00:00.250", "units": "g"}
    data = {"info": header, "acc": {"L106": {"x": SAMPLES[:, 0]}, "L042": {"x": SAMPLES[:, 1]}}}
    savemat(tmp_path / "a.mat", {"Data": data})

    def fill(file: h5py.File) -> None:
        file.create_group("header").attrs.update(header)
        file["acc/L106"], file["acc/L042"] = SAMPLES.T

    for path in (tmp_path / "a.mat", hdf5(tmp_path, fill)):
        table = read_file(path)
        assert table.sampling_rate == RATE
        assert table.start_ns == START_NS
        assert table.units == ("m/s²", "m/s²")


def test_texts_beside_a_matrix_name_its_columns_whatever_they_are_called(tmp_path: Path) -> None:
    names = ["top FA", "mid FA"]
    assert read_file(npz(tmp_path, y=SAMPLES, lbl=names, Fs=50)).names == tuple(names)
    both = npz(tmp_path, y=SAMPLES, lbl=names, who=["Ann", "Bob"], Fs=50)
    assert read_file(both).names == ("y1", "y2")


def test_what_rises_evenly_is_no_channel(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = npz(tmp_path, a=SAMPLES[:, 0], b=SAMPLES[:, 1], tt=SECONDS.astype(np.float32), fs=RATE)
    assert read_file(path).names == ("a", "b")
    assert "tt rises evenly from 0 by 0.02 and is no channel" in caplog.text
    unknown = npz(tmp_path, a=SAMPLES[:, 0], tt=SECONDS)
    assert read_file(unknown).sampling_rate is None
    assert "where it is the time, --sampling-rate HZ stands for it" in caplog.text
    assert read_file(npz(tmp_path, ramp=SECONDS, fs=RATE)).names == ("ramp",)


def test_cells_of_matlab_that_hold_more_than_texts_are_no_names(tmp_path: Path) -> None:
    content = {"acc": SAMPLES, "fs": RATE, "names": np.array(["a", 2.0], object)}
    savemat(tmp_path / "a.mat", content)
    assert read_file(tmp_path / "a.mat").names != ("a", "2.0")


@pytest.mark.parametrize("note", [{"ts": 1.7e9}, {"sampling_time": 600.0}, {"ts": "yesterday"}])
def test_how_long_was_measured_or_when_is_no_interval(tmp_path: Path, note: Notes) -> None:
    assert read_file(npz(tmp_path, acc=SAMPLES, **note)).sampling_rate is None


@pytest.mark.parametrize("name", ["time", "datenum"])
def test_days_of_matlab_in_a_mat_file_have_a_date(tmp_path: Path, name: str) -> None:
    days = 719_529 + START_NS / 86_400e9 + SECONDS / 86_400
    savemat(tmp_path / "a.mat", {name: days[:, None], "acc": SAMPLES.T})
    table = read_file(tmp_path / "a.mat")
    np.testing.assert_array_equal(table.samples, SAMPLES)
    assert abs(table.start_ns - START_NS) < 100_000  # what a double holds of such days
    assert table.sampling_rate == pytest.approx(RATE)


def test_seconds_since_midnight_in_a_mat_file_go_on_over_midnight(tmp_path: Path) -> None:
    clock = (86_399.5 + SECONDS) % 86_400
    savemat(tmp_path / "a.mat", {"time": clock[:, None], "acc": SAMPLES.T})
    times = read_file(tmp_path / "a.mat").times
    np.testing.assert_allclose(times, SECONDS, atol=1e-9)


def test_a_clock_of_digits_in_a_mat_file_is_no_count_of_seconds(tmp_path: Path) -> None:
    clock = np.where(SECONDS < 0.6, 115_959.4 + SECONDS, 120_000 + SECONDS - 0.6)
    savemat(tmp_path / "a.mat", {"time": clock[:, None], "acc": SAMPLES.T})
    times = read_file(tmp_path / "a.mat").times
    np.testing.assert_allclose(times, SECONDS, atol=1e-9)


def outb(kind: int, samples: np.ndarray[Any, Any]) -> bytes:
    """Samples (n, 2) as OpenFAST packs them into 16 bits, with names of 10 or of 14 characters."""
    length = 14 if kind == 4 else 10
    scale = np.float32(60_000 / np.ptp(samples, axis=0))
    offset = np.float32(-30_000 - scale * samples.min(axis=0))
    packed = np.round(samples * scale + offset).astype("<i2")
    times = (1e4, -5.0) if kind == 1 else (0.0, 1 / RATE)
    stored = np.round(SECONDS * 1e4 - 5.0).astype("<i4").tobytes() if kind == 1 else b""
    texts = ("Time", "TwHt1ALxt", "TwHt1ALyt", "(s)", "(m/s^2)", "(m/s^2)")
    return (
        struct.pack("<h", kind)
        + (struct.pack("<h", length) if kind == 4 else b"")
        + struct.pack("<iidd", 2, len(samples), *times)
        + scale.tobytes()
        + offset.tobytes()
        + struct.pack("<i", 5)
        + b"ptfm "
        + b"".join(text.ljust(length).encode() for text in texts)
        + stored
        + packed.tobytes()
    )


@pytest.mark.parametrize("kind", [1, 2, 4])
def test_openfast_packs_its_output_into_sixteen_bits(tmp_path: Path, kind: int) -> None:
    (tmp_path / "a.outb").write_bytes(outb(kind, SAMPLES))
    table = read_file(tmp_path / "a.outb")
    assert table.times == pytest.approx(SECONDS, abs=1e-4)  # what kind 1 rounds them to
    assert table.names == ("TwHt1ALxt", "TwHt1ALyt")
    assert table.units == ("m/s²", "m/s²")
    assert table.sampling_rate == pytest.approx(RATE)
    step = np.ptp(SAMPLES, axis=0).max() / 60_000
    np.testing.assert_allclose(table.samples, SAMPLES, rtol=0, atol=0.6 * step)


def test_openfast_writes_text_with_units_below_the_names(tmp_path: Path) -> None:
    head = (
        "\nPredictions were generated on 12-Oct-2024 at 14:06:34 using OpenFAST, compiled 64-bit\n"
        "linked with NWTC Subroutine Library; ElastoDyn; AeroDyn\n\n"
        "Description from the FAST input file: IEA 15 MW\n\n"
        "Time      \tTwHt1ALxt \tTwHt1ALyt \n(s)       \t(m/s^2)   \t(m/s^2)   \n"
    )
    rows = [f"{t:10.4f}\t{a:14.6E}\t{b:14.6E}" for t, (a, b) in zip(SECONDS, SAMPLES, strict=True)]
    (tmp_path / "a.out").write_text(head + "\n".join(rows) + "\n")
    table = read_file(tmp_path / "a.out")
    assert table.names == ("TwHt1ALxt", "TwHt1ALyt")
    assert table.units == ("m/s²", "m/s²")
    assert table.sampling_rate == pytest.approx(RATE)
    np.testing.assert_allclose(table.samples, SAMPLES, rtol=1e-6, atol=1e-9)


def test_a_universal_file_without_time_responses_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "a.uff"
    path.write_text("    -1\n   151\nmodel\n\n\n\n\n\n\n    -1\n")
    with pytest.raises(FileError, match="no time response"):
        read_file(path)


def test_names_of_channels_are_read_from_the_notes_of_a_file() -> None:
    assert _find_names({"Channel Names": np.array(["a", "b"])}).tolist() == ["a", "b"]
    assert _find_names({"comment": "x"}).size == 0


def matlab_73(path: Path, group: dict[str, Any]) -> Path:
    """A file as MATLAB's `save -v7.3` writes a structure `rec`: axes reversed, texts as letters."""

    def put(place: h5py.Group, name: str, value: Any) -> h5py.Dataset:
        if isinstance(value, list):
            inside = [put(letters, f"{name}{i}", each).ref for i, each in enumerate(value)]
            stored, kind = np.array([inside], dtype=h5py.ref_dtype), "cell"
        elif isinstance(value, str):
            stored, kind = np.array([[ord(each)] for each in value], dtype=np.uint16), "char"
        else:
            stored, kind = np.atleast_2d(value).T, "double"
        empty = stored.size == 0
        made = place.create_dataset(name, data=np.zeros(2, np.uint64) if empty else stored)
        made.attrs["MATLAB_class"] = np.bytes_(kind)
        if empty:
            made.attrs["MATLAB_empty"] = np.uint8(1)
        return made

    with h5py.File(path, "w", userblock_size=512) as file:
        letters = file.create_group("#refs#")
        rec = file.create_group("rec")
        rec.attrs["MATLAB_class"] = np.bytes_("struct")
        for name, value in group.items():
            put(rec, name, value)
    return path


def test_texts_and_cells_of_matlab_73_are_read(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    names, stated = ["top_97m_FA", "höhe_40m_SS"], {"fs": RATE, "start": "2024-03-13 12:00:00.250"}
    group = {"data": SAMPLES, "channels": names, "unit": "g", "comment": np.zeros((0, 0)), **stated}
    table = read_file(matlab_73(tmp_path / "a.mat", group))
    assert table.names == tuple(names)
    assert table.units == ("m/s²", "m/s²")
    assert (table.sampling_rate, table.start_ns) == (RATE, START_NS)
    np.testing.assert_allclose(table.samples, 9.80665 * SAMPLES)
    each = read_file(matlab_73(tmp_path / "b.mat", group | {"unit": ["g", "mm/s2"]}))
    np.testing.assert_allclose(each.samples, SAMPLES * [9.80665, 1e-3])
    assert not caplog.records
    group["channels"] = ["top", np.array([2.0])]
    assert read_file(matlab_73(tmp_path / "c.mat", group)).names == ("data1", "data2")
