"""Files of measurements become a recording: the same samples at the same times, gaps kept."""

import json
import re
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter
from typer.testing import CliRunner

from pipeline.app import Outputs, build
from pipeline.cli import app
from pipeline.offline.identify_file import identify_file
from pipeline.offline.measured_file import recorded_channels
from pipeline.offline.model_modes import model_modes
from pipeline.recording.info import recording_info
from pipeline.recording.reader import read_messages
from pipeline.scenario import load_scenario
from pipeline.sources.import_files import open_measurement, record_measurement
from pipeline.sources.sources import replayed
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.errors import InputError
from sensors.files.formats import channels_in
from sensors.files.layout_file import layout_template, load_layout

START = np.datetime64("2024-03-01T12:00:00", "ns")
RATE = 40.0


def text(samples: NDArray[np.float64], *, begin: float = 0.0, missing: slice | None = None) -> str:
    """A CSV of a measurement that begins so many seconds after START, perhaps with a gap."""
    seconds = begin + np.arange(len(samples)) / RATE
    stamps = START + np.round(seconds * 1e9).astype("timedelta64[ns]")
    kept = np.ones(len(samples), dtype=bool)
    if missing is not None:
        kept[missing] = False
    rows = [
        f"{stamp},{a!r},{b!r}"
        for stamp, (a, b) in zip(stamps[kept], samples[kept].tolist(), strict=True)
    ]
    return "\n".join(["time,z145-fa [g],z145-ss [m/s²]", *rows]) + "\n"


def written(path: Path, content: str) -> Path:
    path.write_text(content, encoding="utf-8")
    return path


def imported(paths: list[Path], out: Path) -> list[AccelerationBlock]:
    record_measurement(open_measurement(paths), out)
    return [each for each in read_messages(out) if isinstance(each, AccelerationBlock)]


SAMPLES = np.random.default_rng(17).normal(size=(1234, 2))


