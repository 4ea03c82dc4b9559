"""`pilewatch new` asks on a terminal what no file can show, and nothing anywhere else."""

import os
import shlex
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pipeline.cli import main
from pipeline.recording.info import recording_info
from pipeline.recording.reader import read_messages
from sensors.acquisition.scada import ScadaSample
from sensors.structure.description import turbine_text

Answered = Callable[[str, str], str]


@pytest.fixture
def nameless(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two channels without heights, axes or times, in the working directory."""
    monkeypatch.chdir(tmp_path)
    samples = np.random.default_rng(3).standard_normal((400, 2))
    np.savetxt("two.csv", samples, delimiter=",", header="ch1,ch2", comments="")
    return tmp_path


def call(arguments: str, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["pilewatch", *arguments.split()])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


@pytest.fixture
def on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> Answered:
    """Call a command with answers typed into a pseudo terminal; what it asked."""

    def answered(arguments: str, answers: str) -> str:
        ours, its = os.openpty()
        os.write(ours, answers.encode())
        with os.fdopen(its, "r", buffering=1) as keys, open(os.dup(its), "w") as screen:
            monkeypatch.setattr(sys, "stdin", keys)
            monkeypatch.setattr(sys, "stderr", screen)
            assert call(arguments, monkeypatch) == 0
        asked = os.read(ours, 100_000).decode()
        os.close(ours)
        return asked

    return answered


def test_a_terminal_is_asked_for_the_rate_and_for_heights_and_axes(
    nameless: Path, on_a_terminal: Answered
) -> None:
    asked = on_a_terminal("new two.csv -o mine", "twelve\n97,5 -ss\nhigh\n\n20\n")
    assert "ch1: height not in the name" in asked
    assert "'high': a height in metres and an axis are needed" in asked
    (layout,) = recording_info(nameless / "mine/recordings/two.mcap").layouts
    assert layout.elevations.tolist() == [97.5, 2.0]
    assert layout.directions.tolist() == [[0, -1, 0], [1, 0, 0]]


def test_a_compass_direction_is_asked_about_and_kept_by_an_empty_answer(
    nameless: Path, on_a_terminal: Answered
) -> None:
    text = Path("two.csv").read_text("utf-8").replace("ch1,ch2", "24m N,24m W")
    Path("two.csv").write_text(text)
    asked = on_a_terminal("new two.csv -o mine --sampling-rate 20", "\n24 -ss\n")
    assert "270° from north by 'W', x taken as north" in asked
    (layout,) = recording_info(nameless / "mine/recordings/two.mcap").layouts
    assert layout.directions.tolist() == [[1, 0, 0], [0, -1, 0]]


@pytest.mark.parametrize("option", ["", "--yes"])
def test_without_a_terminal_nothing_is_asked_and_guesses_are_stated(
    nameless: Path,
    option: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert call(f"new two.csv -o mine --sampling-rate 20 {option}", monkeypatch) == 0
    assert "What the names do not have is a guess" in capsys.readouterr().out
    assert call(f"new two.csv -o other {option}", monkeypatch) == 2
    assert "--sampling-rate HZ" in capsys.readouterr().err


def test_the_commands_that_are_proposed_hold_names_with_blanks(
    nameless: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("two.csv").rename("Turm 7.csv")
    words = ["new", "Turm 7.csv", "-o", "mein Turm", "--sampling-rate", "20"]
    monkeypatch.setattr(sys, "argv", ["pilewatch", *words])
    with pytest.raises(SystemExit):
        main()
    printed = capsys.readouterr().out
    assert (
        "pilewatch new 'Turm 7.csv' --layout 'mein Turm/layout.toml' --sampling-rate 20.0 "
        "-o 'mein Turm-2'"
    ) in printed
    assert "cd 'mein Turm' && pilewatch run" in printed


@pytest.mark.parametrize("structure", ["", " --structure land_tower.toml"])
def test_the_command_for_a_corrected_layout_records_all_that_the_first_one_did(
    structure: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Wind beside the motions, a controller's rotor speed and level in files of local time."""
    monkeypatch.chdir(tmp_path)
    Path("land_tower.toml").write_text(turbine_text("iea15mw_monopile"))
    rng = np.random.default_rng(3)
    rows = [
        f"3/4/2025 12:00:{k / 20:06.3f},{a:.5f},{b:.5f},8.5"
        for k, (a, b) in enumerate(rng.standard_normal((1200, 2)))
    ]
    Path("my tower.csv").write_text("\n".join(["time,24m N,24m W,wind_speed [m/s]", *rows]))
    minutes = [f"3/4/2025 12:00:{10 * k:02d},0.{k},1.2" for k in range(6)]
    header = "time,rotor_speed [rpm],water level [m]"
    Path("scada [2].csv").write_text("\n".join([header, *minutes]))
    options = "--dates day-first --zone Europe/Berlin --water-level-zero -1.8" + structure
    words = ["new", "my tower.csv", "-o", "mine", "--scada", "scada [2].csv", *options.split()]
    monkeypatch.setattr(sys, "argv", ["pilewatch", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    (line,) = (each for each in capsys.readouterr().out.splitlines() if "start from it:" in each)
    monkeypatch.setattr(sys, "argv", shlex.split(line.partition("start from it:")[2]))
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    first, again = (
        [each for each in read_messages(path) if isinstance(each, ScadaSample)]
        for path in (Path("mine/recordings/my-tower.mcap"), Path("mine-2/recordings/my-tower.mcap"))
    )
    assert len(first) > 6
    assert list(map(repr, again)) == list(map(repr, first))
    scenarios = [Path(each, "scenario.toml").read_text() for each in ("mine", "mine-2")]
    assert scenarios[0] == scenarios[1]


def test_an_unknown_unit_is_named(
    nameless: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    header = "z20-fa [furlong],z40-fa [furlong]"
    np.savetxt("two.csv", np.loadtxt("two.csv", delimiter=",", skiprows=1), header=header,
               delimiter=",", comments="")  # fmt: skip
    assert call("new two.csv -o mine --sampling-rate 20", monkeypatch) == 0
    assert "the unit 'furlong' of z20-fa, z40-fa is not known" in caplog.text


def test_a_time_under_another_name_is_left_out_where_the_rate_is_stated(
    nameless: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    samples = np.loadtxt("two.csv", delimiter=",", skiprows=1)
    table = np.column_stack([np.arange(400) / 20, samples])
    np.savetxt("two.csv", table, delimiter=",", header="Punkt,ch1,ch2", comments="")
    assert call("new two.csv -o mine", monkeypatch) == 2
    assert "--sampling-rate HZ leaves it out" in capsys.readouterr().err
    assert call("new two.csv -o mine --sampling-rate 20", monkeypatch) == 0
    assert recording_info(Path("mine/recordings/two.mcap")).layouts[0].channel_names == (
        "ch1",
        "ch2",
    )
    call("identify two.csv --sampling-rate 20", monkeypatch)
    assert "no mode was identified" in capsys.readouterr().err  # it was read: of noise
    assert call("import two.csv --template", monkeypatch) == 0
    printed = capsys.readouterr().out
    assert 'name = "ch1"' in printed
    assert 'name = "Punkt"' not in printed


def test_info_of_measured_samples_states_neither_a_structure_nor_a_simulations_duration(
    nameless: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call("import two.csv --template", monkeypatch) == 0
    layout = capsys.readouterr().out.replace("elevation = 0.0", "elevation = 20.0")
    Path("layout.toml").write_text(layout)
    rate = "--sampling-rate 20 --layout layout.toml"
    assert call(f"import two.csv -o modes.mcap {rate}", monkeypatch) == 0
    assert call(f"import two.csv -o tower.mcap {rate} --scenario parked", monkeypatch) == 0
    capsys.readouterr()
    assert call("info modes.mcap", monkeypatch) == 0
    printed = capsys.readouterr().out
    assert "scenario.structure = none" in printed
    assert "scenario.duration" not in printed
    assert call("info tower.mcap", monkeypatch) == 0
    printed = capsys.readouterr().out
    assert "scenario.structure = exact" in printed
    assert "scenario.duration" not in printed


def test_the_levels_of_a_described_structure_are_printed(
    nameless: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "40")  # a pipe's lines are not folded
    described = nameless / "mine.toml"
    described.write_text(turbine_text("iea15mw_monopile"))
    monkeypatch.setattr(sys.modules["pipeline.cli.new"], "_drawn", lambda _: [described])
    assert call("new two.csv --sampling-rate 20 -o mine", monkeypatch) == 0
    printed = capsys.readouterr().out
    assert "Structure: springs at -30 m, water to 0 m, tower top at 145 m" in printed
    assert "no mass of a pile below (moving_mass)" in printed
    assert "mine.toml" in printed.splitlines()[-2]


@pytest.mark.parametrize(
    ("option", "mean", "is_warned"),
    [("", "2.50 m", True), ("--water-level-zero -2.4", "0.10 m", False)],
)
def test_a_water_level_from_another_zero_is_warned_of(
    option: str,
    mean: str,
    is_warned: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = np.random.default_rng(4).standard_normal((1500, 2))
    begin = np.datetime64("2025-07-03T14:00:00")
    stamps = begin + (np.arange(1500) * 200).astype("timedelta64[ms]")
    lines = [f"{t},{a:.5f},{b:.5f},2.5" for t, (a, b) in zip(stamps, rows, strict=True)]
    text = "\n".join(["time,LAT097_FA [m/s2],LAT050_SS [m/s2],Tide [m]", *lines])
    Path("t1.csv").write_text(text)
    assert call(f"new t1.csv -o mine {option}", monkeypatch) == 0
    printed = capsys.readouterr().out
    assert f"above the description's still water (0 m): mean {mean}, {mean} to {mean}" in printed
    assert ("warning: tides average out" in printed) is is_warned
    assert ("--water-level-zero METRES" in printed) is is_warned


@pytest.mark.parametrize(
    ("axes", "asked"),
    [
        (("X", "Y", "X", "Y"), ""),
        (("X", "X", "Y", "X"), "24m_X_0 and 24m_X_1 point along one axis: where they do not"),
        (("X", "X", "X", "X"), "one axis (so do those of 1 other height): where they do not"),
    ],
)
def test_channels_of_one_height_along_one_axis_are_asked_about(
    axes: tuple[str, ...],
    asked: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    names = [f"{24 if i < 2 else 85}m_{axis}_{i}" for i, axis in enumerate(axes)]
    samples = np.random.default_rng(5).standard_normal((400, 4))
    np.savetxt("t1.csv", samples, delimiter=",", header=",".join(names), comments="")
    assert call("new t1.csv -o mine --sampling-rate 20", monkeypatch) == 0
    printed = capsys.readouterr().out
    assert asked in printed
    assert ("along one axis" in printed) is bool(asked)
