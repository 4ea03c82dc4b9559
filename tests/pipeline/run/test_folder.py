"""Files of a session: where they go, and that none is ever overwritten."""

import errno
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pipeline.cli.run import _measured, farm_note
from pipeline.run import folder
from pipeline.run.folder import prepare_folder
from pipeline.run.options import SessionOptions
from pipeline.run.processes import node_command
from pipeline.run.run import run_session, session_outputs
from pipeline.runtime.snapshots import ANSWERS
from pipeline.runtime.snapshots import FOLDER as CHECKPOINTS
from pipeline.sources.recorded_stream import Playback, SourceError
from pipeline.sources.sources import Source, open_source, replayed, simulated
from pipeline.transport.zenoh_bus import hub, peer_of
from pipeline.viewer.outputs.outputs import ConnectedViewer, RrdFile
from sensors.acquisition.blocks import AccelerationBlock
from sensors.errors import InputError

pytestmark = pytest.mark.usefixtures("identified_once")


def test_an_earlier_session_is_set_aside_under_its_date(
    tmp_path: Path, short_recording: Path
) -> None:
    (tmp_path / "session.mcap").write_bytes(b"first")
    (tmp_path / "summary.json").write_text("{}")
    prepare_folder(replayed(short_recording), tmp_path)
    (tmp_path / "session.mcap").write_bytes(b"second")
    prepare_folder(replayed(short_recording), tmp_path)
    kept = sorted(tmp_path.glob("session-*.mcap"))
    assert {path.read_bytes() for path in kept} == {b"first", b"second"}
    assert not (tmp_path / "session.mcap").exists()
    assert len(list(tmp_path.glob("summary-*.json"))) == 1


@pytest.mark.parametrize(
    ("mistake", "complaint"),
    [
        ({"zenoh": hub("tcp/127.0.0.1:99999")}, "invalid port value"),
        ({"metrics": 99_999}, "99999"),
        ({"elsewhere": ("updatings",)}, "--elsewhere updatings: there is no such node"),
        ({"shards": 0, "way": "processes"}, "--shards is 0"),
    ],
)
def test_a_mistake_in_the_options_leaves_an_earlier_session_as_it_was(
    tmp_path: Path, short_recording: Path, mistake: dict[str, Any], complaint: str
) -> None:
    for name in ("session.mcap", "session.rrd", "summary.json"):
        (tmp_path / name).write_text(name)
    (tmp_path / "checkpoints").mkdir()
    options = replace(SessionOptions(out=tmp_path, way="threads"), **mistake)
    with pytest.raises(InputError, match=complaint):
        run_session(replayed(short_recording), options)
    assert {path.name for path in tmp_path.iterdir()} == {
        "session.mcap",
        "session.rrd",
        "summary.json",
        "checkpoints",
        "lock",
    }
    assert (tmp_path / "summary.json").read_text() == "summary.json"


def test_what_a_crash_left_is_set_aside_too(tmp_path: Path, short_recording: Path) -> None:
    (tmp_path / "session.mcap.active").write_bytes(b"cut")
    prepare_folder(replayed(short_recording), tmp_path)
    (kept,) = tmp_path.glob("session-*.mcap.active")
    assert kept.read_bytes() == b"cut"


def test_a_session_that_is_replayed_into_its_own_folder_is_found_again(
    tmp_path: Path, short_recording: Path
) -> None:
    own = tmp_path / "session.mcap"
    own.write_bytes(short_recording.read_bytes())
    source = prepare_folder(replayed(own), tmp_path)
    assert source.recording is not None
    assert source.recording.exists()
    assert source.recording != own


def test_a_replay_begins_with_nothing_that_an_earlier_session_had_seen(
    tmp_path: Path, short_recording: Path
) -> None:
    earlier = {name: tmp_path / name for name in (CHECKPOINTS, ANSWERS)}
    for place in earlier.values():
        place.mkdir()
        (place / "seen").write_text("by an earlier session")
    source = replayed(short_recording).with_playback(Playback(0.0, 3.0))
    run_session(source, SessionOptions(out=tmp_path, way="lock-step", rrd=False))
    for name, place in earlier.items():
        assert not (place / "seen").exists()
        (kept,) = tmp_path.glob(f"{name}-*")
        assert (kept / "seen").exists()


