"""A text file's bytes as Arrow reads them: UTF-8, unpacked, columns apart by one character."""

import codecs
import gzip
import io
import mmap
import re
import zipfile
import zlib
from pathlib import Path
from typing import IO, Any, cast

import pyarrow as pa

from sensors.files.table import FileError

UNREADABLE = (OSError, EOFError, zlib.error, zipfile.BadZipFile, UnicodeError)
GZIP = b"\x1f\x8b"
ZIP = b"PK\x03\x04"
WORKBOOK = "[Content_Types].xml"  # in every archive that is one
# What begins a file that is no text, and what to do about it.
NO_TEXT = {
    ZIP: "an archive or a workbook: unpack it, or save the sheet as CSV",
    b"\xd0\xcf\x11\xe0": "a workbook: save the sheet as CSV",
    b"MATLAB 5.0": "MATLAB: name it .mat",
    b"\x89HDF": "HDF5: name it .h5",
    b"TDSm": "TDMS: name it .tdms",
    b"PAR1": "Parquet: name it .parquet",
    b"\x93NUMPY": "an array of NumPy: name it .npy",
    b'"TOB': "a binary table of a Campbell logger: convert it to TOA5, e.g. with CardConvert",
    b"ARROW1": "an Arrow file: write it as Parquet",
    b"\x89MCAP": "a recording: it needs no import",
}
LEAST_UNPACKED = 100_000_000  # that every packed file may hold [bytes]
MOST_PACKED = 100  # times that numbers are packed, at most
_BLANKS = re.compile(r"[ \t]+")
_BLOCKS_OF_NUL = re.compile(rb"\0{8,}")  # blocks that a power failure left unwritten
_NO_TEXT_BYTES = re.compile(rb"[\0-\x08\x0e-\x1f]")
_LINES_OF_NUL = re.compile(r"(?m)^[^\n]*\0[^\n]*\n?")


def open_unpacked(path: Path) -> IO[bytes]:
    """Return the file's bytes, unpacked where it is a gzip file or an archive of one file.

    Raises
    ------
    FileError
        If an archive holds several files.
    """
    with path.open("rb") as file:
        begin = file.read(4)
    if begin.startswith(GZIP):
        return cast("IO[bytes]", BoundedGzip(path))
    return _only_member(path) if begin == ZIP else path.open("rb")


def _only_member(path: Path) -> IO[bytes]:
    """Return the file in an archive; the archive itself where it is a workbook, or damaged."""
    try:
        archive = zipfile.ZipFile(path)
    except zipfile.BadZipFile:
        return path.open("rb")
    members = [each for each in archive.infolist() if not each.is_dir()]
    names = [each.filename for each in members]
    if WORKBOOK in names or not members:
        return path.open("rb")
    if len(members) > 1:
        listed = ", ".join(names[:3]) + (", …" if len(names) > 3 else "")
        raise FileError(
            f"{path}: the archive holds {len(names)} files ({listed}): unpack it; `new` and "
            "`import` take several files"
        )
    require_unpacked(path, members[0].file_size, most_unpacked(path.stat().st_size))
    try:
        return archive.open(members[0])
    except (RuntimeError, NotImplementedError) as error:  # a password, an unknown method
        raise FileError(f"{path}: {error}; unpack it") from error


