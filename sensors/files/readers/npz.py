"""NumPy's archive of named arrays (`np.savez`), or a single one (`np.save`) → SEP005 channels.

Scalars and texts among the arrays are notes (`fs`, `start_timestamp`, `names`, `units`); see
`named_arrays`. A name may carry its unit in brackets. Pickled objects are not read: a file could
run anything.
"""

import tokenize
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sensors.files.named_arrays import NamedArray, find_channels
from sensors.files.sep005 import Sep005Channel
from sensors.files.table import FileError, readable, require_file
from sensors.files.text.decoding import most_unpacked, require_unpacked

# What numpy raises of files that are no such archive: a broken header is read as Python's grammar.
NPZ_DAMAGE = (
    *(OSError, ValueError, EOFError, KeyError, TypeError, MemoryError, NotImplementedError),
    *(RuntimeError, SyntaxError, tokenize.TokenError, zipfile.BadZipFile, zlib.error),
)


def read_npz(path: Path) -> list[Sep005Channel]:
    """Return the channels of an NPZ file.

    Raises
    ------
    FileError
        If it is missing, damaged or holds none.
    """
    if not zipfile.is_zipfile(require_file(path)):
        raise FileError(f"{path}: no archive of arrays as np.savez writes it, or cut off")
    with readable(path, "NPZ file", *NPZ_DAMAGE):
        with zipfile.ZipFile(path) as packed:
            unpacked = sum(each.file_size for each in packed.infolist())
        require_unpacked(path, unpacked, most_unpacked(path.stat().st_size))
        with np.load(path, allow_pickle=False) as archive:
            arrays: dict[str, NDArray[Any]] = dict(archive)
    notes = {
        name: each for name, each in arrays.items() if each.size == 1 or each.dtype.kind in "US"
    }
    series = [NamedArray(name, each, notes) for name, each in arrays.items() if name not in notes]
    return find_channels(series, path)


def read_npy(path: Path) -> list[Sep005Channel]:
    """Return the channels of an NPY file.

    Raises
    ------
    FileError
        If it is missing, damaged or holds none.
    """
    require_file(path)
    with readable(path, "NPY file", *NPZ_DAMAGE):
        values = np.load(path, allow_pickle=False)
    if not isinstance(values, np.ndarray):
        raise FileError(f"{path}: an archive of arrays; name it .npz")
    return find_channels([NamedArray("ch", values)], path)
