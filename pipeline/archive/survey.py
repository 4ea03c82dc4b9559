"""What every file of an archive holds, without its samples: the first look at each of them.

file ─► fingerprint of its bytes
     ─► parts: one a session of an acquisition unit, by turbine
"""

import glob
import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.messages import StreamGap
from pipeline.recording.info import RecordingInfo, UnitInfo, recording_info
from sensors.acquisition.layout import SensorLayout
from sensors.errors import InputError

PIECE = 2**20  # that is read of a file at a time for its fingerprint [bytes]


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
    info = recording_info(path)
    fingerprint = fingerprint_of(path)
    parts = [_part(info, unit, fingerprint) for unit in info.units]
    return FileSurvey(
        path=path,
        fingerprint=fingerprint,
        parts=tuple(sorted(parts, key=lambda part: (part.start_ns, part.turbine, part.unit))),
        layouts=info.layouts,
        scenario=tuple(sorted(info.metadata.get("scenario", {}).items())),
    )


def fingerprint_of(path: Path) -> str:
    """BLAKE2b of a file's bytes, 32 hexadecimal digits."""
    digest = hashlib.blake2b(digest_size=16)
    with path.open("rb") as file:
        while piece := file.read(PIECE):
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