def test_samples_times_and_units_are_those_of_the_file(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", text(SAMPLES))
    blocks = imported([path], tmp_path / "a.mcap")
    samples = np.concatenate([block.samples for block in blocks])
    np.testing.assert_array_equal(samples, (SAMPLES * [9.80665, 1.0]).astype(np.float32))
    assert {block.sampling_rate for block in blocks} == {RATE}
    start_ns = int(START.astype(np.int64))
    assert [block.start_ns for block in blocks] == [
        start_ns + number * NANOSECONDS for number in range(31)
    ]
    assert [block.first_sample for block in blocks] == list(range(0, 1234, 40))
    assert [block.sequence for block in blocks] == list(range(31))


def test_a_recording_written_as_text_comes_back_as_the_same_recording(
    short_recording: Path, tmp_path: Path
) -> None:
    table = recorded_channels([short_recording]).table
    assert table.times is not None
    titles = ",".join(f"{name} [m/s²]" for name in table.names)
    stamps = table.start_ns + np.round(table.times * 1e9).astype(np.int64)
    rows = [
        f"{stamp},{','.join(f'{value:.9g}' for value in row)}"
        for stamp, row in zip(stamps.astype("datetime64[ns]"), table.samples, strict=True)
    ]
    path = written(tmp_path / "a.csv", "\n".join([f"time,{titles}", *rows]))
    record_measurement(open_measurement([path]), tmp_path / "a.mcap")
    again = recorded_channels([tmp_path / "a.mcap"]).table
    np.testing.assert_array_equal(again.samples, table.samples)
    assert again.times is not None
    np.testing.assert_allclose(again.times, table.times, rtol=0, atol=1e-9)
    assert (again.names, again.units) == (table.names, table.units)
    assert (again.start_ns, again.sampling_rate) == (table.start_ns, table.sampling_rate)


def test_a_gap_stays_a_gap(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", text(SAMPLES, missing=slice(100, 230)))
    blocks = imported([path], tmp_path / "a.mcap")
    ends = [block.first_sample + len(block.samples) for block in blocks]
    leaps = [
        (end, block.first_sample)
        for end, block in zip(ends, blocks[1:], strict=False)
        if block.first_sample != end
    ]
    assert leaps == [(100, 230)]
    for block in blocks:
        assert block.start_ns == int(START.astype(np.int64)) + block.first_sample * 25_000_000
    (unit,) = recording_info(tmp_path / "a.mcap").units
    (gap,) = unit.gaps
    assert (gap.end_ns - gap.start_ns) / NANOSECONDS == pytest.approx(130 / RATE)


def test_single_missing_rows_stay_missing_at_the_rate_of_the_others(tmp_path: Path) -> None:
    """The mean step, with that of missing rows, is of a lower rate: samples drifted off in time."""
    there = np.random.default_rng(3).random(len(SAMPLES)) >= 0.03
    lines = text(SAMPLES).splitlines(keepends=True)
    rows = [line for line, kept in zip(lines[1:], there, strict=True) if kept]
    blocks = imported([written(tmp_path / "a.csv", lines[0] + "".join(rows))], tmp_path / "a.mcap")
    assert {block.sampling_rate for block in blocks} == {RATE}
    numbers = [block.first_sample + i for block in blocks for i in range(len(block.samples))]
    assert numbers == np.flatnonzero(there).tolist()


def test_rows_without_a_number_are_a_gap_and_single_empty_cells_stay_nan(tmp_path: Path) -> None:
    samples = SAMPLES.copy()
    samples[200:300] = np.nan
    samples[500, 1] = np.nan
    path = written(tmp_path / "a.csv", text(samples))
    blocks = imported([path], tmp_path / "a.mcap")
    assert sum(len(block.samples) for block in blocks) == len(samples) - 100
    bad = [(b.first_sample + row, c) for b in blocks for row, c in np.argwhere(np.isnan(b.samples))]
    assert bad == [(500, 1)]


def test_files_given_in_any_order_join_in_order_of_time(tmp_path: Path) -> None:
    first = written(tmp_path / "a.csv", text(SAMPLES[:600]))
    second = written(tmp_path / "b.csv", text(SAMPLES[600:], begin=15.0))
    blocks = imported([second, first], tmp_path / "joined.mcap")
    whole = imported([written(tmp_path / "c.csv", text(SAMPLES))], tmp_path / "whole.mcap")
    assert [block.start_ns for block in blocks] == [block.start_ns for block in whole]
    for joined, one in zip(blocks, whole, strict=True):
        np.testing.assert_array_equal(joined.samples, one.samples)


def test_files_far_apart_are_sessions_of_their_own(tmp_path: Path) -> None:
    first = written(tmp_path / "a.csv", text(SAMPLES[:600]))
    second = written(tmp_path / "b.csv", text(SAMPLES[600:], begin=86_400.0))
    blocks = imported([first, second], tmp_path / "joined.mcap")
    assert list(dict.fromkeys(block.session for block in blocks)) == [
        "20240301T120000Z",
        "20240302T120000Z",
    ]
    assert blocks[15].first_sample == blocks[15].sequence == 0


def test_late_stamps_lose_no_sample(tmp_path: Path) -> None:
    """Stamps of a busy logger: up to 1.6 samples late, never early."""
    late = np.random.default_rng(5).choice([0.0, 0.0, 0.0, 0.003, 0.02, 0.04], size=len(SAMPLES))
    seconds = np.maximum.accumulate(np.arange(len(SAMPLES)) / RATE + late)
    seconds += 1e-6 * np.arange(len(SAMPLES))  # two that came at once: one behind the other
    rows = "".join(f"{t:.7f},{a!r}\n" for t, a in zip(seconds, SAMPLES[:, 0].tolist(), strict=True))
    path = written(tmp_path / "a.csv", "t,z145-fa [m/s2]\n" + rows)
    blocks = imported([path], tmp_path / "a.mcap")
    assert sum(len(block.samples) for block in blocks) == len(SAMPLES)
    assert [block.first_sample for block in blocks] == list(range(0, len(SAMPLES), 40))
    (unit,) = recording_info(tmp_path / "a.mcap").units
    assert unit.gaps == ()


LAYOUT = """
turbine = "t07"
[[channels]]
name = "B"
elevation = 80.0
direction = [1.0, 1.0, 0.0]
unit = "g"
sensitivity = 0.1
[[channels]]
name = "A"
elevation = 145.0
direction = [0.0, 1.0, 0.0]
serial = "4711"
coupling = "ac"
corner_frequency = 0.1
"""


def test_a_column_that_rises_evenly_is_left_out_where_the_rate_is_given(tmp_path: Path) -> None:
    rows = [f"{0.5 + k / 10},{a!r},{b!r}" for k, (a, b) in enumerate(SAMPLES[:200].tolist())]
    path = written(tmp_path / "a.csv", "\n".join(["ramp,z145-fa,z145-ss", *rows]) + "\n")
    with pytest.raises(InputError, match=r"'ramp' rises evenly from 0\.5 by 0\.1"):
        open_measurement([path])
    record_measurement(open_measurement([path], sampling_rate=10.0), tmp_path / "a.mcap")
    (layout,) = recording_info(tmp_path / "a.mcap").layouts
    assert layout.channel_names == ("z145-fa", "z145-ss")


def test_a_layout_file_says_place_unit_and_sensitivity(tmp_path: Path) -> None:
    rows = "".join(f"{i / 40},{i},{2 * i},7\n" for i in range(100))
    path = written(tmp_path / "a.csv", "t,A [m/s2],B [V],C\n" + rows)
    layout = load_layout(written(tmp_path / "layout.toml", LAYOUT))
    record_measurement(open_measurement([path], layout=layout), tmp_path / "a.mcap")
    messages = list(read_messages(tmp_path / "a.mcap"))
    (found,) = [each for each in messages if isinstance(each, SensorLayout)]
    assert (found.turbine, found.channel_names) == ("t07", ("B", "A"))
    assert found.channels[0].direction == pytest.approx((0.5**0.5, 0.5**0.5, 0.0))
    assert (found.channels[1].serial, found.channels[1].corner_frequency) == ("4711", 0.1)
    first = next(each for each in messages if isinstance(each, AccelerationBlock))
    np.testing.assert_allclose(first.samples[3], [6 / 0.1 * 9.80665, 3.0], rtol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("B", "b"), r"no channel 'b'; did you mean 'B'\?"),
        (('unit = "g"\n', ""), r"sensitivity 0.1 is per what\?"),
        (("[1.0, 1.0, 0.0]", "[0.0, 0.0, 0.0]"), "it must point somewhere"),
        (("elevation = 80.0\n", ""), r"\[\[channels\]\] 1: the key 'elevation' is missing"),
        (("serial", "seriel"), r"unknown key 'seriel'; did you mean 'serial'\?"),
        (('"t07"', '"t 07"'), "a name without spaces"),
        (('serial = "4711"', 'unit = "mg"'), "leave unit = 'mg' out"),
        (('serial = "4711"', 'unit = "m/s²"\nsensitivity = 2.0'), "leave unit = 'm/s²' out"),
        (("[[channels]]", "[channels"), "not valid TOML"),
    ],
)
def test_a_mistake_in_a_layout_file_is_one_line(
    change: tuple[str, str], message: str, tmp_path: Path
) -> None:
    path = written(tmp_path / "a.csv", "t,A [m/s2],B [V]\n0,1,2\n1,1,2\n2,1,3\n")
    layout = written(tmp_path / "layout.toml", LAYOUT.replace(*change, 1))
    with pytest.raises(InputError, match=message) as error:
        open_measurement([path], layout=load_layout(layout))
    assert "\n" not in str(error.value)
    assert str(layout) in str(error.value)


