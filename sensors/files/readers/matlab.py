"""MATLAB's MAT files → SEP005 channels.

Version 7.3 is HDF5 and goes to `hdf5`; versions 4 to 7 are read by SciPy. Structures are groups,
scalars and texts are the notes of what stands beside and below them (`fs`, `start_time`, `names`,
`units`), also in a structure of their own (`info.fs`); see `named_arrays`. Objects of MATLAB's own
classes (`timetable`, `datetime`) have a form that MathWorks does not publish; they are left out.
"""

import struct
import warnings
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from sensors.files.named_arrays import UNIT_NOTES, NamedArray, find_channels, units_apart
from sensors.files.readers.hdf5 import read_hdf5
from sensors.files.sep005 import Sep005Channel
from sensors.files.table import readable, require_file

HDF5_OFFSET = 512  # MATLAB puts a text before the HDF5 of version 7.3 [bytes]
HDF5_MAGIC = b"\x89HDF"
MATLAB_DAMAGE = (
    *(OSError, ValueError, LookupError, EOFError, struct.error, NotImplementedError),
    *(AttributeError, TypeError, ArithmeticError, MemoryError, zlib.error),
)


def read_mat(path: Path) -> list[Sep005Channel]:
    """Read the channels of a MAT file of any version.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    list of Channel
        One for each series of numbers and each column of a matrix.

    Raises
    ------
    FileError
        If the file is missing, damaged or holds no channel, or is of version 7.3 and h5py is not
        installed.
    """
    with require_file(path).open("rb") as file:
        beginning = file.read(HDF5_OFFSET + len(HDF5_MAGIC))
    if beginning.startswith(HDF5_MAGIC) or beginning.endswith(HDF5_MAGIC):
        return read_hdf5(path)
    from scipy.io import loadmat  # slow to load, and few files are MATLAB's
    from scipy.io.matlab import MatReadError, MatReadWarning

    damage = (*MATLAB_DAMAGE, MatReadError)
    with readable(path, "MATLAB file", *damage), warnings.catch_warnings():
        warnings.simplefilter("ignore", MatReadWarning)  # of one name that is used twice
        content = loadmat(path, simplify_cells=True)
    variables = {name: each for name, each in content.items() if not name.startswith("__")}
    return find_channels(list(_arrays(variables, "", {}, {})), path)


def _arrays(
    group: dict[str, Any], place: str, around: dict[str, Any], units: dict[str, str]
) -> Iterator[NamedArray]:
    """Yield all arrays of a structure and of those in it, with the notes that hold for them."""
    values = {
        name: each if isinstance(each, dict) else _array(each) for name, each in group.items()
    }
    own, of_arrays = _notes(values)
    notes, units = around | own, units | of_arrays
    for name, each in values.items():
        if isinstance(each, dict):
            yield from _arrays(each, f"{place}{name}/", notes, units)
        elif each.size > 1 and each.dtype.kind in "iufc":
            unit = {UNIT_NOTES[0]: units[name]} if name in units else {}
            yield NamedArray(f"{place}{name}", each, notes | unit, unit)


def _notes(values: dict[str, Any]) -> tuple[dict[str, Any], dict[str, str]]:
    """Scalars and texts of a structure, and those of structures in it that have nothing else: an
    `info` or `header` beside the measurements; and the units of arrays by their names."""
    headers: dict[str, dict[str, Any]] = {}
    for place, each in values.items():
        if isinstance(each, dict):
            inside = {
                name: one if isinstance(one, dict) else _array(one) for name, one in each.items()
            }
            found, _ = _notes(inside)
            if found.keys() >= {name for name, one in inside.items() if not isinstance(one, dict)}:
                headers[place] = found
    of_headers, units = units_apart(headers)
    single = {
        name: each
        for name, each in values.items()
        if isinstance(each, np.ndarray) and (each.size == 1 or each.dtype.kind == "U")
    }
    return of_headers | single, units


def _array(value: Any) -> np.ndarray[Any, Any]:
    """Return the value as an array; cells that hold only texts as an array of texts."""
    array = np.asarray(value)
    if array.dtype == object and all(isinstance(each, str) for each in array.ravel()):
        return array.astype(str)
    return array
