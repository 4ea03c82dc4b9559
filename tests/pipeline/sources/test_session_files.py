"""A folder is read with all that belongs to its session, and what does not is named."""

from dataclasses import replace
from pathlib import Path

import pytest
from pilewatch import open as opened

from pipeline.export.export import export
from pipeline.messages import Message, WindowRejected
from pipeline.offline.audit import audit
from pipeline.report.canvas import PageFigure
from pipeline.report.page import page
from pipeline.report.recorded_session import read_session
from pipeline.sources.session_files import earlier_sessions, one_recording, session_files
from tests.pipeline.example_messages import LAYOUT, block, rejection
from tests.pipeline.report.example_session import estimate, event, posterior, recorded

FIRST, SECOND = "session-20260301T000000Z.mcap", "session-20260302T000000Z.mcap"


def start(
    path: Path, epoch: int, windows: range, *, source: str = "live", fresh: bool = False
) -> Path:
    """A start of a session that recorded these windows of six blocks each."""
    blocks = [block(number) for number in range(6 * windows.start, 6 * windows.stop)]
    answers: list[Message] = [each for n in windows for each in (estimate(n), posterior(n))]
    run = {"epoch": str(epoch)} | ({"fresh": "yes"} if fresh else {})
    made = {"version": "0.1.0", "source": source}
    return recorded(path, [LAYOUT, *blocks, *answers], pilewatch=made, run=run)


@pytest.fixture(autouse=True)
def figures_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are drawn; how they become SVG is the same for all recordings."""
    monkeypatch.setattr(PageFigure, "svg", lambda _: "<svg></svg>")


@pytest.fixture
def restarted(tmp_path: Path) -> Path:
    """A live session that was started three times; each start identifies a window again."""
    out = tmp_path / "out"
    out.mkdir()
    start(out / FIRST, 1, range(3))
    start(out / SECOND, 2, range(2, 6))
    start(out / "session.mcap", 3, range(5, 8))
    return out


def test_export_report_open_and_audit_of_a_session_that_was_started_again_agree(
    restarted: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    windows = list(range(8))
    assert [file.name for file in session_files(restarted)] == [FIRST, SECOND, "session.mcap"]
    session = opened(restarted)
    assert [each.window for each in session.modes.estimates] == windows
    assert [each.message.window for each in session.posteriors] == windows
    state = read_session(restarted).turbines[0].state
    assert (state.n_identified, state.published) == (8, 48)
    rows = {each.path.stem: each.rows for each in export(restarted, tmp_path / "csv", "csv")}
    assert rows["modes"] == 8 * len(estimate(0).modes)
    assert rows["samples-t1-tower"] == 48 * len(block(0).samples)
    (turbine,) = audit(restarted).as_json()["turbines"]
    assert turbine["identified"] == 8
    assert not caplog.messages
    assert "earlier recording" not in page(read_session(restarted))


@pytest.mark.parametrize("fresh", [False, True])
def test_other_sessions_of_a_folder_are_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, fresh: bool
) -> None:
    source = "live" if fresh else "replay:february.mcap"
    start(tmp_path / FIRST, 1, range(3), source="live" if fresh else "replay:january.mcap")
    start(tmp_path / "session.mcap", 2, range(2), source=source, fresh=fresh)
    (file,) = session_files(tmp_path)
    assert file.name == "session.mcap"
    line = f"1 earlier recording is not included: {FIRST} (give the file alone)"
    assert caplog.messages == [f"{tmp_path}: {line}"]
    assert line in page(read_session(tmp_path))
    assert [each.name for each in earlier_sessions(tmp_path)] == [FIRST]


def test_a_session_reaches_back_to_its_fresh_start_and_no_further(tmp_path: Path) -> None:
    start(tmp_path / FIRST, 1, range(1))
    start(tmp_path / SECOND, 2, range(1), fresh=True)
    start(tmp_path / "session.mcap", 3, range(1, 2))
    assert [file.name for file in session_files(tmp_path)] == [SECOND, "session.mcap"]


def test_parts_follow_the_starts_numbers_although_thinning_renewed_a_date(tmp_path: Path) -> None:
    names = (
        "session-20260309T000000Z.results.mcap",  # thinned a week later
        "session-20260301T000000Z.part2.mcap",
        "session-20260302T000000Z.mcap",
        "session.mcap",
    )
    for name, epoch in zip(names, (1, 1, 2, 3), strict=True):
        start(tmp_path / name, epoch, range(1))
    assert [file.name for file in session_files(tmp_path)] == list(names)


def test_starts_whose_numbers_began_again_with_the_lock_follow_their_dates(tmp_path: Path) -> None:
    for name, epoch in ((FIRST, 5), (SECOND, 1), ("session.mcap", 2)):
        start(tmp_path / name, epoch, range(1))
    assert [file.name for file in session_files(tmp_path)] == [FIRST, SECOND, "session.mcap"]


def test_what_a_start_gives_again_counts_once(tmp_path: Path) -> None:
    gap = replace(rejection(0), code="gap")
    again: list[Message] = [estimate(0), gap, posterior(0), event(), rejection(9)]
    live = {"source": "live"}
    first: list[Message] = [LAYOUT, estimate(0), posterior(0), event(), rejection(9)]
    recorded(tmp_path / FIRST, first, pilewatch=live, run={"epoch": "1"})
    recorded(tmp_path / "session.mcap", [LAYOUT, *again], pilewatch=live, run={"epoch": "2"})
    session = opened(tmp_path)
    counts = (len(session.modes.estimates), len(session.posteriors), len(session.events))
    assert counts == (1, 1, 1)
    assert [each.window for each in session.modes.rejected] == [9]
    state = read_session(tmp_path).turbines[0].state
    assert (len(state.events), state.n_rejected) == (1, 1)
    assert all(isinstance(each, WindowRejected) for each in state.rejected)


def test_where_one_recording_is_needed_the_latest_start_is_taken_and_the_others_named(
    restarted: Path, caplog: pytest.LogCaptureFixture
) -> None:
    assert one_recording(restarted).name == "session.mcap"
    (line,) = caplog.messages
    assert "session.mcap is used, 2 earlier recordings are not included" in line


def test_a_damaged_earlier_start_ends_the_chain_and_is_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / FIRST).write_bytes(b"no recording")
    start(tmp_path / "session.mcap", 2, range(1))
    assert [file.name for file in session_files(tmp_path)] == ["session.mcap"]
    assert FIRST in caplog.text