@pytest.mark.parametrize("unit", ["m/s2", "m/s²"])
def test_a_layout_file_may_repeat_the_unit_that_the_file_states(unit: str, tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", "t,A [m/s2],B [V]\n0,1,2\n1,1,2\n2,1,3\n")
    text = LAYOUT.replace('serial = "4711"', f'unit = "{unit}"')
    layout = load_layout(written(tmp_path / "layout.toml", text))
    record_measurement(open_measurement([path], layout=layout), tmp_path / "a.mcap")
    messages = read_messages(tmp_path / "a.mcap")
    first = next(each for each in messages if isinstance(each, AccelerationBlock))
    np.testing.assert_allclose(first.samples[:, 1], 1.0)


@pytest.mark.parametrize("count", [1, 7, 600])
def test_samples_that_a_file_repeats_of_the_one_before_are_taken_once(
    count: int, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    samples = SAMPLES.copy()
    samples[598] = np.nan
    first = written(tmp_path / "a.csv", text(samples[:600]))
    next_one = text(samples[600 - count :], begin=(600 - count) / RATE)
    second = written(tmp_path / "b.csv", next_one)
    again = imported([first, second], tmp_path / "again.mcap")
    whole = imported([written(tmp_path / "c.csv", text(samples))], tmp_path / "whole.mcap")
    assert [block.start_ns for block in again] == [block.start_ns for block in whole]
    for block, expected in zip(again, whole, strict=True):
        np.testing.assert_array_equal(block.samples, expected.samples)
    last = "sample" if count == 1 else f"{count} samples"
    assert f"{second} begins with the last {last} of {first}, taken once" in caplog.messages


def test_what_cannot_be_joined_says_so_in_one_line(tmp_path: Path) -> None:
    first = written(tmp_path / "a.csv", text(SAMPLES[:600]))
    overlapping = written(tmp_path / "b.csv", text(SAMPLES[:600], begin=14.0))
    other = written(tmp_path / "c.csv", text(SAMPLES[:600], begin=20.0).replace("z145", "z80"))
    undated = written(tmp_path / "d.csv", "t,z145-fa [g],z145-ss [m/s²]\n0,1,1\n1,2,2\n")
    for files, message in (
        ([first, overlapping], r"b\.csv begins at 2024-03-01 12:00:14\.000, before .*a\.csv ends"),
        ([first, other], r"c\.csv has the channels z80-fa"),
        ([first, undated], r"d\.csv does not say when it begins"),
    ):
        with pytest.raises(InputError, match=message) as error:
            imported(files, tmp_path / "joined.mcap")
        assert "\n" not in str(error.value)
        assert not list(tmp_path.glob("joined.mcap*"))


def test_files_whose_stamps_repeat_need_a_start_in_their_names(tmp_path: Path) -> None:
    """They do say when they begin, to a second or so: it is the counting that takes no stamp."""
    exact = [text(SAMPLES[:600], begin=begin) for begin in (0.0, 15.0)]
    rows = [re.sub(r"(T\d\d:\d\d:\d\d)\.\d+", r"\1", each) for each in exact]
    files = [written(tmp_path / name, each) for name, each in zip("ab", rows, strict=True)]
    with pytest.raises(InputError, match=r"a: the samples of all files are counted, as some time"):
        open_measurement(files, sampling_rate=RATE)
    named = [
        written(tmp_path / f"m_20240301_1200{second}.csv", each)
        for second, each in zip(("00", "15"), rows, strict=True)
    ]
    measurement = open_measurement(named, sampling_rate=RATE)
    assert sum(len(block.samples) for block in measurement.blocks()) == 1200


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("t,a,b\n0,1,2\n1,2,3\n", r"where on the tower are a, b\? .*--template"),
        ("z1-fa,z1-ss\n1,2\n1,3\n", "give --sampling-rate HZ"),
        ("t,z1-fa [g],z1-ss [mm/s]\n0,1,2\n1,2,3\n", "mixes quantities"),
        ("t,z1-fa [g]\n0,1\n1,2\n1,3\n", "time stands still or goes back at 1.000 s"),
        ("t,z1-fa [g]\n0,1\n1,2\n2,x\n", "'x' in line 4"),
    ],
)
def test_what_cannot_be_imported_is_one_line(tmp_path: Path, content: str, message: str) -> None:
    path = written(tmp_path / "a.csv", content)
    with pytest.raises(InputError, match=message) as error:
        imported([path], tmp_path / "a.mcap")
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)
    assert not list(tmp_path.glob("a.mcap*"))


