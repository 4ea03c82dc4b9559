"""Blocks on a unit's disk until the shore has them on its own.

    spool/00000001.blocks   head, then record after record: length, CRC-32, the block as it is sent
    spool/00000002.blocks   …
    spool/lock              of the process that writes here

A file goes when every block in it is acknowledged, the oldest also where all of them together are
larger than allowed. Where a record is damaged the next one is looked for that has its checksum;
what is between is counted. A file whose rest cannot be read is renamed to .unreadable instead of
removed, unless a power cut or a full disk left that rest half written.
"""

import fcntl
import hashlib
import logging
import os
import re
import struct
import zlib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from typing import BinaryIO

from pipeline.messages import RecordedUntil
from pipeline.recording.acknowledgement import SessionKey
from pipeline.transport.codec import LARGEST_PAYLOAD, decode
from pipeline.transport.errors import CodecError
from sensors.acquisition.blocks import AccelerationBlock
from sensors.atomic_write import make_folder_durably, sync_folder
from sensors.errors import InputError

logger = logging.getLogger(__name__)

FILE_HEAD = b"pilewatch spool 1\n"
FILE_BYTES = 2**20  # after which the next file begins
MOST_MEGABYTES = 500.0  # of all files [10⁶ bytes]; of eight channels at 100 Hz two days
MOST_ASIDE = 10  # files that cannot be read in full
_RECORD = struct.Struct("<II")  # length [bytes], CRC-32 of what follows
_BLOCK_BEGINS = b"\n"  # with the turbine, its schema's first field


class SpoolError(InputError):
    """A spool that cannot be used."""


@dataclass(slots=True, eq=False)
class SpooledBlock:
    """Place of a block that is not acknowledged."""

    session: SessionKey
    sequence: int
    start_ns: int
    file: int
    """Number of its file."""
    offset: int
    """Of its record in the file [bytes]."""
    sent: float | None = None
    """When it was sent last [s, monotonic]; None: by an earlier process, if at all."""


@dataclass(frozen=True, slots=True)
class _Piece:
    """A record of a file, or what is between two of them."""

    begin: int
    end: int
    payload: bytes | None  # None: it is no record whose checksum holds


