"""What every file of an archive holds, without its samples: the first look at each of them.

file ─► fingerprint of its bytes
     ─► parts: one a session of an acquisition unit, by turbine

A survey is kept by path, size and time of the last change, so that a file's bytes are hashed once.
Changed content with an unchanged size and an unchanged time (in nanoseconds) is taken for the same:
recordings are written once.
"""

import glob
import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from pipeline.archive.store import (
    FinishedResults,
    StoredFrame,
    frames_of,
    key_of_result,
    messages_in,
)
from pipeline.messages import StreamGap
from pipeline.recording.info import RecordingInfo, UnitInfo, salvageable_info
from pipeline.transport.errors import CodecError
from sensors.acquisition.layout import SensorLayout
from sensors.errors import InputError

SURVEY = "survey"  # kind of a kept survey
HASHED_AT_ONCE = 2**20  # that is read of a file at a time for its fingerprint [bytes]


@dataclass(frozen=True, slots=True)
class Part:
    """One session of one unit within one file."""

    path: Path
    fingerprint: str  # of the whole file
    turbine: str
    unit: str
    session: str
    layout_id: str
    sampling_rate: float  # [Hz]
    n_channels: int
    first_sample: int  # since the session's start
    next_sample: int  # one after the last
    first_sequence: int  # of the blocks
    last_sequence: int
    start_ns: int  # of the first sample
    end_ns: int  # one sample after the last
    gaps: tuple[StreamGap, ...] = ()

    @property
    def n_samples(self) -> int:
        """From the first to the last, missing ones counted."""
        return self.next_sample - self.first_sample


@dataclass(frozen=True, slots=True)
class FileSurvey:
    """What one file holds."""

    path: Path
    fingerprint: str
    parts: tuple[Part, ...]  # in order of time
    layouts: tuple[SensorLayout, ...]
    scenario: tuple[tuple[str, str], ...] = ()  # it was made under, as `scenario_metadata` has it
    damage: str = ""  # what of it cannot be read; "" where all can


def archive_files(patterns: Iterable[str]) -> tuple[Path, ...]:
    """The recordings that patterns, files and folders name, each once, in order of their names.

    Raises InputError for one that names none.
    """
    found: dict[Path, None] = {}
    for pattern in patterns:
        named = _named(pattern)
        if not named:
            raise InputError(
                f"{pattern!r} names no recording; give .mcap files, folders or a pattern in quotes "
                "such as 'archive/**/*.mcap'"
            )
        found |= dict.fromkeys(named)
    return tuple(sorted(found))


def _named(pattern: str) -> list[Path]:
    path = Path(pattern)
    if path.is_file():
        return [path]
    if path.is_dir():
        return sorted(path.rglob("*.mcap"))
    return sorted(Path(each) for each in glob.glob(pattern, recursive=True) if Path(each).is_file())


def surveyed(path: Path) -> FileSurvey:
    """Fingerprint, parts and layouts of a file. Raises RecordingError where it cannot be read."""
    info = salvageable_info(path)
    fingerprint = fingerprint_of(path)
    parts = [_part(info, unit, fingerprint) for unit in info.units]
    return FileSurvey(
        path=path,
        fingerprint=fingerprint,
        parts=tuple(sorted(parts, key=lambda part: (part.start_ns, part.turbine, part.unit))),
        layouts=info.layouts,
        scenario=tuple(sorted(info.metadata.get("scenario", {}).items())),
        damage=info.damage,
    )


def fingerprint_of(path: Path) -> str:
    """BLAKE2b of a file's bytes, 32 hexadecimal digits."""
    digest = hashlib.blake2b(digest_size=16)
    with path.open("rb") as file:
        while piece := file.read(HASHED_AT_ONCE):
            digest.update(piece)
    return digest.hexdigest()


def _part(info: RecordingInfo, unit: UnitInfo, fingerprint: str) -> Part:
    return Part(
        path=info.path,
        fingerprint=fingerprint,
        turbine=unit.turbine,
        unit=unit.unit,
        session=unit.session,
        layout_id=unit.layout_id,
        sampling_rate=unit.sampling_rate,
        n_channels=unit.n_channels,
        first_sample=unit.first_sample,
        next_sample=unit.next_sample,
        first_sequence=unit.first_sequence,
        last_sequence=unit.last_sequence,
        start_ns=unit.start_ns,
        end_ns=unit.end_ns,
        gaps=unit.gaps,
    )


def without_copies(surveys: Sequence[FileSurvey]) -> tuple[list[FileSurvey], list[FileSurvey]]:
    """Files whose bytes no earlier one has, and those that are copies."""
    originals: dict[str, FileSurvey] = {}
    copies = []
    for survey in surveys:
        if survey.fingerprint in originals:
            copies.append(survey)
        else:
            originals[survey.fingerprint] = survey
    return list(originals.values()), copies


_KEPT_FIELDS = tuple(field.name for field in fields(Part) if field.name not in ("path", "gaps"))


class SurveyCache:
    """The surveys of earlier runs among an archive's finished results."""

    def __init__(self, finished: FinishedResults) -> None:
        self._finished = finished

    def get(self, path: Path) -> FileSurvey | None:
        """The survey of a file as it is now; None if there is none."""
        key = _key(path)
        frames = None if key is None else self._finished.get(key)
        if frames is None:
            return None
        try:
            return decoded_survey(path, frames)
        except (CodecError, ValueError, KeyError, TypeError):
            return None  # damaged: the file is read again

    def put(self, path: Path, survey: FileSurvey) -> None:
        """Keep a survey. Raises OSError if the disk is full."""
        key = _key(path)
        if key is not None:
            self._finished.put(key, encoded_survey(survey))


def _key(path: Path) -> str | None:
    try:
        status = path.stat()
    except OSError:
        return None
    return key_of_result(SURVEY, str(path.resolve()), f"{status.st_size} {status.st_mtime_ns}")


def encoded_survey(survey: FileSurvey) -> tuple[StoredFrame, ...]:
    """A survey as it is kept: one table, then the gaps part by part, then the layouts."""
    table = {
        "fingerprint": survey.fingerprint,
        "scenario": survey.scenario,
        "damage": survey.damage,
        "parts": [_part_table(part) for part in survey.parts],
    }
    gaps = [gap for part in survey.parts for gap in part.gaps]
    return ((SURVEY, json.dumps(table).encode()), *frames_of((*gaps, *survey.layouts)))


def _part_table(part: Part) -> dict[str, Any]:
    content = {name: getattr(part, name) for name in _KEPT_FIELDS}
    return {**content, "gaps": len(part.gaps)}


def decoded_survey(path: Path, frames: tuple[StoredFrame, ...]) -> FileSurvey:
    """A survey that was kept. Raises CodecError, ValueError, KeyError, TypeError: it is damaged."""
    kind, content = frames[0]
    if kind != SURVEY:
        raise ValueError(f"{kind!r} is no survey")
    table = json.loads(content)
    messages = list(messages_in(frames[1:]))
    gaps = iter([each for each in messages if isinstance(each, StreamGap)])
    parts = []
    for each in table["parts"]:
        own = tuple(next(gaps) for _ in range(each.pop("gaps")))
        parts.append(Part(path=path, gaps=own, **each))
    layouts = tuple(each for each in messages if isinstance(each, SensorLayout))
    scenario = tuple((str(name), str(text)) for name, text in table["scenario"])
    damage = str(table.get("damage", ""))
    return FileSurvey(path, table["fingerprint"], tuple(parts), layouts, scenario, damage)