def test_a_layout_chooses_channels_of_one_rate_and_what_else_there_is_does_not_matter(
    tmp_path: Path,
) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, rate in (("A", RATE), ("slow", 1.0)):
            file[name] = SAMPLES[:, 0]
            file[name].attrs["fs"] = rate
    words = '[[channels]]\nname = "A"\nelevation = 9.0\ndirection = [1, 0, 0]\n'
    layout = load_layout(written(tmp_path / "layout.toml", words))
    assert open_measurement([tmp_path / "a.h5"], layout=layout).sampling_rate == RATE
    with pytest.raises(InputError, match="channels differ in sampling rate"):
        open_measurement([tmp_path / "a.h5"])
    template = layout_template(channels_in(tmp_path / "a.h5"))
    assert 'name = "A"' in template
    assert 'name = "slow"' in template
    assert identify_file(tmp_path / "a.h5", layout=layout).channels == ("A",)
    rows = "".join(f"12:00:00,{value},ok\n" for value in SAMPLES[:, 0])
    coarse = written(tmp_path / "a.csv", "time,A,state\n" + rows)
    with pytest.raises(InputError, match="do not increase; --sampling-rate HZ counts the samples"):
        record_measurement(open_measurement([coarse], layout=layout), tmp_path / "a.mcap")
    with pytest.raises(InputError, match="do not increase; --sampling-rate HZ counts the samples"):
        identify_file(coarse)
    assert identify_file(coarse, sampling_rate=RATE).estimates
    counted = open_measurement([coarse], layout=layout, sampling_rate=RATE)
    assert sum(len(block.samples) for block in counted.blocks()) == len(SAMPLES)


