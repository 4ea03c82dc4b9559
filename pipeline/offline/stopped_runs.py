"""What runs received while their recording had stopped: no recording proves it, summaries do.

    summary.json: recording-stopped ──► blocks that arrived, windows ──► the books of `audit`

Of other runs the recordings are the whole proof, and parts of them may lie elsewhere by now.
"""

import json
import logging
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pipeline.state.books import Books
from pipeline.state.phrases import count_noun
from sensors.json_values import Json

logger = logging.getLogger(__name__)

STOPPED = {"recording-stopped", "recording-resumed"}  # codes of warnings
SUMMARIES = "summary*.json"  # those of earlier sessions, which have their date, among them
_Session = tuple[str, str, str]  # turbine, unit, session


@dataclass(frozen=True, slots=True)
class StoppedRun:
    """What the summary of a run whose recording had stopped counts."""

    path: Path
    """Of the summary."""
    received: dict[_Session, int]
    """Different blocks that arrived."""
    identified: dict[str, int]
    """Windows that were identified, by turbine."""

    def unrecorded_windows(self, books: Books) -> Iterator[str]:
        """Yield in words of which turbines fewer windows are recorded than were identified."""
        recorded = {each["turbine"]: each["identified"] for each in books.as_json()["turbines"]}
        for turbine, identified in self.identified.items():
            there = recorded.get(turbine, 0)
            if there < identified:
                windows = count_noun(identified, "window")
                verb = "was" if identified == 1 else "were"
                yield (
                    f"{turbine}: {windows} {verb} identified ({self.path.name}) and {there} of "
                    "them recorded: recording had stopped"
                )


def stopped_runs(folder: Path) -> Iterator[StoppedRun]:
    """Yield the runs of a folder whose recording had stopped; an unreadable summary is none."""
    for path in sorted(folder.glob(SUMMARIES)):
        try:
            summary = json.loads(path.read_bytes())
            if STOPPED & _codes(summary):
                yield _stopped_run(path, summary["books"])
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            logger.warning("passed over %s: %s", path, error)


def _stopped_run(path: Path, books: Json) -> StoppedRun:
    received: dict[_Session, int] = {}
    for unit in books["units"]:
        key = (str(unit["turbine"]), str(unit["unit"]), str(unit["session"]))
        received[key] = received.get(key, 0) + int(unit["recorded"])
    identified = {str(each["turbine"]): int(each["identified"]) for each in books["turbines"]}
    return StoppedRun(path, received, identified)


def _codes(summary: Json) -> set[str]:
    members = (summary, *summary.get("turbines", ()))
    return {each["code"] for member in members for each in member.get("warnings", ())}
