"""What is exported is what was recorded: samples, times and units, and every result."""

import errno
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import csv, parquet

from pipeline.export import table_file
from pipeline.export.export import Exported, export
from pipeline.export.samples import sample_times
from pipeline.export.table_file import TableFile
from pipeline.messages import FoundationTruth, ParameterSummary, RelativeStiffness
from pipeline.offline.measured_file import recorded_channels
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.errors import InputError
from sensors.files.formats import read_file
from sensors.files.table import ChannelTable
from tests.pipeline.example_messages import LAYOUT, START_NS, block, rejection
from tests.pipeline.report.example_session import estimate, event, posterior, recorded

NAME = "samples-t1-tower"


@pytest.fixture
def minute(tmp_path: Path) -> Path:
    """A minute of four levels, five seconds of it missing."""
    blocks = [block(number) for number in range(60) if not 20 <= number < 25]
    return recorded(tmp_path / "minute.mcap", [LAYOUT, *blocks])


def read(files: tuple[Exported, ...], name: str) -> pa.Table:
    """One of the exported tables."""
    (path,) = (each.path for each in files if each.path.stem == name)
    return parquet.read_table(path) if path.suffix == ".parquet" else csv.read_csv(path)


def same_channels(one: ChannelTable, other: ChannelTable) -> bool:
    """Names, units and the recorded 32-bit numbers agree."""
    return (
        one.names == other.names
        and one.units == other.units
        and np.array_equal(one.samples.astype(np.float32), other.samples.astype(np.float32))
    )


def test_identify_reads_the_same_samples_times_and_units_from_the_csv(
    minute: Path, tmp_path: Path
) -> None:
    (samples,) = export(minute, tmp_path / "out", "csv")
    ours, theirs = recorded_channels([minute]).table, read_file(samples.path)
    assert same_channels(ours, theirs)
    assert theirs.start_ns == ours.start_ns
    assert ours.times is not None
    assert theirs.times is not None
    # seconds since 1970 as a 64-bit number are exact to 0.24 µs
    np.testing.assert_allclose(theirs.times, ours.times, atol=2.4e-7)
    assert theirs.sampling_rate == pytest.approx(ours.sampling_rate, rel=1e-8)


def test_a_simulated_recording_survives_the_way_out_and_back(
    short_recording: Path, tmp_path: Path
) -> None:
    files = export(short_recording, tmp_path / "out", "csv")
    (samples,) = (each.path for each in files if each.path.stem.startswith("samples"))
    assert same_channels(recorded_channels([short_recording]).table, read_file(samples))


def test_a_gap_is_missing_rows_in_parquet_times_are_exact(minute: Path, tmp_path: Path) -> None:
    samples = read(export(minute, tmp_path / "out", "parquet"), NAME)
    assert samples.schema.field("time").type == pa.timestamp("ns", tz="UTC")
    times = samples["time"].cast(pa.int64()).to_numpy()
    whole = np.concatenate([sample_times(block(number)) for number in range(60)])
    assert times.tolist() == np.concatenate([whole[:800], whole[1000:]]).tolist()
    assert samples.schema.metadata[b"sampling_rate_hz"] == b"40.0"
    assert samples["z145-ss [m/s²]"].type == pa.float32()


def test_blocks_that_came_late_or_twice_are_in_order_and_once(tmp_path: Path) -> None:
    blocks = [block(number) for number in (0, 2, 3, 1, 3, 4)]
    path = recorded(tmp_path / "late.mcap", [LAYOUT, *blocks])
    samples = read(export(path, tmp_path / "out", "parquet"), NAME)
    times = samples["time"].cast(pa.int64()).to_numpy()
    assert len(times) == 200
    assert np.ptp(np.diff(times)) == 0


