"""A source states its structure, or there is none; a recording brings the files it names."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.messages import Message
from pipeline.recording.info import recording_info
from pipeline.recording.reader import read_messages
from pipeline.recording.writer import whole_recording
from pipeline.run.options import SessionOptions
from pipeline.run.processes import node_command
from pipeline.run.run import run_session
from pipeline.scenario import (
    ScenarioError,
    load_scenario,
    scenario_from_metadata,
    scenario_metadata,
)
from pipeline.sources.feed_publisher import feed_source
from pipeline.sources.import_files import open_measurement, record_measurement
from pipeline.sources.recorded_source import source_of
from pipeline.sources.sources import (
    SourceError,
    open_source,
    record_simulation,
    replayed,
    simulated,
)
from pipeline.transport.zenoh_bus import peer_of
from sensors.errors import InputError
from sensors.structure.description import load_turbine, shipped_text
from tests.pipeline.example_messages import LAYOUT, block
from tests.pipeline.report.example_session import recorded

OWN = """
[turbine]
id = "own"
description = "own-tower.toml"
[simulation]
duration = 3.0
structure = "other-mesh.toml"
"""


@pytest.fixture
def own_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A recording of a turbine that a user described, and an empty folder to work in."""
    home, elsewhere = tmp_path / "home", tmp_path / "elsewhere"
    home.mkdir()
    elsewhere.mkdir()
    monkeypatch.chdir(home)
    text = shipped_text("iea15mw_monopile")
    Path("own-tower.toml").write_text(text.replace("thickness = 0.0", "thickness = 0.1", 1))
    Path("other-mesh.toml").write_text(text)
    Path("own.toml").write_text(OWN)
    record_simulation(simulated(load_scenario("own.toml")), tmp_path / "own.mcap")
    monkeypatch.chdir(elsewhere)
    return tmp_path / "own.mcap"


def test_a_recording_of_an_own_turbine_brings_its_description(own_recording: Path) -> None:
    described = load_turbine(own_recording.parent / "home" / "own-tower.toml")
    source = replayed(own_recording)
    assert source.scenario.structure == described
    again = scenario_from_metadata(scenario_metadata(source.scenario), "a recording of the replay")
    assert again.structure == described
    stored = json.loads(recording_info(own_recording).metadata["scenario"]["files"])
    assert set(stored) == {"own-tower.toml", "other-mesh.toml"}


@pytest.mark.nightly
def test_a_recording_of_an_own_turbine_runs_in_an_empty_folder(own_recording: Path) -> None:
    out = Path("out")
    run_session(replayed(own_recording), SessionOptions(out=out, way="lock-step", rrd=False))
    again = replayed(out / "session.mcap").scenario.structure
    assert again == replayed(own_recording).scenario.structure


def test_a_recording_of_a_shipped_turbine_stores_no_files() -> None:
    assert "files" not in scenario_metadata(load_scenario("parked"))


def test_a_scenario_beside_a_simulated_one_is_refused() -> None:
    with pytest.raises(SourceError, match="tide and --source simulate:parked name two scenarios"):
        open_source("simulate:parked", "tide")
    assert open_source("simulate:parked", "parked").scenario.name == "parked"
    assert open_source("simulate", "tide").scenario.name == "tide"


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("simulate:", "which scenario?"),
        ("simulate", "which scenario?"),
        ("replay:", "which recording?"),
        ("replay", "which recording?"),
        ("live:", "is none of"),
        ("mqtt:", "the address of an instrument"),
    ],
)
def test_a_source_without_its_name_is_refused(text: str, complaint: str) -> None:
    with pytest.raises(SourceError, match=complaint.replace("?", r"\?")):
        open_source(text)


def test_turbines_are_a_recordings_or_the_scenarios() -> None:
    scenario = open_source("simulate", "farm")
    assert len(scenario.turbines) == scenario.scenario.farm.turbines > 1
    assert replace(scenario, layouts={"a": LAYOUT, "b": LAYOUT}).turbines == ("a", "b")


def test_a_live_source_without_a_scenario_has_no_structure(
    caplog: pytest.LogCaptureFixture,
) -> None:
    assert not open_source("live").scenario.has_structure
    assert "no structure is given: modes are tracked" in caplog.text
    assert open_source("live", "parked").scenario.has_structure
    assert load_scenario(open_source("live").scenario.origin).turbine.description == "none"


def layout_file(path: Path, unit: str, *places: tuple[str, float]) -> Path:
    channels = (
        f'[[channels]]\nname = "{name}"\nelevation = {elevation}\ndirection = [-1, 0, 0]\n'
        for name, elevation in places
    )
    path.write_text(f'turbine = "t1"\nunit = "{unit}"\n' + "".join(channels))
    return path


