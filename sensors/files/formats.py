"""Which reader reads which file.

    file ─► reader of its suffix ─► SEP005 channels ─┐
    text, Parquet ─► chunks ─────────────────────────┴► ChannelTables

Other formats plug in as an entry point of the group `pilewatch.files`: its name is the suffix
("dxd"), its object any function from a path to a list of SEP005 channels, as the readers called
sep005-io-… have it.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

import numpy as np

from sensors.files.fill_values import FillValues
from sensors.files.readers.hdf5 import read_hdf5
from sensors.files.readers.matlab import read_mat
from sensors.files.readers.miniseed import read_miniseed
from sensors.files.readers.npz import read_npy, read_npz
from sensors.files.readers.openfast import read_outb
from sensors.files.readers.parquet import read_parquet_chunks
from sensors.files.readers.tdms import read_tdms
from sensors.files.readers.uff import read_uff
from sensors.files.sep005 import (
    Sep005Channel,
    constant_series,
    join_channels,
    list_channels,
)
from sensors.files.table import (
    EVERYTHING,
    ChannelTable,
    FileError,
    Wanted,
    join_chunks,
    require_file,
)
from sensors.files.text.csv import read_csv_chunks

GROUP = "pilewatch.files"  # of entry points
OWN_FILES = {
    "toml": "settings: a layout, a scenario or a description",
    "mcap": "a recording",
    "rrd": "pictures",
}

ChunkReader = Callable[[Path, Wanted], Iterable[ChannelTable]]
ChannelReader = Callable[[Path], list[Sep005Channel]]

CHUNK_READERS: dict[str, ChunkReader] = {
    "csv": read_csv_chunks,
    "tsv": read_csv_chunks,
    "txt": read_csv_chunks,
    "dat": read_csv_chunks,  # Campbell's TOA5, and many others
    "out": read_csv_chunks,  # OpenFAST
    "parquet": read_parquet_chunks,
    "pq": read_parquet_chunks,
}
CHANNEL_READERS: dict[str, ChannelReader] = {
    "npz": read_npz,
    "npy": read_npy,
    "h5": read_hdf5,
    "hdf5": read_hdf5,
    "hdf": read_hdf5,
    "mat": read_mat,
    "tdms": read_tdms,
    "mseed": read_miniseed,
    "miniseed": read_miniseed,
    "msd": read_miniseed,
    "outb": read_outb,
    "uff": read_uff,
    "unv": read_uff,
}


def read_file(path: Path, reader: str | None = None, wanted: Wanted = EVERYTHING) -> ChannelTable:
    """Return what is wanted of a file as one table.

    Parameters
    ----------
    path : Path
        Of the file.
    reader : str, optional
        "package.module:function" that gives SEP005 channels; None: the one of its suffix
        (`read_chunks`).
    wanted : Wanted, optional
        What of it is read; everything by default.

    Raises
    ------
    FileError
        As its reader does.
    """
    return join_chunks(read_chunks(path, reader, wanted), path)


def read_chunks(
    path: Path, reader: str | None = None, wanted: Wanted = EVERYTHING
) -> Iterator[ChannelTable]:
    """Yield the channels of a file, in chunks where its format allows it.

    Parameters
    ----------
    reader : str, optional
        "package.module:function" that gives SEP005 channels; None: the one of its suffix,
        plugged in or ours; a unknown suffix is read as text.
    wanted : Wanted, optional
        What of it is read.

    Raises
    ------
    FileError
        No such reader; a file that it cannot read.
    """
    fill_values = FillValues(str(path))
    for chunk in _chunks(path, reader, wanted):
        fill_values.leave_out(chunk)
        yield chunk


def _chunks(path: Path, reader: str | None, wanted: Wanted) -> Iterator[ChannelTable]:
    """Yield the channels of a file as its reader gives them."""
    channels = _channels(path, reader)
    if channels is not None:
        yield join_channels(channels, path, wanted)
    else:
        suffix = path.suffix.lower().removeprefix(".")
        yield from CHUNK_READERS.get(suffix, read_csv_chunks)(path, wanted)


def channels_in(path: Path, reader: str | None = None, wanted: Wanted = EVERYTHING) -> ChannelTable:
    """Return names and units of all channels of a file, without its samples.

    Parameters
    ----------
    path : Path
        Of the file.
    reader : str, optional
        "package.module:function" that gives SEP005 channels; None: the one of its suffix
        (`read_chunks`).
    wanted : Wanted, optional
        What of it is read; everything by default. Its names leave out no channel.

    Raises
    ------
    FileError
        As its reader does.

    Notes
    -----
    Even of such as differ in rate.
    """
    channels = _channels(path, reader)
    if channels is None:
        wanted = replace(wanted, names=frozenset())
        first = next(read_chunks(path, reader, wanted), None)
        if first is None:
            raise FileError(f"{path}: 0 samples; at least two are needed")
        return replace(first, samples=first.samples[:0], times=None)
    return list_channels(channels, path, wanted)


def constant_channels(
    path: Path, reader: str | None = None, wanted: Wanted = EVERYTHING
) -> tuple[str, ...]:
    """Return the names of a file's channels that are one number throughout, or none.

    Parameters
    ----------
    path : Path
        Of the file; it is read to its end.
    reader : str, optional
        "package.module:function" that gives SEP005 channels; None: the one of its suffix
        (`read_chunks`).
    wanted : Wanted, optional
        What of it is read; everything by default.

    Raises
    ------
    FileError
        As its reader does.
    """
    channels = _channels(path, reader)
    if channels is not None:
        return constant_series(channels, path)
    names: tuple[str, ...] = ()
    lowest = highest = np.empty(0)
    for chunk in read_chunks(path, reader, wanted):
        low, high = np.fmin.reduce(chunk.samples), np.fmax.reduce(chunk.samples)
        lowest = np.fmin(lowest, low) if names else low
        highest = np.fmax(highest, high) if names else high
        names = chunk.names
    # NaN where there is no number at all
    return tuple(name for name, low, high in zip(names, lowest, highest, strict=True)
                 if not low < high)  # fmt: skip


def _channels(path: Path, reader: str | None) -> list[Sep005Channel] | None:
    """Return the channels of a file that is not read in chunks."""
    suffix = path.suffix.lower().removeprefix(".")
    entries = [each for each in _installed_readers() if each.name == suffix]
    if reader is not None:
        entries = [EntryPoint("--reader", reader, GROUP)]
    if entries:
        return _by_entry(entries[0], path)
    if suffix in OWN_FILES and path.is_file():
        raise FileError(
            f"{path} holds {OWN_FILES[suffix]}; a file of measurements is needed (CSV, MATLAB, …)"
        )
    return CHANNEL_READERS[suffix](path) if suffix in CHANNEL_READERS else None


@cache
def _installed_readers() -> tuple[EntryPoint, ...]:
    """Return the readers of other packages, listed once: every package is looked at for them,
    which takes longer than reading a small file."""
    return tuple(entry_points(group=GROUP))


def _by_entry(entry: EntryPoint, path: Path) -> list[Sep005Channel]:
    """Read a file by a plugged-in reader; any exception of it becomes one line."""
    try:
        read = entry.load()
    except (ImportError, AttributeError, ValueError) as error:
        raise FileError(
            f"{path}: its reader {entry.value!r} cannot be loaded ({error}); "
            "package.module:function is needed"
        ) from error
    try:
        return list(read(require_file(path)))
    except FileError:
        raise
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise FileError(f"{path}: its reader {entry.value!r} failed: {reason}") from error
