"""HDF5 → SEP005 channels.

Datasets are the arrays; attributes of the file, of a group and of the dataset are its notes, the
nearest first; see `named_arrays`. Needs h5py (extra `hdf5`).
"""

from pathlib import Path
from typing import Any

from sensors.files.named_arrays import NamedArray, channels_of_arrays
from sensors.files.optional import existing, needed
from sensors.files.sep005 import Channel
from sensors.files.table import FileError


def read_hdf5(path: Path) -> list[Channel]:
    """The channels of an HDF5 file.

    Raises FileError where it is missing, damaged or holds none, or h5py is not installed.
    """
    h5py = needed("h5py", "hdf5", path)
    try:
        with h5py.File(existing(path), "r") as file:
            arrays = list(_arrays(file, "", {}, h5py))
    except (OSError, RuntimeError, KeyError) as error:
        reason = " ".join(str(error).split())
        raise FileError(f"{path}: no readable HDF5 file: {reason}") from error
    return channels_of_arrays(arrays, path)


def _arrays(group: Any, place: str, around: dict[str, Any], h5py: Any) -> list[NamedArray]:
    """All datasets in a group and below, with the attributes that hold for them."""
    notes = around | dict(group.attrs)
    found = []
    for name, member in group.items():
        inside = f"{place}{name}"
        if isinstance(member, h5py.Group):
            found += _arrays(member, f"{inside}/", notes, h5py)
        elif isinstance(member, h5py.Dataset) and member.dtype.kind in "iuf":
            if member.ndim == 0:
                notes[name] = member[()]
            else:
                found.append(NamedArray(inside, member[()], notes | dict(member.attrs)))
    return found
