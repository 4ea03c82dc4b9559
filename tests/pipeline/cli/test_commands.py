"""The commands as a person meets them, in a folder of their own."""

import errno
import json
import logging
import os
import socket
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from pipeline.cli import ConsoleHandler, main
from pipeline.transport.zenoh_bus import ZenohBus, free_endpoint, hub
from sensors.structure.description import shipped_text

pytestmark = pytest.mark.usefixtures("identified_once")


@dataclass(frozen=True)
class Finished:
    """What a command left behind."""

    returncode: int
    stdout: str
    stderr: str


Command = Callable[..., Finished]


@pytest.fixture
def pilewatch(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Command:
    """Run `pilewatch ARGUMENTS…` in an empty folder; in this process, for a start takes seconds."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")

    def run(*arguments: str) -> Finished:
        monkeypatch.setattr(sys, "argv", ["pilewatch", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        return Finished(int(ended.value.code or 0), printed.out, printed.err)

    return run


def one_line(finished: Finished) -> str:
    """The complaint of a command that was given something wrong."""
    assert finished.returncode == 2, finished.stderr
    assert "Traceback" not in finished.stderr
    lines = [line for line in finished.stderr.splitlines() if line.strip()]
    assert len(lines) == 1, finished.stderr
    return lines[0]


def two_masses_csv(folder: Path, *, rate: float = 50.0) -> Path:
    """Two modes under white noise, 1.9 and 5.0 Hz at 1 % damping, as a text file with units."""
    generator = np.random.default_rng(5)
    t = np.arange(0, 300, 1 / rate)
    channels = np.zeros((len(t), 2))
    for frequency, shape in ((1.9, (0.6, 1.0)), (5.0, (1.0, -0.6))):
        pole = np.exp(2 * np.pi * frequency / rate * (-0.01 + 1j))
        recursion = [1.0, -2 * pole.real, abs(pole) ** 2]
        channels += np.outer(lfilter([1.0], recursion, generator.standard_normal(len(t))), shape)
    channels += 0.02 * channels.std() * generator.standard_normal(channels.shape)
    path = folder / "two_masses.csv"
    header = "time [s],low [g],high [g]"
    np.savetxt(path, np.column_stack([t, channels]), delimiter=",", header=header, comments="")
    return path


def test_identify_draws_the_stabilisation_diagram_of_the_first_window(
    pilewatch: Command, tmp_path: Path
) -> None:
    pytest.importorskip("matplotlib")
    file = str(two_masses_csv(tmp_path))
    drawn = pilewatch("identify", file, "--window", "150", "--plot", "diagram.png")
    assert drawn.returncode == 0, drawn.stderr
    assert "two_masses.csv, window 1" in drawn.stderr
    assert (tmp_path / "diagram.png").read_bytes().startswith(b"\x89PNG")
    wrong = pilewatch("identify", file, "--window", "150", "--plot", "diagram.word")
    assert "cannot write the figure diagram.word" in one_line(wrong)


def test_identify_prints_the_modes_of_a_text_file(pilewatch: Command, tmp_path: Path) -> None:
    found = pilewatch("identify", str(two_masses_csv(tmp_path)), "--json")
    assert found.returncode == 0, found.stderr
    figures = json.loads(found.stdout)
    frequencies = [mode["frequency_hz"] for mode in figures["modes"]]
    np.testing.assert_allclose(frequencies, [1.9, 5.0], rtol=0.01)
    assert figures["windows"] == {"identified": 1, "rejected": []}
    assert figures["sampling_rate_hz"] == pytest.approx(50.0)


def test_identify_in_windows_counts_them(pilewatch: Command, tmp_path: Path) -> None:
    path = two_masses_csv(tmp_path)
    figures = json.loads(pilewatch("identify", str(path), "--window", "100", "--json").stdout)
    assert figures["windows"]["identified"] == 3
    assert {mode["seen_in_windows"] for mode in figures["modes"]} == {3}


def test_identify_lists_what_it_refused_and_why(pilewatch: Command, tmp_path: Path) -> None:
    file = str(two_masses_csv(tmp_path))
    figures = json.loads(pilewatch("identify", file, "--window", "60", "--why", "--json").stdout)
    assert figures["refused"]
    for each in figures["refused"]:
        assert each["code"]
        assert each["reason"]
        assert 0 < each["frequency_hz"] < 25
    listed = pilewatch("identify", file, "--window", "60", "--why")
    assert "Candidates that are no modes" in listed.stdout
    assert "refused" not in json.loads(pilewatch("identify", file, "--json").stdout)


def test_identify_takes_a_rotors_harmonics_off_by_a_column_or_an_option(
    pilewatch: Command, tmp_path: Path
) -> None:
    path = two_masses_csv(tmp_path)
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    speed = 40 * (1 + 0.01 * np.sin(2 * np.pi * table[:, 0] / 70))  # 3P at 2 Hz [rpm]
    angle = 2 * np.pi * np.cumsum(speed / 60) / 50.0
    table[:, 1:] += np.outer(5 * table[:, 2].std() * np.cos(3 * angle), [0.5, 1.0])
    header = "time [s],low [g],high [g],rotor speed [rpm]"
    columns = np.column_stack([table, speed])
    np.savetxt(path, columns, delimiter=",", header=header, comments="")
    figures = json.loads(pilewatch("identify", str(path), "--json").stdout)
    assert figures["channels"] == ["low", "high"]
    frequencies = [mode["frequency_hz"] for mode in figures["modes"]]
    np.testing.assert_allclose(frequencies, [1.9, 5.0], rtol=0.01)

    header = "time [s],low [g],high [g]"
    np.savetxt(path, table, delimiter=",", header=header, comments="")
    unknown = json.loads(pilewatch("identify", str(path), "--json").stdout)
    assert any(abs(mode["frequency_hz"] - 2.0) < 0.02 for mode in unknown["modes"])
    given = json.loads(pilewatch("identify", str(path), "--rotor-speed", "40", "--json").stdout)
    assert not any(abs(mode["frequency_hz"] - 2.0) < 0.02 for mode in given["modes"])
    wrong = pilewatch("identify", str(path), "--rotor-speed", "-3")
    assert "--rotor-speed is -3 rpm" in one_line(wrong)


def test_modes_lists_table_1_first(pilewatch: Command) -> None:
    figures = json.loads(pilewatch("modes", "--json").stdout)["modes"]
    assert [mode["name"] for mode in figures[:11]] == [str(i) for i in range(1, 12)]
    assert [mode["direction"] for mode in figures[:5]] == ["SS", "FA", "FA", "SS", "FA"]
    for mode in figures[:11]:
        assert mode["frequency_hz"] == pytest.approx(mode["table1_hz"], rel=0.025)
    for mode in figures[:2]:
        assert mode["frequency_hz"] == pytest.approx(mode["table1_hz"], rel=0.002)
    assert all(mode["table1_hz"] is None for mode in figures[11:])
    assert all(len(mode["shape"]) == 8 for mode in figures)


def test_info_lists_what_a_recording_holds(pilewatch: Command, short_recording: Path) -> None:
    result = pilewatch("info", str(short_recording))
    assert result.returncode == 0
    truth = "truth.k11 = 9800000000.0"
    for word in ("AccelerationBlock", "240", "none", "scenario.duration = ", truth):
        assert word in result.stdout


def test_a_sessions_folder_stands_for_its_only_recording(
    pilewatch: Command, short_recording: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "session.mcap").write_bytes(short_recording.read_bytes())
    assert pilewatch("info", "out").stdout == pilewatch("info", "out/session.mcap").stdout
    (folder / "session.part2.mcap").write_bytes(short_recording.read_bytes())
    assert "out has 2 recordings; name one of session.mcap" in one_line(pilewatch("info", "out"))


def test_a_mistake_ends_the_process_with_code_2_and_no_traceback(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pipeline", "run"]
    finished = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert finished.returncode == 2
    assert finished.stderr.startswith("pilewatch: there is no recordings/parked.mcap")
    assert "Traceback" not in finished.stderr


def test_help_teaches_every_command(pilewatch: Command) -> None:
    overview = pilewatch("--help").stdout
    for command in ("run", "simulate", "identify", "modes", "node", "info"):
        assert command in overview
        assert pilewatch(command, "--help").returncode == 0


def test_run_without_a_recording_explains_how_to_make_one(pilewatch: Command) -> None:
    complaint = one_line(pilewatch("run"))
    assert "recordings/parked.mcap" in complaint
    assert "pilewatch simulate parked -o recordings/parked.mcap" in complaint


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("run", "--source", "replay:gone.mcap"), "gone.mcap"),
        (("run", "--source", "radio"), "'radio' is none of replay:FILE"),
        (("run", "--scenario", "storm", "--source", "simulate:"), "'storm' is neither a file"),
        (("run", "--speed", "fast", "--source", "live"), "--speed fast"),
        (("run", "--view", "hologram", "--source", "live"), "hologram"),
        (("run", "--processes", "--lock-step"), "exclude each other"),
        (("run", "--source", "live", "--sampler", "dice"), "'dice' is not one of 'importance'"),
        (("modes", "--theta", "1,1"), "three numbers are needed"),
        (("modes", "--theta", "1,0.25,4"), "k11·k22 must exceed k12²"),
        (("modes", "--theta", "0,0,0"), "k11 and k22 must be above 0"),
        (("modes", "--theta"), "requires an argument"),
        (("control", "seek", "soon"), "a valid number"),
        (("certificates",), "Missing argument 'folder'; `pilewatch certificates --help`"),
        (("cook",), "No such command 'cook'"),
        (("salvage", ""), "is a folder; give the recording in it"),
        (("describe", "--plot", "."), "cannot write the figure ."),
        (("identify", "a.csv", "--highest-frequency", "nan"), "--highest-frequency is nan Hz"),
        (("identify", "a.csv", "--plot", "gone/a.png"), "the folder gone does not exist"),
        (("modes", "--sign", "up"), "'up' is not one of 'published', 'embedded-pile'"),
        (("modes", "--structure", "gone.toml"), "gone.toml"),
        (("identify", "gone.csv"), "gone.csv"),
        (("node", "cook", "--connect", "tcp/127.0.0.1:1"), "'cook' is not one of 'identification'"),
    ],
)
def test_a_mistake_gives_one_line(
    pilewatch: Command, arguments: tuple[str, ...], complaint: str
) -> None:
    assert complaint in one_line(pilewatch(*arguments))


@pytest.mark.parametrize(
    ("text", "arguments", "complaint"),
    [
        ("a,b\n1,oops\n2,3\n", (), "'oops' in line 2"),
        ("a,b\nnan,nan\nnan,nan\n", (), "only NaN"),
        ("a,b\n1,2\n", ("--sampling-rate", "10"), "1 sample; at least two"),
        ("a,b\n1,2\n3,4\n", (), "give --sampling-rate HZ"),
        ("a,b\n1,2\n3,4\n", ("--sampling-rate", "-5"), "-5 Hz; it must be positive"),
        ("t,a\n0,2\n1,4\n", ("--window", "60"), "--window 60 s does not fit"),
        ("t,a\n0,2\n.01,4\n", ("--window", "60"), "--window 60 s does not fit"),
    ],
)
def test_a_broken_text_file_gives_one_line(
    pilewatch: Command, tmp_path: Path, text: str, arguments: tuple[str, ...], complaint: str
) -> None:
    (tmp_path / "broken.csv").write_text(text)
    assert complaint in one_line(pilewatch("identify", "broken.csv", *arguments))


def test_a_sampling_rate_too_low_for_the_modes_sought_gives_one_line(
    pilewatch: Command, tmp_path: Path
) -> None:
    path = str(two_masses_csv(tmp_path, rate=20.0))
    complaint = one_line(pilewatch("identify", path, "--highest-frequency", "12"))
    assert "12 Hz" in complaint
    assert "20 Hz" in complaint


def test_a_cut_recording_gives_one_line(
    pilewatch: Command, tmp_path: Path, short_recording: Path
) -> None:
    whole = short_recording.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    assert "cut off before its end" in one_line(pilewatch("run", "--source", "replay:cut.mcap"))
    assert "cut off before its end" in one_line(pilewatch("info", "cut.mcap"))


def test_an_unknown_scenario_key_is_named_with_its_section(
    pilewatch: Command, tmp_path: Path
) -> None:
    (tmp_path / "mine.toml").write_text("[oma]\nwindow_duratoin = 600\n")
    complaint = one_line(pilewatch("simulate", "mine.toml", "-o", "mine.mcap"))
    assert "mine.toml [oma]: unknown key 'window_duratoin'" in complaint
    assert "did you mean 'window_duration'" in complaint


def test_a_negative_thickness_is_named(pilewatch: Command, tmp_path: Path) -> None:
    text = shipped_text("iea15mw_monopile")
    thickness = next(line for line in text.splitlines() if "thickness" in line)
    broken = text.replace(thickness, thickness.replace("thickness = ", "thickness = -"), 1)
    assert broken != text
    (tmp_path / "thin.toml").write_text(broken)
    complaint = one_line(pilewatch("modes", "--structure", "thin.toml"))
    assert "thin.toml" in complaint
    assert "thickness" in complaint


def test_a_port_in_use_gives_one_line(pilewatch: Command, short_recording: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        source = f"replay:{short_recording}"
        complaint = one_line(pilewatch("run", "--source", source, "--listen", endpoint))
    assert f"cannot listen on {endpoint}: the port is in use" in complaint


def test_a_recording_is_never_overwritten(pilewatch: Command, short_recording: Path) -> None:
    before = short_recording.read_bytes()
    complaint = one_line(
        pilewatch("simulate", "parked", "-o", str(short_recording), "--duration", "10")
    )
    assert "exists already" in complaint
    assert short_recording.read_bytes() == before


def test_describe_prints_a_template_that_it_reads_again(pilewatch: Command) -> None:
    template = pilewatch("describe", "--template")
    Path("mine.toml").write_text(template.stdout, encoding="utf-8")
    described = pilewatch("describe", "mine.toml", "--json")
    assert described.returncode == 0
    assert json.loads(described.stdout)["modes"][0]["frequency_hz"] == pytest.approx(0.1573, 1e-3)


def test_describe_names_the_key_that_is_wrong(pilewatch: Command) -> None:
    text = shipped_text("iea15mw_monopile").replace("overhang", "overhung")
    Path("mine.toml").write_text(text, encoding="utf-8")
    refused = pilewatch("describe", "mine.toml")
    assert refused.returncode == 2
    assert "mine.toml" in refused.stderr
    assert "overhung" in refused.stderr
    assert refused.stderr.count("\n") == 1


def test_a_name_that_no_file_can_have_is_one_line(pilewatch: Command) -> None:
    name = "x" * 300
    for command in (
        ("run", "--source", f"replay:{name}"),
        ("publish", "--source", f"replay:{name}"),
        ("node", "recorder", "--recording", name),
    ):
        assert "File name too long" in one_line(pilewatch(*command))


def test_a_folder_that_is_a_file_is_one_line_for_a_node_too(
    pilewatch: Command, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("x")
    with closing(ZenohBus(hub(endpoint := free_endpoint()))):
        result = pilewatch("node", "recorder", "--connect", endpoint, "--out", "file")
    assert "--out file: File exists; a folder is needed" in one_line(result)


def test_a_client_that_knows_no_router_is_one_line(pilewatch: Command) -> None:
    assert "--connect ENDPOINT" in one_line(pilewatch("node", "recorder", "--mode", "client"))


def test_a_port_in_use_is_reported_before_a_file_is_started(
    pilewatch: Command, tmp_path: Path
) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        endpoint = f"tcp/127.0.0.1:{other.getsockname()[1]}"
        assert "the port is in use" in one_line(
            pilewatch("run", "--source", "live", "--listen", endpoint)
        )
    assert not list((tmp_path / "out").glob("session.mcap*"))


def test_what_the_disk_refuses_is_one_line_whatever_the_command(
    pilewatch: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "some/file")

    monkeypatch.setattr("pipeline.recording.info.recording_info", full)
    assert one_line(pilewatch("info", "x.mcap")) == (
        "pilewatch: some/file: No space left on device"
    )


def test_a_number_that_is_no_port_is_one_line_as_it_was_given(pilewatch: Command) -> None:
    for port in ("99999999", "-1"):
        result = pilewatch("run", "--source", "live", "--metrics", port)
        assert one_line(result).startswith(f"pilewatch: --metrics is {port}; a port is 0")


def test_shares_of_a_farm_need_processes_of_their_own(pilewatch: Command) -> None:
    result = pilewatch("run", "--source", "live", "--shards", "4")
    assert "--shards 4 needs --processes" in one_line(result)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (("youngs_modulus = 210e9", "youngs_modulus = 210"), "youngs_modulus is 210; steel has"),
        (("density = 8500.0", "density = 8.5"), "density is 8.5; steel has 7850 kg/m³"),
        (("level = 0.0", "level = 500.0"), "level is 500 m; the tower ends at 145 m"),
    ],
)
def test_figures_in_other_units_are_reported_with_their_place(
    pilewatch: Command, change: tuple[str, str], complaint: str
) -> None:
    marked = "\ufeff" + pilewatch("describe", "--template").stdout  # as Windows' editors save it
    Path("own.toml").write_text(marked.replace(*change), "utf-8")
    assert complaint in one_line(pilewatch("describe", "own.toml"))


def test_the_version_is_printed(pilewatch: Command) -> None:
    printed = pilewatch("--version")
    assert printed.returncode == 0
    assert printed.stdout.startswith("pilewatch ")


@pytest.mark.parametrize(
    ("options", "level"),
    [((), "WARNING"), (("-v",), "INFO"), (("-vv",), "DEBUG"), (("-q",), "ERROR")],
)
def test_options_before_the_command_set_the_level_of_the_log(
    pilewatch: Command, options: tuple[str, ...], level: str
) -> None:
    root = logging.getLogger()
    before = root.level
    try:
        assert pilewatch(*options, "simulate", "--list").returncode == 0
        assert logging.getLevelName(root.level) == level
    finally:
        root.setLevel(before)


def test_a_log_line_is_not_folded(capsys: pytest.CaptureFixture[str]) -> None:
    text = "unit tower [s1]: " + 40 * "word "
    record = logging.LogRecord("x", logging.WARNING, "", 1, text, (), None)
    ConsoleHandler().emit(record)
    assert capsys.readouterr().err == f"warning: {text}\n"


def test_info_as_json_has_channels_and_units(pilewatch: Command, short_recording: Path) -> None:
    listed = json.loads(pilewatch("info", str(short_recording), "--json").stdout)
    assert {"file", "size_bytes", "duration_s", "channels", "units", "nodes"} <= set(listed)
    assert [unit["gaps"] for unit in listed["units"]] == [[]]
    assert listed["units"][0]["sampling_rate_hz"] > 0


@pytest.mark.parametrize(
    ("content", "options"),
    [
        ("nan", ()),
        ("constant", ()),
        ("short", ()),
        ("noise", ("--lowest-frequency", "30")),
    ],
)
def test_a_file_without_modes_is_one_line_with_the_reason(
    pilewatch: Command, tmp_path: Path, content: str, options: tuple[str, ...]
) -> None:
    n = 100 if content == "short" else 6000
    samples = np.random.default_rng(7).standard_normal((n, 2))
    if content == "nan":
        samples[:] = np.nan
    if content == "constant":
        samples[:] = 1.0
    table = np.column_stack([np.arange(n) / 50.0, samples])
    header = "time [s],low [g],high [g]"
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header=header, comments="")
    assert "a.csv" in one_line(pilewatch("identify", "a.csv", *options))
