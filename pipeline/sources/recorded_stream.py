"""Messages of sensors and controller as recorded: one file, or a folder as one stream; which part
of it is replayed, and how often.

    files in order of time ─► each block once ─► range ─► again, later ─► source

What is replayed from its middle is a session of its own that begins there, so that its first
window does too; where a unit starts again after that, its blocks keep their numbers. A second round
is one more session, its time going on where the first one ended.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.recording.file_order import logical_starts, stretch_of
from pipeline.recording.info import UnitInfo, recording_info
from pipeline.recording.reader import read_messages
from pipeline.recording.salvage import what_to_do
from pipeline.recording.writer import ACTIVE_SUFFIX
from sensors.acquisition.blocks import NANOSECONDS, RESTART_SILENCE, AccelerationBlock
from sensors.acquisition.boots import BootCounter
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.replayed import LATEST_BLOCKS, ReplayedTower
from sensors.acquisition.scada import ScadaSample
from sensors.errors import InputError
from sensors.intervals import Intervals

READ_ON = RESTART_SILENCE  # behind the end: a block that came later is of another session [s]

SensorMessage = AccelerationBlock | SensorLayout | ScadaSample


@dataclass(frozen=True, slots=True)
class Playback:
    """What of a recording is played. Times count from its first sample."""

    start: float = 0.0
    """Start [s]."""

    end: float = float("inf")
    """End [s]."""

    rounds: int = 1

    def __post_init__(self) -> None:
        if self.start < 0.0:
            raise InputError(
                f"--from {self.start:g} is before the first sample, from which it counts [s]"
            )
        if not self.start < self.end:
            raise InputError(
                f"--from {self.start:g} --to {self.end:g} is no range; both count in seconds from "
                "the first sample, --from below --to"
            )
        if self.rounds < 1:
            raise InputError(f"--loop {self.rounds} plays nothing; at least 1 is needed")

    def duration(self, whole: float) -> float:
        """Return how long is played of a recording of that length, all rounds [s]."""
        return max(0.0, min(self.end, whole) - self.start) * self.rounds

    def of(self, stream: Callable[[], Iterable[SensorMessage]]) -> Iterator[SensorMessage]:
        """Yield the chosen part, as often as chosen. stream: → the recording from its beginning."""
        if self == Playback():
            yield from stream()
            return
        shift_ns = 0
        for number in range(self.rounds):
            first_ns = last_ns = None
            for message in self._part(stream()):
                if isinstance(message, AccelerationBlock):
                    first_ns = message.start_ns if first_ns is None else first_ns
                    last_ns = message.end_ns
                yield _later(message, shift_ns, number)
            if first_ns is None or last_ns is None:
                return
            shift_ns += last_ns - first_ns

    def _part(self, messages: Iterable[SensorMessage]) -> Iterator[SensorMessage]:
        """Yield what lies in the range, the blocks of each boot counted from its first there."""
        origin_ns: int | None = None
        newest: dict[tuple[str, str], int] = {}  # turbine, unit → start of its latest block [ns]
        counts: dict[tuple[str, str, str], _CountsInRange] = {}  # turbine, unit, session
        for message in messages:
            if isinstance(message, AccelerationBlock):
                origin_ns = message.start_ns if origin_ns is None else origin_ns
                newest[message.turbine, message.unit] = message.start_ns
                if self._is_over(newest.values(), origin_ns):
                    return
            if isinstance(message, SensorLayout):
                yield message
            elif origin_ns is not None:
                inside = self._has(message, origin_ns)
                if isinstance(message, AccelerationBlock) and self.start > 0:
                    key = (message.turbine, message.unit, message.session)
                    of_unit = counts.setdefault(key, _CountsInRange())
                    message = of_unit.renumbered(message, is_inside=inside)
                if inside:
                    yield message

    def _is_over(self, newest_ns: Iterable[int], origin_ns: int) -> bool:
        """Whether every unit is so far behind the end that nothing late is to be expected."""
        last_ns = min(newest_ns) - origin_ns
        return last_ns / NANOSECONDS >= self.end + READ_ON

    def _has(self, message: AccelerationBlock | ScadaSample, origin_ns: int) -> bool:
        time_ns = message.time_ns if isinstance(message, ScadaSample) else message.start_ns
        return self.start <= (time_ns - origin_ns) / NANOSECONDS < self.end


class _CountsInRange:
    """Numbers and samples of one unit's blocks under one session's name, counted from the range's
    beginning; of a boot that begins inside, as the unit counted them."""

    def __init__(self) -> None:
        self._boots = BootCounter()
        self._numbers: dict[int, Intervals] = {}  # of each boot's blocks
        self._before: dict[int, tuple[int, int]] = {}  # by boot: blocks and samples, once inside

    def renumbered(self, block: AccelerationBlock, *, is_inside: bool) -> AccelerationBlock:
        """Return a block as it counts in the range; each is asked for, in the stream's order.

        Outside of the range it stays as it is.
        """
        known = self._boots.boot
        repeats = block.sequence in self._numbers.get(known, ())
        boot = self._boots.boot_of(block, repeats=repeats)
        began_before = boot in self._numbers
        self._numbers.setdefault(boot, Intervals()).add(block.sequence)
        if not is_inside:
            return block
        if boot not in self._before:
            found_late = self._boots.also > 0  # its first blocks were counted with the boot before
            counts = (block.sequence, block.first_sample) if began_before else (0, 0)
            self._before[boot] = self._before.get(known, (0, 0)) if found_late else counts
        blocks, samples = self._before[boot]
        if block.sequence < blocks or block.first_sample < samples:
            blocks, samples = self._before[boot] = (0, 0)  # of a boot that is not recognised yet
        return replace(
            block,
            sequence=block.sequence - blocks,
            first_sample=block.first_sample - samples,
        )


def _later(message: SensorMessage, shift_ns: int, number: int) -> SensorMessage:
    if number == 0 or isinstance(message, SensorLayout):
        return message
    if isinstance(message, ScadaSample):
        return replace(message, time_ns=message.time_ns + shift_ns)
    session = f"{message.session}#{number + 1}"
    return replace(message, session=session, start_ns=message.start_ns + shift_ns)


def each_block_once(messages: Iterable[SensorMessage]) -> Iterator[SensorMessage]:
    """Files of one session overlap where a recorder was started again; a block counts once."""
    seen: dict[tuple[str, str, str], deque[tuple[int, int, int]]] = {}
    for message in messages:
        if isinstance(message, AccelerationBlock):
            key = (message.turbine, message.unit, message.session)
            latest = seen.setdefault(key, deque(maxlen=2 * LATEST_BLOCKS))
            same = (message.sequence, message.start_ns, hash(message.samples.tobytes()))
            if latest and message.sequence <= latest[-1][0] and same in latest:
                continue
            latest.append(same)
        yield message


MOST_BELOW = 3  # folders that an error names


class SourceError(InputError):
    """A source that does not exist or cannot be understood."""


def recordings_in(path: Path) -> list[Path]:
    """Return the file itself, or every closed recording in a folder that has samples, oldest first.

    Files of one boot of a unit follow its count of samples, whatever its clock says.

    Raises
    ------
    SourceError
        For a folder without one, or a name that no file can have.
    """
    try:
        if not path.is_dir():
            return [path]
    except OSError as error:
        raise SourceError(f"cannot read the recording {path}: {error.strerror}") from error
    found = [(file, unit) for file in sorted(path.glob("*.mcap")) for unit in _units(file)]
    if not found:
        raise SourceError(_without_recording(path))
    starts = logical_starts([stretch_of(file, unit) for file, unit in found])
    first: dict[Path, int] = {}
    for (file, _), start in zip(found, starts, strict=True):
        first[file] = min(start, first.get(file, start))
    return sorted(first, key=lambda file: (first[file], file.stat().st_mtime_ns, file.name))


def _without_recording(folder: Path) -> str:
    """Return the error of a folder without a closed recording; of one left open, the way on.

    The folder that `pilewatch new` made has its recordings one level below.
    """
    unfinished = sorted(folder.glob(f"*{ACTIVE_SUFFIX}"))
    if not unfinished:
        below = sorted({str(file.parent) for file in folder.glob("*/*.mcap")})[:MOST_BELOW]
        hint = f"; recordings are in {' and '.join(below)}" if below else ""
        return f"the folder {folder} holds no recording with acceleration blocks{hint}"
    return (
        f"the folder {folder} holds only {unfinished[-1].name}: its run goes on, or was killed; "
        f"{what_to_do(unfinished[-1])}"
    )


def _units(file: Path) -> tuple[UnitInfo, ...]:
    return recording_info(file).units


def recorded_stream(path: Path) -> Iterator[SensorMessage]:
    """Yield everything measured in a file, or in all files of a folder as one stream.

    The messages come in order of time.
    """
    files = recordings_in(path)
    if len(files) == 1:
        return iter(ReplayedTower(sensor_messages(files[0])))
    joined = (message for file in files for message in sensor_messages(file))
    return each_block_once(ReplayedTower(joined))


def sensor_messages(path: Path) -> Iterator[SensorMessage]:
    """Yield the messages of sensors and controller in the order of recording."""
    for message in read_messages(path, (SensorLayout, AccelerationBlock, ScadaSample)):
        if isinstance(message, AccelerationBlock | SensorLayout | ScadaSample):
            yield message
