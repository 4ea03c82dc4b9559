"""HDF5 → SEP005 channels.

Datasets are the arrays; attributes of the file, of a group and of the dataset are its notes, the
nearest first, and so are datasets of one value or of text; see `named_arrays`. A dataset's
`scale_factor` (or `scale`), `add_offset` and `_FillValue` are applied as the CF conventions have
it. MATLAB's version 7.3 is HDF5, too: it stores texts as numbers of their letters, and cells as
references. Needs h5py (extra `hdf5`).
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sensors.extras import import_extra
from sensors.files.named_arrays import UNIT_NOTES, NamedArray, find_channels, units_apart
from sensors.files.sep005 import Sep005Channel
from sensors.files.table import FileError, readable, require_file

SCALE_NOTES = ("scale_factor", "scale")
SHIFT = ("add_offset", "offset")
FILL = ("_FillValue", "missing_value")
MATLAB_CLASS = "MATLAB_class"  # "char", "cell", "double"; stored axes are the reverse of MATLAB's
MATLAB_EMPTY = "MATLAB_empty"  # instead of values its size is stored, such as 0 0


def read_hdf5(path: Path) -> list[Sep005Channel]:
    """Return the channels of an HDF5 file.

    Raises
    ------
    FileError
        If it is missing, damaged or holds none, or h5py is not installed.
    """
    h5py = import_extra("h5py", "hdf5", str(path), FileError)
    damage = (OSError, RuntimeError, KeyError, TypeError, ValueError)
    with readable(path, "HDF5 file", *damage), h5py.File(require_file(path), "r") as file:
        arrays = _arrays(file, "", {}, {}, h5py, path)
    return find_channels(arrays, path)


def _arrays(
    group: Any,
    place: str,
    around: dict[str, Any],
    units: dict[str, str],
    h5py: Any,
    path: Path,
) -> list[NamedArray]:
    """Return all datasets in a group and below, with the attributes that hold for them."""
    if b"pandas_type" in {key.encode() for key in group.attrs}:
        raise FileError(
            f"{path}: {place or '/'} is a table of pandas; DataFrame.to_parquet writes what is "
            "read here"
        )
    members = {
        name: member
        for name in group
        if not name.startswith("#")
        and not ((member := group.get(name)) is not None and member.attrs.get(MATLAB_EMPTY))
    }
    datasets = {name: each for name, each in members.items() if isinstance(each, h5py.Dataset)}
    of_headers, of_arrays = units_apart(_headers(members, h5py))
    single = {name: each for name, one in datasets.items() if (each := _note(one)) is not None}
    notes = around | of_headers | dict(group.attrs) | single
    units = units | of_arrays
    found = []
    for name, member in members.items():
        if isinstance(member, h5py.Group):
            found += _arrays(member, f"{place}{name}/", notes, units, h5py, path)
        elif name in datasets and name not in single and member.shape is not None:
            own = dict(member.attrs)
            values = _in_units(member[()], own, f"{path}: {place}{name}")
            if name in units and not set(UNIT_NOTES).intersection(own):
                own[UNIT_NOTES[0]] = units[name]
            found.append(NamedArray(f"{place}{name}", values, notes | own, own))
    return found


def _headers(members: Mapping[str, Any], h5py: Any) -> dict[str, dict[str, Any]]:
    """Notes of groups that hold no array: an `info` or `header` beside the measurements."""
    headers: dict[str, dict[str, Any]] = {}
    for place, group in members.items():
        if not isinstance(group, h5py.Group):
            continue
        inside = {name: group.get(name) for name in group}
        values = {n: _note(each) for n, each in inside.items() if isinstance(each, h5py.Dataset)}
        if len(values) == len(inside) and all(each is not None for each in values.values()):
            headers[place] = dict(group.attrs) | values
    return headers


def _note(dataset: Any) -> Any:
    """Return the content of a dataset of one value or of text; None of any other."""
    if dataset.shape is None or dataset.dtype.names is not None:
        return None
    if dataset.attrs.get(MATLAB_CLASS) in (b"char", b"cell"):
        return _matlab_texts(dataset)
    metadata = dataset.dtype.metadata or {}
    if dataset.dtype.kind in "OS":
        return dataset[()] if dataset.dtype.kind == "S" or "vlen" in metadata else None
    if dataset.dtype.kind in "iuf" and dataset.size == 1:
        return np.asarray(dataset[()]).reshape(-1)[0]
    return None


def _matlab_texts(dataset: Any) -> NDArray[Any] | None:
    """Return the text of a `char`, its rows, or the texts of a `cell`; None of any other cell."""
    if dataset.attrs[MATLAB_CLASS] == b"char":
        rows = np.atleast_2d(dataset[()]).T
        if rows.dtype.kind not in "iu":
            return None
        texts = ["".join(map(chr, row)).rstrip() for row in rows.tolist()]
        return np.array(texts[0] if len(texts) == 1 else texts)
    inside = [dataset.file[each] for each in np.ravel(dataset[()]) if each]
    found = [_note(each) if hasattr(each, "dtype") else None for each in inside]
    texts = [str(each) for each in found if np.asarray(each).dtype.kind == "U"]
    return np.array(texts) if texts and len(texts) == dataset.size else None


def _in_units(values: NDArray[Any], notes: dict[str, Any], place: str) -> NDArray[Any]:
    """Counts as what they stand for; NaN where the file marks a missing value."""
    if values.dtype.kind not in "iuf":
        return values
    scale, shift, fill = (_factor(notes, names, place) for names in (SCALE_NOTES, SHIFT, FILL))
    if scale is None and fill is None and "add_offset" not in notes:
        return values
    fill = None if fill is None else _as_stored(fill, values.dtype)
    missing = values == fill if fill is not None else np.zeros(values.shape, dtype=bool)
    inside = values * (1.0 if scale is None else scale)
    if scale is not None or "add_offset" in notes:
        inside = inside + (0.0 if shift is None else shift)
    return np.where(missing, np.nan, inside) if missing.any() else np.asarray(inside)


def _as_stored(fill: Any, dtype: np.dtype[Any]) -> Any:
    """Return a fill value as values of a type hold it: -999.9 in single precision is another
    number than in double, and -1 in 16 bits is 65535 where they are unsigned."""
    if dtype.kind == "f":
        with np.errstate(over="ignore"):
            stored = dtype.type(fill)
        return stored if np.isfinite(stored) else fill
    same_bits = fill.dtype.kind in "iu" and fill.dtype.itemsize == dtype.itemsize
    return fill.astype(dtype) if same_bits else fill


def _factor(notes: dict[str, Any], names: tuple[str, ...], place: str) -> Any:
    name = next((name for name in names if name in notes), None)
    if name is None:
        return None
    stated = np.asarray(notes[name])
    if stated.size != 1 or stated.dtype.kind not in "iuf":
        raise FileError(f"{place}: its attribute {name} is {notes[name]!r}; one number is needed")
    return stated.reshape(-1)[0]