class BoundedGzip(gzip.GzipFile):
    """A gzip file that gives no more than a measurement's text does.

    Raises FileError, on reading, beyond `most_unpacked` bytes.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "rb")
        self._path = path
        self._most = most_unpacked(path.stat().st_size)

    def read(self, size: int | None = -1) -> bytes:
        """Give so many bytes at most; −1: all."""
        wanted = self._most + 1 if size is None or size < 0 else size
        content = super().read(wanted)
        require_unpacked(self._path, self.tell(), self._most)
        return content

    def readline(self, size: int | None = -1) -> bytes:
        """Give one line, or so many bytes of it."""
        line = super().readline(self._most + 1 if size is None or size < 0 else size)
        require_unpacked(self._path, self.tell(), self._most)
        return line


def most_unpacked(packed: int) -> int:
    """Bytes that a file of so many packed bytes may hold: text of numbers packs 3 to 20 times."""
    return max(LEAST_UNPACKED, MOST_PACKED * packed)


def require_unpacked(path: Path, size: int, most: int) -> None:
    """Raise FileError where a packed file holds more than it may."""
    if size > most:
        raise FileError(
            f"{path}: more than {most / 1e6:.0f} MB come out of {path.stat().st_size / 1e6:.1f} "
            "MB: no measurement packs like that; unpack it yourself if it is one"
        )


def detect_encoding(beginning: bytes, path: Path) -> str:
    """Return how a text is written.

    Raises
    ------
    FileError
        For what is no text.
    """
    for bom, name in (
        (codecs.BOM_UTF8, "utf-8-sig"),
        (codecs.BOM_UTF16_LE, "utf-16"),
        (codecs.BOM_UTF16_BE, "utf-16"),
    ):
        if beginning.startswith(bom):
            return name
    for magic, what in NO_TEXT.items():
        if beginning.startswith(magic):
            raise FileError(f"{path}: this is no text but {what}")
    if beginning.lstrip().startswith(b"{"):
        raise FileError(
            f"{path}: this is JSON and no table of columns: save it as CSV; messages of a live "
            "source are read by `pilewatch feed` with a mapping"
        )
    if not _NO_TEXT_BYTES.search(written := _BLOCKS_OF_NUL.sub(b"", beginning)):
        beginning = written
    even, odd = beginning[::2].count(0), beginning[1::2].count(0)
    if even or odd:
        half = len(beginning) // 2
        if max(even, odd) > 0.8 * half and min(even, odd) == 0:
            return "utf-16-le" if odd else "utf-16-be"
        raise FileError(f"{path}: this is no text; a table of numbers with a header row is needed")
    try:
        codecs.getincrementaldecoder("utf-8")().decode(beginning)
    except UnicodeDecodeError:
        return "cp1252"  # Latin-1, as Windows writes it
    return "utf-8"


def holds_nul(path: Path) -> bool:
    """Return whether an 8-bit text has blocks of NUL bytes, as a power failure leaves them.

    False of a packed file, which would have to be unpacked for it.
    """
    with open_unpacked(path) as file:
        if not isinstance(file, io.BufferedReader) or not path.stat().st_size:
            return False
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            return content.find(b"\0") >= 0


class RewrittenText(io.RawIOBase):
    """A text file as UTF-8; columns that blanks keep apart are kept apart by one.

    Lines in which a block of NUL bytes stands are left out: the values at its ends are cut.
    """

    def __init__(self, file: IO[bytes], encoding: str, *, blanks: bool, nul: bool = False) -> None:
        self._file = file
        self._decoder = codecs.getincrementaldecoder(encoding)(errors="replace")
        self._blanks = blanks
        self._nul = nul
        self._line = ""  # a line that is not complete yet
        self._ready = b""

    def readable(self) -> bool:
        """Return True: the file is open for reading."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Fill the buffer; return the number of bytes, 0 at the end."""
        while not self._ready:
            raw = self._file.read(2**20)
            self._ready = self._rewritten(self._decoder.decode(raw, final=not raw), last=not raw)
            if not raw:
                break
        count = min(len(buffer), len(self._ready))
        buffer[:count], self._ready = self._ready[:count], self._ready[count:]
        return count

    def close(self) -> None:
        """Close the file below, too."""
        self._file.close()
        super().close()

    def _rewritten(self, text: str, *, last: bool) -> bytes:
        if not self._blanks and not self._nul:
            return text.encode()
        text = self._line + text
        end = len(text) if last else max(text.rfind("\n"), text.rfind("\r")) + 1
        complete, self._line = text[:end], text[end:]
        if self._nul:
            complete = _LINES_OF_NUL.sub("", complete)
        if not self._blanks:
            return complete.encode()
        lines = _BLANKS.sub(" ", complete)
        return re.sub(r"(?m)^ | $| (?=\r)", "", lines).encode()


def open_arrow_stream(path: Path, encoding: str, *, blanks: bool, nul: bool) -> Any:
    """Return what Arrow reads: the file itself where it is UTF-8 and whole."""
    file = open_unpacked(path)
    if encoding == "utf-8" and not blanks and not nul and isinstance(file, io.BufferedReader):
        file.close()
        return pa.OSFile(str(path))
    text = RewrittenText(file, encoding, blanks=blanks, nul=nul)
    return pa.PythonFile(io.BufferedReader(text), mode="r")