def test_rows_are_written_as_they_come_not_all_at_the_end(
    minute: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(table_file, "ROW_GROUP", 400)
    (samples,) = export(minute, tmp_path / "out", "parquet")
    written = parquet.ParquetFile(samples.path)
    assert written.num_row_groups == 6  # of 2200 rows in blocks of 40
    assert written.read().num_rows == samples.rows == 2200


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_an_export_that_is_interrupted_or_finds_no_room_leaves_no_half_table(
    form: table_file.Format, minute: Path, tmp_path: Path
) -> None:
    def interrupt(_: AccelerationBlock) -> None:
        raise KeyboardInterrupt

    def refuse(_: AccelerationBlock) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(KeyboardInterrupt):
        export(minute, tmp_path / "out", form, report=interrupt)
    with pytest.raises(InputError, match=r"out: No space left on device; nothing was left"):
        export(minute, tmp_path / "out", form, report=refuse)
    assert not list((tmp_path / "out").iterdir())


def test_other_channels_of_a_unit_go_on_in_another_file(tmp_path: Path) -> None:
    fewer = replace(LAYOUT, layout_id="two", channels=LAYOUT.channels[:2])
    later = replace(block(1), layout_id="two", samples=block(1).samples[:, :2])
    path = recorded(tmp_path / "moved.mcap", [LAYOUT, block(0), fewer, later])
    files = export(path, tmp_path / "out", "csv")
    assert [each.path.name for each in files] == [f"{NAME}.csv", f"{NAME}-2.csv"]
    assert read_file(files[1].path).names == fewer.channel_names


def test_turbines_whose_layouts_share_an_id_have_their_own_channels(tmp_path: Path) -> None:
    other = replace(LAYOUT, turbine="t2", channels=LAYOUT.channels[::-1])
    blocks = [block(0), block(0, turbine="t2")]
    files = export(recorded(tmp_path / "two.mcap", [LAYOUT, other, *blocks]), tmp_path / "o", "csv")
    names = {each.path.stem: read_file(each.path).names for each in files}
    assert names == {NAME: LAYOUT.channel_names, "samples-t2-tower": other.channel_names}


def test_each_layout_of_a_unit_has_a_number_of_its_own(tmp_path: Path) -> None:
    layouts = [replace(LAYOUT, layout_id=f"layout {n}") for n in range(4)]
    blocks = [replace(block(n), layout_id=each.layout_id) for n, each in enumerate(layouts)]
    files = export(recorded(tmp_path / "a.mcap", [*layouts, *blocks]), tmp_path / "out", "csv")
    names = [f"{NAME}.csv", *(f"{NAME}-{n}.csv" for n in (2, 3, 4))]
    assert [each.path.name for each in files] == names


def test_a_block_without_its_layout_has_numbered_channels(tmp_path: Path) -> None:
    path = recorded(tmp_path / "bare.mcap", [block(0)])
    (samples,) = export(path, tmp_path / "out", "csv")
    assert read_file(samples.path).names == tuple(f"ch{i}" for i in range(1, 9))


def test_a_channels_name_cannot_break_the_table(tmp_path: Path) -> None:
    odd = replace(LAYOUT.channels[0], name='a,b "c"\t[g]')
    layout = replace(LAYOUT, channels=(odd, *LAYOUT.channels[1:]))
    path = recorded(tmp_path / "odd.mcap", [layout, block(0)])
    (samples,) = export(path, tmp_path / "out", "csv")
    table = read_file(samples.path)
    assert table.names[1:] == LAYOUT.channel_names[1:]
    assert table.units == ("m/s²",) * 8


def test_channels_that_differ_by_a_separator_have_columns_of_different_names(
    tmp_path: Path,
) -> None:
    one, other = (
        replace(each, name=name)
        for each, name in zip(LAYOUT.channels, ("a,b", "a;b"), strict=False)
    )
    layout = replace(LAYOUT, channels=(one, other, *LAYOUT.channels[2:]))
    path = recorded(tmp_path / "odd.mcap", [layout, block(0)])
    (samples,) = export(path, tmp_path / "out", "parquet")
    names = parquet.read_schema(samples.path).names
    assert names[1:3] == ["a_b [m/s²]", "a_b.2 [m/s²]"]


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_every_result_has_its_row(form: table_file.Format, tmp_path: Path) -> None:
    found, truth = estimate(0), FoundationTruth("t1", START_NS, k11=1.0, k22=2.0, k12=3.0)
    mass = ParameterSummary("rna_mass", "-", 1.0, 1.02, 1.0, 1.04, contraction=0.6)
    change = RelativeStiffness("k22", 0.9, 0.85, 0.96, START_NS)
    known = replace(posterior(0), figures=(mass,), change_probability=0.25, relative=(change,))
    messages = [LAYOUT, truth, found, known, rejection(1), event()]
    files = export(recorded(tmp_path / "r.mcap", messages), tmp_path / "out", form)
    modes, shapes = read(files, "modes"), read(files, "mode_shapes")
    assert modes["frequency [Hz]"].to_pylist() == [mode.frequency for mode in found.modes]
    assert len(shapes) == len(found.modes) * len(found.channels)
    k22 = posterior(0).parameter("k22")
    assert read(files, "posterior")["k22_p95 [N·m/rad]"].to_pylist() == [k22.p95]
    assert read(files, "posterior")["change_probability [-]"].to_pylist() == [0.25]
    assert read(files, "figures")["median"].to_pylist() == [1.02]
    assert len(read(files, "pairs")) == len(posterior(0).pairs)
    revised = read(files, "relative")
    assert revised["spring"].to_pylist() == ["k22"]
    assert revised["ratio_p95 [-]"].to_pylist() == [0.96]
    assert len(revised["reference"].to_pylist()) == 1
    assert read(files, "rejected")["reason"].to_pylist() == ["gap of 0.4 s in tower"]
    noticed = read(files, "events")["time"].cast(pa.timestamp("ns", tz="UTC")).cast(pa.int64())
    assert noticed.to_pylist() == [event().time_ns]
    assert read(files, "truth").num_rows == 1
    assert {each.path.suffix for each in files} == {f".{form}"}


def test_correlations_stand_under_the_names_of_their_springs(tmp_path: Path) -> None:
    correlation = np.array([[1.0, 0.12, 0.13], [0.12, 1.0, 0.23], [0.13, 0.23, 1.0]])
    known = replace(posterior(0), correlation=correlation)
    table = read(
        export(recorded(tmp_path / "r.mcap", [known]), tmp_path / "out", "csv"), "posterior"
    )
    assert table["correlation_k11_k22 [-]"].to_pylist() == [0.12]
    assert table["correlation_k11_k12 [-]"].to_pylist() == [0.13]
    assert table["correlation_k22_k12 [-]"].to_pylist() == [0.23]


def test_a_samples_time_is_right_to_the_nearest_nanosecond() -> None:
    thirty = replace(block(0), start_ns=0, sampling_rate=30.0, samples=block(0).samples[:4])
    assert sample_times(thirty).tolist() == [0, 33_333_333, 66_666_667, 100_000_000]


def test_a_sessions_parts_become_one_table(tmp_path: Path) -> None:
    folder = tmp_path / "session"
    folder.mkdir()
    recorded(folder / "session.mcap", [LAYOUT, block(0), block(1)])
    recorded(folder / "session.part2.mcap", [LAYOUT, block(2), block(3)])
    recorded(folder / "session-20200101T000000Z.mcap", [LAYOUT, block(50)])  # set aside
    (samples,) = export(folder, tmp_path / "out", "parquet")
    times = read((samples,), NAME)["time"].cast(pa.int64()).to_pylist()
    assert samples.rows == 160
    assert times[-1] == block(3).end_ns - NANOSECONDS // 40


def test_what_exists_is_not_overwritten(minute: Path, tmp_path: Path) -> None:
    export(minute, tmp_path / "out", "csv")
    with pytest.raises(InputError, match=r"samples-t1-tower\.csv exists already; name another"):
        export(minute, tmp_path / "out", "csv")


def test_a_folder_that_cannot_be_made_is_one_clear_line(minute: Path, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"-o .*file: .*; a folder is needed"):
        export(minute, tmp_path / "file", "csv")


def test_no_cell_of_an_exported_text_begins_like_a_formula(tmp_path: Path) -> None:
    schema = pa.schema([("=name", pa.string()), ("value", pa.float64())])
    table = TableFile(tmp_path / "a.csv", schema, "csv")
    table.add_rows([("=HYPERLINK(1)", -1.0), ("@x", 2.0), ("plain", 3.0), (None, 4.0), ("-", 5.0)])
    table.close()
    lines = (tmp_path / "a.csv").read_text().splitlines()
    assert lines == [
        '"\'=name","value"', '"\'=HYPERLINK(1)",-1', '"\'@x",2', '"plain",3', ",4", '"-",5',
    ]  # fmt: skip