def test_the_layout_files_of_a_live_source_are_joined_by_turbine(tmp_path: Path) -> None:
    top = layout_file(tmp_path / "top.toml", "top", ("x", 145.0))
    low = layout_file(tmp_path / "low.toml", "low", ("x", 41.0))
    live = open_source("live", "parked", (top, low))

    assert live.layout == live.layouts["t1"]
    assert live.layout.channel_names == ("low/x", "top/x")
    assert live.layout.layout_id == "t1-low+t1-top"  # a recording keeps layouts by their names
    assert [each.direction for each in live.layout.channels] == [(-1.0, 0.0, 0.0)] * 2
    assert live.turbines == open_source("live", "parked").turbines  # shards deal alike
    command = node_command("updating", live, SessionOptions(), peer_of("tcp/127.0.0.1:1"), "own")
    assert [command[i + 1] for i, word in enumerate(command) if word == "--layout"] == [
        str(top),
        str(low),
    ]


def test_two_layout_files_of_one_unit_are_one_line(tmp_path: Path) -> None:
    files = [layout_file(tmp_path / f"{n}.toml", "top", ("x", 145.0)) for n in (1, 2)]
    with pytest.raises(SourceError, match="unit top of t1 has a layout already"):
        open_source("live", "parked", files)


def test_a_layout_file_is_for_no_replay(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="not for simulate:parked"):
        open_source("simulate:parked", None, (tmp_path / "top.toml",))


def test_a_feed_without_a_scenario_has_no_structure(tmp_path: Path) -> None:
    layout = tmp_path / "layout.toml"
    layout.write_text('[[channels]]\nname = "a"\nelevation = 9.0\ndirection = [1, 0, 0]\n')
    source = feed_source("udp://127.0.0.1:0", layout, None)
    assert not source.scenario.has_structure
    assert source.scenario.turbine.id == source.layout.turbine


def test_a_recording_without_a_scenario_has_no_structure(
    tmp_path: Path, short_recording: Path, caplog: pytest.LogCaptureFixture
) -> None:
    bare = tmp_path / "bare.mcap"
    with whole_recording(bare, metadata={}) as recorder:
        for message in read_messages(short_recording):
            recorder.handle(message)
    source = replayed(bare)
    assert not source.scenario.has_structure
    assert source.scenario.turbine.id == source.layout.turbine
    assert "no structure is given" in caplog.text
    with pytest.raises(InputError, match="has no structural model"):
        _ = source.scenario.structure


@pytest.mark.parametrize("kept", [(LAYOUT,), (block(0), block(1))])
def test_layouts_without_blocks_and_blocks_without_layouts_are_no_source(
    tmp_path: Path, kept: tuple[Message, ...]
) -> None:
    with whole_recording(tmp_path / "half.mcap", metadata={}) as recorder:
        for message in kept:
            recorder.handle(message)
    with pytest.raises(SourceError, match="no acceleration blocks with their layout"):
        source_of(tmp_path, [recording_info(tmp_path / "half.mcap")])


def test_a_recording_lasts_from_its_first_units_start_to_its_last_ones_end(tmp_path: Path) -> None:
    """Two units over two files, of which one begins before the other and ends before it."""
    other = replace(LAYOUT, layout_id="other", unit="nacelle", channels=LAYOUT.channels[:1])
    parts = {"a": ("tower", 10, 13), "b": ("nacelle", 12, 20)}
    infos = []
    for name, (unit, first, last) in parts.items():
        path = recorded(tmp_path / f"{name}.mcap", [LAYOUT, other, *[
            replace(block(number), unit=unit) for number in range(first, last)
        ]])  # fmt: skip
        infos.append(recording_info(path))
    found = source_of(tmp_path, infos)
    assert found.duration == 10.0
    assert set(found.layouts) == {"t1"}


@pytest.mark.parametrize("kind", ["live", "file", "recording"])
def test_the_structure_of_a_measured_turbine_is_never_assumed(kind: str, tmp_path: Path) -> None:
    """The reference turbine is the default of simulations alone."""
    scenario = tmp_path / "mine.toml"
    words = r"mine\.toml does not say which structure is measured, and none is assumed"
    scenario.write_text("[oma]\nhop = 300.0\n")
    with pytest.raises(ScenarioError, match=words):
        _measured(kind, scenario, tmp_path)
    scenario.write_text('[turbine]\ndescription = "none"\n')
    _measured(kind, scenario, tmp_path)


def _measured(kind: str, scenario: Path, folder: Path) -> None:
    if kind == "live":
        open_source("live", str(scenario))
        return
    table = np.random.default_rng(1).standard_normal((80, 2))
    header = "z41-fa [m/s2],z80-fa [m/s2]"
    np.savetxt(folder / "a.csv", table, delimiter=",", header=header, comments="")
    measurement = open_measurement([folder / "a.csv"], sampling_rate=40.0)
    if kind == "file":
        record_measurement(measurement, folder / "a.mcap", scenario=load_scenario(str(scenario)))
        return
    (folder / "a.mcap").unlink(missing_ok=True)
    record_measurement(measurement, folder / "a.mcap")
    replayed(folder / "a.mcap", str(scenario))