class Spool:
    """Keeps the blocks of a unit, or of several, until they are acknowledged.

    Parameters
    ----------
    folder : Path
        Is made where there is none; what an earlier process left in it is kept.
    most_megabytes : float
        Of all files; the oldest goes when they are larger [10⁶ bytes].

    Raises
    ------
    SpoolError
        If the folder cannot be used, or another process uses it.
    """

    def __init__(self, folder: Path, *, most_megabytes: float = MOST_MEGABYTES) -> None:
        if not most_megabytes > 0:
            raise SpoolError(f"a spool of {most_megabytes:g} MB holds nothing; more is needed")
        self.folder = folder
        self.dropped = 0
        """Blocks that had to go without an acknowledgement."""
        self.damaged = 0
        """Records that could not be read; where their lengths are damaged, by their size."""
        self._most_bytes = most_megabytes * 1e6
        self._waiting: dict[SpooledBlock, None] = {}  # in the order of writing
        self._by_number: dict[SessionKey, dict[int, list[SpooledBlock]]] = {}
        self._counts: dict[int, int] = {}  # file → its blocks that wait
        self._sizes: dict[int, int] = {}  # file → [bytes]
        self._unreadable: set[int] = set()  # files that are kept aside
        self._acknowledged: dict[SessionKey, RecordedUntil] = {}
        self._file: FileIO | None = None  # in writing
        self.is_synced = True
        """Whether a power cut costs nothing of what was appended."""
        try:
            make_folder_durably(folder)
            self._lock = _locked(folder)
            for number, path in _files(folder):
                self._load(number, path)
        except OSError as error:
            raise SpoolError(f"--spool {folder}: {error.strerror}; a folder is needed") from error
        aside = [number for number, _ in _files(folder, "unreadable")]
        self._number = max([*self._sizes, *aside], default=0)

    def __len__(self) -> int:
        """Blocks that are not acknowledged."""
        return len(self._waiting)

    @property
    def size(self) -> int:
        """Size of all files [bytes]."""
        return sum(self._sizes.values())

    def last_of(self, turbine: str, unit: str) -> AccelerationBlock | None:
        """The block of a unit that an earlier process kept last; None where there is none."""
        of_unit = (each for each in reversed(self._waiting) if each.session[:2] == (turbine, unit))
        last = next(of_unit, None)
        return None if last is None else self.read(last)

    def waiting(self) -> Iterator[SpooledBlock]:
        """Blocks that are not acknowledged, the oldest first."""
        return iter(self._waiting)

    def append(self, block: AccelerationBlock, payload: bytes, now: float) -> None:
        """Keep a block that is being sent.

        Parameters
        ----------
        payload : bytes
            The block as it is sent.
        now : float
            Monotonic time [s].

        Raises
        ------
        OSError
            Where the disk refuses; nothing of the block is in the spool then.
        """
        key = (block.turbine, block.unit, block.session)
        known = self._acknowledged.get(key)
        if known is not None and known.has(block.sequence, block.start_ns):
            return
        file = self._open_file()
        offset = file.tell()
        self.is_synced = False
        try:
            _write_all(file, _RECORD.pack(len(payload), zlib.crc32(payload)) + payload)
        except OSError:
            self._cut_back(file, offset)
            raise
        self._sizes[self._number] = file.tell()
        self._add(SpooledBlock(key, block.sequence, block.start_ns, self._number, offset, now))
        while self.size > self._most_bytes and len(self._sizes) > 1:
            self._drop_oldest()

    def sync(self) -> None:
        """Have what was appended survive a power cut. Raises OSError where the disk refuses."""
        if self._file is not None and not self.is_synced:
            os.fsync(self._file.fileno())
            self.is_synced = True

    def acknowledge(self, recorded: RecordedUntil) -> int:
        """Let go of what the shore has; gives how many blocks that were."""
        key = (recorded.turbine, recorded.unit, recorded.session)
        before = self._acknowledged.get(key)
        done = {} if before is None else {each.first: each.end for each in before.ranges}
        self._acknowledged[key] = recorded
        numbers = self._by_number.get(key, {})
        gone = [
            block
            for each in recorded.ranges
            for number in _numbers(numbers, done.get(each.first, each.first), each.end)
            for block in numbers[number]
            if each.has(number, block.start_ns)
        ]
        for block in dict.fromkeys(gone):
            self._let_go(block)
        return len(gone)

    def read(self, spooled: SpooledBlock) -> AccelerationBlock | None:
        """Return the block; None, and it is let go of, where its record is damaged."""
        try:
            with self._path(spooled.file).open("rb") as file:
                payload = _payload_at(file, spooled.offset)
            if payload is not None:
                return decode(AccelerationBlock, payload)
            path, offset = self._path(spooled.file), spooled.offset
            logger.warning("%s, byte %d: its checksum does not hold", path, offset)
        except (OSError, CodecError) as error:
            logger.warning("%s: %s", self._path(spooled.file), error)
        self.damaged += 1
        self._let_go(spooled)
        return None

    def close(self) -> None:
        """Sync, and let another process go on."""
        try:
            self.sync()
        finally:
            self._end_file()
            os.close(self._lock)

    # ---- files --------------------------------------------------------------------------------

    def _path(self, number: int) -> Path:
        return self.folder / f"{number:08d}.blocks"

    def _open_file(self) -> FileIO:
        """The file in writing; the next one where that is full or there is none."""
        if self._file is not None and self._sizes[self._number] >= FILE_BYTES:
            self.sync()
            self._end_file()
        if self._file is None:
            self._number += 1  # also where it cannot be made: what is left of it may have its name
            self._file = self._new_file(self._path(self._number))
            self._sizes[self._number] = len(FILE_HEAD)
            self._counts[self._number] = 0
        return self._file

    def _new_file(self, path: Path) -> FileIO:
        # Without a buffer: a kill costs no record, and what the disk refused is not written later.
        file = path.open("xb", buffering=0)
        try:
            _write_all(file, FILE_HEAD)
            sync_folder(self.folder)
        except OSError:
            file.close()
            with suppress(OSError):
                path.unlink()
            raise
        return file

    def _end_file(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None
            self._remove_if_done(self._number)

    def _cut_back(self, file: FileIO, offset: int) -> None:
        """Have a file end where a record began that the disk took half of: what follows half a
        record cannot be read."""
        try:
            file.truncate(offset)
            file.seek(offset)
        except OSError as error:
            logger.warning("%s ends within a record: %s", self._path(self._number), error)
            with suppress(OSError):
                self.sync()
            self._end_file()

    def _load(self, number: int, path: Path) -> None:
        """What an earlier process left in a file."""
        content = path.read_bytes()
        if not FILE_HEAD.startswith(content[: len(FILE_HEAD)].rstrip(b"\0")):
            logger.warning("%s: its head is damaged, or another version's", path)
            self._unreadable.add(number)
        pieces = list(_pieces(content))
        sizes = [each.end - each.begin for each in pieces if each.payload is not None]
        usual = sum(sizes) / len(sizes) if sizes else len(content)
        for piece in pieces:
            if piece.payload is None:
                self._count_damaged(number, piece, max(1, round((piece.end - piece.begin) / usual)))
                if piece.end == len(content) and not _is_half_written(content, piece.begin):
                    self._unreadable.add(number)
            else:
                self._take_over(number, piece.begin, piece.payload)
        self._sizes[number] = len(content)
        self._counts.setdefault(number, 0)
        self._remove_if_done(number)

    def _count_damaged(self, number: int, piece: _Piece, n_records: int) -> None:
        logger.warning(
            "%s: bytes %d to %d have no whole record; that may be %d of them",
            self._path(number),
            piece.begin,
            piece.end,
            n_records,
        )
        self.damaged += n_records

    def _take_over(self, number: int, offset: int, payload: bytes) -> None:
        try:
            block = decode(AccelerationBlock, payload)
        except CodecError as error:
            logger.warning("%s, byte %d: %s", self._path(number), offset, error)
            self.damaged += 1
            self._unreadable.add(number)  # another version may read it
            return
        key = (block.turbine, block.unit, block.session)
        self._add(SpooledBlock(key, block.sequence, block.start_ns, number, offset))

    def _drop_oldest(self) -> None:
        oldest = min(self._sizes)
        lost = [block for block in self._waiting if block.file == oldest]
        if lost and not self.dropped:
            logger.error("%s is full: the oldest blocks go unacknowledged", self.folder)
        self.dropped += len(lost)
        for block in lost:
            self._let_go(block)
        self._remove_if_done(oldest)

    # ---- what waits ---------------------------------------------------------------------------

    def _add(self, block: SpooledBlock) -> None:
        self._waiting[block] = None
        self._by_number.setdefault(block.session, {}).setdefault(block.sequence, []).append(block)
        self._counts[block.file] = self._counts.get(block.file, 0) + 1

    def _let_go(self, block: SpooledBlock) -> None:
        del self._waiting[block]
        numbers = self._by_number[block.session]
        numbers[block.sequence].remove(block)
        if not numbers[block.sequence]:
            del numbers[block.sequence]
        if not numbers:
            del self._by_number[block.session]
        self._counts[block.file] -= 1
        self._remove_if_done(block.file)

    def _remove_if_done(self, number: int) -> None:
        """Remove a file that nothing waits in, but for the one in writing."""
        in_writing = self._file is not None and number == self._number
        if self._counts.get(number, 1) == 0 and not in_writing:
            if number in self._unreadable:
                self._set_aside(number)
            self._path(number).unlink(missing_ok=True)
            del self._counts[number]
            del self._sizes[number]

    def _set_aside(self, number: int) -> None:
        """Rename a file that cannot be read in full; the oldest ones of its kind go."""
        path = self._path(number)
        aside = path.with_suffix(".unreadable")
        with suppress(FileNotFoundError):
            path.replace(aside)
            logger.warning("%s cannot be read in full: it is kept as %s", path, aside.name)
        for _, oldest in _files(self.folder, "unreadable")[:-MOST_ASIDE]:
            logger.warning("%s is removed: %d newer ones are kept", oldest, MOST_ASIDE)
            oldest.unlink(missing_ok=True)


def default_folder(source: str, environment: Mapping[str, str]) -> Path:
    """Return where a source is spooled if no other folder is given.

    Parameters
    ----------
    source : str
        As it is named on the command line.
    environment : mapping
        $STATE_DIRECTORY of a service, else $XDG_STATE_HOME, else ~/.local/state.
    """
    state = environment.get("STATE_DIRECTORY", "").partition(":")[0]
    if not state:
        home = environment.get("XDG_STATE_HOME") or Path("~/.local/state").expanduser()
        state = str(Path(home) / "pilewatch")
    kind = re.sub(r"[^a-z0-9]+", "-", source.partition(":")[0].lower())  # the rest may be secret
    return Path(state) / "spool" / f"{kind}-{hashlib.sha256(source.encode()).hexdigest()[:12]}"


def _numbers(known: dict[int, list[SpooledBlock]], first: int, end: int) -> list[int]:
    """Numbers from `first` to one before `end` of which there are blocks."""
    if end - first > len(known):
        return [number for number in known if first <= number < end]
    return [number for number in range(first, end) if number in known]


def _locked(folder: Path) -> int:
    descriptor = os.open(folder / "lock", os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(descriptor)
        raise SpoolError(
            f"--spool {folder}: another process sends from there; end that one or choose another "
            "folder"
        ) from error
    return descriptor


def _files(folder: Path, ending: str = "blocks") -> list[tuple[int, Path]]:
    numbered = [path for path in folder.glob(f"*.{ending}") if path.stem.isdigit()]
    return sorted((int(path.stem), path) for path in numbered)


def _write_all(file: FileIO, content: bytes) -> None:
    """Write to a file without a buffer, which may take a part at a time."""
    rest = memoryview(content)
    while rest:
        rest = rest[file.write(rest) :]


def _pieces(content: bytes) -> Iterator[_Piece]:
    """What a file has behind its head."""
    at = len(FILE_HEAD)
    while at < len(content):
        begin, end = at, _end_of_record(content, at)
        payload = None if end is None else content[begin + _RECORD.size : end]
        at = _next_record(content, begin + 1) if end is None else end
        yield _Piece(begin, at, payload)


def _end_of_record(content: bytes, begin: int) -> int | None:
    """None where no record begins whose checksum holds."""
    start = begin + _RECORD.size
    if start >= len(content):
        return None
    length, checksum = _RECORD.unpack_from(content, begin)
    if not 0 < length <= min(LARGEST_PAYLOAD, len(content) - start):
        return None
    is_whole = zlib.crc32(memoryview(content)[start : start + length]) == checksum
    return start + length if is_whole else None


def _next_record(content: bytes, begin: int) -> int:
    """Where the next record is whose checksum holds; else the end."""
    found = content.find(_BLOCK_BEGINS, begin + _RECORD.size)
    while found >= 0:
        if _end_of_record(content, found - _RECORD.size) is not None:
            return found - _RECORD.size
        found = content.find(_BLOCK_BEGINS, found + 1)
    return len(content)


def _is_half_written(content: bytes, begin: int) -> bool:
    """Whether a file's rest is what a power cut or a full disk leaves: less than its head claims,
    or nothing but zeros."""
    rest = len(content) - begin - _RECORD.size
    if rest <= 0 or not content[begin:].strip(b"\0"):
        return True
    return rest < _RECORD.unpack_from(content, begin)[0] <= LARGEST_PAYLOAD


def _payload_at(file: BinaryIO, offset: int) -> bytes | None:
    """Return the payload of one record; None where its checksum does not hold."""
    file.seek(offset)
    head = file.read(_RECORD.size)
    if len(head) < _RECORD.size:
        return None
    length, checksum = _RECORD.unpack(head)
    payload = file.read(length) if length <= LARGEST_PAYLOAD else b""
    return payload if zlib.crc32(payload) == checksum else None