def test_a_summary_that_the_disk_refuses_is_named_and_costs_no_results(
    tmp_path: Path,
    short_recording: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    def full(path: Path, _: bytes) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    monkeypatch.setattr(folder, "written_whole", full)
    source = replayed(short_recording).with_playback(Playback(0.0, 3.0))
    ended = run_session(source, SessionOptions(out=tmp_path, way="lock-step", rrd=False))
    assert not ended.complete
    assert ended.figures["duration_s"] == 3.0
    assert caplog.messages == [f"cannot write {tmp_path / 'summary.json'}: No space left on device"]
    assert [path.name for path in ended.files] == ["session.mcap"]


def test_a_file_in_place_of_the_folder_is_one_line(tmp_path: Path, short_recording: Path) -> None:
    (tmp_path / "out").write_text("")
    with pytest.raises(InputError, match="a folder is needed"):
        prepare_folder(replayed(short_recording), tmp_path / "out")


def test_a_recording_brings_scenario_layout_and_truth(short_recording: Path) -> None:
    source = open_source(f"replay:{short_recording}")
    assert source.scenario.seed == 3
    assert source.scenario.oma.window_duration == 120.0
    assert source.layout.channel_names[0] == "z41-fa"
    assert source.truth is not None
    assert source.truth.k11 == 9.8e9
    assert source.duration == pytest.approx(240.0)


def test_the_same_scenario_simulates_what_was_recorded(short_recording: Path) -> None:
    again = replayed(short_recording)
    first = first_block(simulated(again.scenario))
    recorded = first_block(again)
    assert (first.samples == recorded.samples).all()
    assert first.start_ns == recorded.start_ns


def first_block(source: Source) -> AccelerationBlock:
    return next(each for each in source.messages() if isinstance(each, AccelerationBlock))


@pytest.mark.parametrize("text", ["tape", "live:x", ""])
def test_a_source_that_is_none_is_named(text: str) -> None:
    expected = f"{text!r} is none of replay:FILE, simulate:SCENARIO, live, the address of"
    with pytest.raises(SourceError, match=expected):
        open_source(text)


def test_a_replay_of_nothing_asks_which_recording() -> None:
    with pytest.raises(SourceError, match="which recording"):
        open_source("replay:")


def test_a_node_in_another_process_is_told_the_same(short_recording: Path) -> None:
    source = replayed(short_recording)
    options = SessionOptions(out=Path("o"), rrd=False, view=ConnectedViewer("rerun+http://h/proxy"))
    command = node_command("updating", source, options, peer_of("tcp/127.0.0.1:1"), None)
    assert command[3:] == [
        "node",
        "updating",
        "--tied",
        "--connect",
        "tcp/127.0.0.1:1",
        "--out",
        "o",
        "--recording",
        str(short_recording),
        "--sampler",
        "importance",
        "--view",
        "connect=rerun+http://h/proxy",
        "--no-rrd",
    ]
    live = replace(source, recording=None)
    assert "--scenario" in node_command("updating", live, options, peer_of("tcp/127.0.0.1:1"), None)


def test_pictures_that_grow_with_a_live_run_have_no_index_that_grows_in_memory(
    short_recording: Path,
) -> None:
    for source, indexed in ((open_source("live"), False), (replayed(short_recording), True)):
        outputs = session_outputs(source, SessionOptions(out=Path("o")))
        assert outputs.views == (RrdFile(Path("o/session.rrd"), indexed=indexed),)


def test_a_recording_has_whether_its_live_session_began_with_nothing(
    tmp_path: Path, short_recording: Path
) -> None:
    live, fresh = open_source("live", "parked"), SessionOptions(out=tmp_path, fresh=True)
    assert session_outputs(live, fresh, epoch=2).metadata["run"] == {"epoch": "2", "fresh": "yes"}
    goes_on = replace(fresh, fresh=False)
    assert session_outputs(live, goes_on, epoch=2).metadata["run"] == {"epoch": "2"}
    tied = session_outputs(live, goes_on, fresh=True)  # as a node process has it from the lock
    assert tied.metadata["run"]["fresh"] == "yes"
    assert "fresh" not in session_outputs(replayed(short_recording), fresh).metadata["run"]


def test_measured_time_is_printed_with_its_span_where_they_differ() -> None:
    assert _measured({"measured_s": 1200.2, "duration_s": 1200.4}) == "1200 s of measurements"
    over = "1200 s of measurements over 2419800 s"
    assert _measured({"measured_s": 1200.0, "duration_s": 2419800.0}) == over


def test_one_turbines_results_are_not_taken_for_the_farms() -> None:
    note = "These are the results of t1, one of 3 turbines; all of them: pilewatch"
    turbines = ("t1", "t2", "t3")
    assert farm_note(turbines, "t1", Path("shore"), pooled=True) == f"{note} farm shore"
    modes_only = farm_note(turbines, "t1", Path("shore"), pooled=False)
    assert modes_only == f"{note} report shore"  # a farm without a posterior pools nothing


def test_files_of_one_second_are_set_aside_under_numbers(tmp_path: Path) -> None:
    names = []
    for _ in range(3):
        file = tmp_path / "session.mcap"
        file.write_text("x")
        os.utime(file, (1_700_000_000, 1_700_000_000))
        names.append(folder.set_aside(file).name)
    when = "session-20231114T221320Z"
    assert names == [f"{when}.mcap", f"{when}-2.mcap", f"{when}-3.mcap"]


def test_a_node_gets_the_scenario_that_its_run_names(tmp_path: Path) -> None:
    source = replayed(Path("recordings/parked.mcap"))
    options, bus = SessionOptions(out=tmp_path, rrd=False), peer_of("tcp/127.0.0.1:1")
    named = node_command("updating", source, options, bus, "own.toml")
    assert named[named.index("--scenario") + 1] == "own.toml"
    assert "--scenario" not in node_command("updating", source, options, bus, None)


def test_a_figure_that_is_no_number_is_not_written_as_json_has_none(tmp_path: Path) -> None:
    path = tmp_path / "summary.json"
    with pytest.raises(ValueError, match="JSON compliant"):
        folder.write_summary(path, {"std": float("nan")})
    assert not path.exists()