def test_the_template_is_a_layout_that_can_be_filled_in(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", "t,A [m/s2],B [V]\n0,1,2\n1,1,2\n2,1,3\n")
    printed = CliRunner().invoke(app, ["import", str(path), "--template"])
    assert printed.exit_code == 0
    with pytest.raises(InputError, match="elevation is 0 for all 2 channels; fill in"):
        load_layout(written(tmp_path / "layout.toml", printed.stdout))
    filled = printed.stdout.replace("elevation = 0.0 ", "elevation = 41.0 ", 1)
    layout = load_layout(written(tmp_path / "layout.toml", filled))
    assert [channel.name for channel in layout.channels] == ["A", "B"]


@pytest.mark.parametrize("suffix", ["csv", "npz"])
def test_the_template_marks_channels_that_are_constant(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a.{suffix}"
    dead = np.where(np.arange(1234) < 7, np.nan, 0.0)
    if suffix == "npz":
        np.savez(path, A=SAMPLES[:, 0], Reserve=dead, fs=RATE)
    else:
        table = np.column_stack([np.arange(1234) / RATE, SAMPLES[:, 0], dead])
        rows = "".join(f"{time},{a},{b}\n" for time, a, b in table.tolist())
        written(path, "t,A,Reserve\n" + rows)
    printed = CliRunner().invoke(app, ["import", str(path), "--template"])
    first, second = printed.stdout.split("[[channels]]")[1:]
    assert "# constant over the file" not in first
    assert 'name = "Reserve"\n# constant over the file' in second


def test_a_template_is_printed_of_a_file_that_cannot_be_read_to_its_end(tmp_path: Path) -> None:
    rows = "".join(f"{i / RATE},{i % 7},1\n" for i in range(600_000))
    path = written(tmp_path / "a.csv", "t,A,B\n" + rows + "15000,1,broken\n")
    printed = CliRunner().invoke(app, ["import", str(path), "--template"])
    assert printed.exit_code == 0
    assert 'name = "B"' in printed.stdout


def test_the_template_has_the_heights_and_axes_that_names_state(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", "t,85m_FA [g],85m_SS,ch\n0,1,2,3\n1,1,2,4\n2,1,3,2\n")
    printed = layout_template(channels_in(path))
    assert "elevation = 85.0                   # above mean water level [m]: from '85m'" in printed
    with pytest.raises(InputError, match=r"\[\[channels\]\] 3: the key 'elevation' is missing"):
        load_layout(written(tmp_path / "layout.toml", printed))
    printed = printed.replace("# elevation = ", "elevation = 40 # ")
    channels = load_layout(written(tmp_path / "layout.toml", printed)).channels
    assert [(each.elevation, each.direction) for each in channels] == [
        (85.0, (1.0, 0.0, 0.0)),
        (85.0, (0.0, 1.0, 0.0)),
        (40.0, (1.0, 0.0, 0.0)),
    ]
    first, second = printed.split("[[channels]]")[1:3]
    assert "# unit and sensitivity: the file states m/s²" in first
    assert "# sensitivity = 1.0" in second


def test_what_the_template_proposes_is_read_when_it_is_uncommented(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", "t,85m_FA,85m_SS\n0,1,2\n1,1,2\n2,1,3\n")
    printed, _, _ = layout_template(channels_in(path)).partition("# [time]")
    for key in ("unit", "sensitivity", "coupling", "corner_frequency", "quantity"):
        assert f"\n# {key} = " in printed
        printed = printed.replace(f"\n# {key} = ", f"\n{key} = ")
    first, _ = load_layout(written(tmp_path / "layout.toml", printed)).channels
    assert (first.coupling, first.sensitivity, first.unit) == ("ac", 1.0, "m/s²")
    assert first.accelerometer("m/s²").corner_frequency > 0


def test_an_imported_recording_runs_under_the_scenario_it_was_given(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", text(SAMPLES))
    command = ["import", str(path), "-o", str(tmp_path / "a.mcap")]
    assert CliRunner().invoke(app, [*command, "--scenario", "parked"]).exit_code == 0
    info = recording_info(tmp_path / "a.mcap")
    assert info.metadata["scenario"]["name"] == "parked"
    assert info.layouts[0].turbine == load_scenario("parked").turbine.id


def two_masses() -> NDArray[np.float64]:
    """610 s of two modes under white noise, 1.9 and 5.0 Hz at 1 % damping, (n, 2)."""
    generator = np.random.default_rng(5)
    samples = np.zeros((24_400, 2))
    for frequency, shape in ((1.9, (0.6, 1.0)), (5.0, (1.0, -0.6))):
        pole = np.exp(2 * np.pi * frequency / RATE * (-0.01 + 1j))
        recursion = [1.0, -2 * pole.real, abs(pole) ** 2]
        samples += np.outer(lfilter([1.0], recursion, generator.normal(size=len(samples))), shape)
    return samples + 0.02 * samples.std() * generator.normal(size=samples.shape)


def test_a_file_runs_without_a_structure_to_modes_alone(tmp_path: Path) -> None:
    """Two masses on a tower of which nothing else is known."""
    path = written(tmp_path / "a.csv", text(two_masses()))
    layout = written(
        tmp_path / "layout.toml",
        'turbine = "chimney"\n'
        '[[channels]]\nname = "z145-fa"\nelevation = 60.0\ndirection = [1.0, 0.0, 0.0]\n'
        '[[channels]]\nname = "z145-ss"\nelevation = 30.0\ndirection = [1.0, 0.0, 0.0]\n',
    )
    out = tmp_path / "out"
    command = ["run", "--source", str(path), "--layout", str(layout), "--out", str(out)]
    finished = CliRunner().invoke(app, [*command, "--lock-step", "--no-rrd"])
    assert finished.exit_code == 0, finished.output
    assert "Modes only" in finished.output
    assert (out / "a.mcap").exists()
    figures = json.loads((out / "summary.json").read_text())
    assert figures["posterior"]["k11"]["median"] is None
    assert figures["turbine"] == "chimney"
    assert [mode["frequency_hz"] for mode in figures["modes"]] == pytest.approx(
        [1.9, 5.0], rel=0.01
    )
    assert CliRunner().invoke(app, ["show", str(out / "session.mcap")]).exit_code == 0


def test_import_takes_local_time(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", text(SAMPLES))
    recording = tmp_path / "a.mcap"
    line = ["import", str(path), "-o", str(recording), "--zone", "Europe/Berlin"]
    assert CliRunner().invoke(app, line).exit_code == 0
    first = next(each for each in read_messages(recording) if isinstance(each, AccelerationBlock))
    assert first.start_ns == (START - np.timedelta64(1, "h")).astype("int64")


def test_a_structural_model_is_compared_with_accelerations_alone(tmp_path: Path) -> None:
    path = written(
        tmp_path / "a.csv", text(SAMPLES).replace("[g]", "[mm/s]").replace("m/s²", "m/s")
    )
    record_measurement(
        open_measurement([path], turbine="iea15mw"),
        tmp_path / "a.mcap",
        scenario=load_scenario("parked"),
    )
    assert recorded_channels([tmp_path / "a.mcap"]).table.units == ("m/s", "m/s")
    source = replayed(tmp_path / "a.mcap")
    with pytest.raises(InputError, match=r"z145-fa is in m/s; .* description = \"none\""):
        build(source.scenario, source.layout, Outputs())


def test_what_needs_a_structure_says_that_there_is_none(tmp_path: Path) -> None:
    scenario = written(tmp_path / "mine.toml", '[turbine]\ndescription = "none"\n')
    with pytest.raises(InputError, match=r"scenario mine has no structural model"):
        model_modes(scenario=str(scenario))
