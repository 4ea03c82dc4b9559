"""National Instruments' TDMS → SEP005 channels.

Properties of the file, of a group and of the channel are its notes, the nearest first: LabVIEW
writes `wf_increment` [s], `wf_start_time` and `unit_string`; see `named_arrays`. Needs npTDMS
(extra `tdms`).
"""

import logging
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from sensors.extras import import_extra
from sensors.files.named_arrays import NamedArray, find_channels
from sensors.files.sep005 import Sep005Channel
from sensors.files.table import FileError, readable, require_file

TDMS_DAMAGE = (
    *(OSError, ValueError, LookupError, EOFError, struct.error, NotImplementedError),
    *(AttributeError, TypeError, ArithmeticError, MemoryError),
)


def read_tdms(path: Path) -> list[Sep005Channel]:
    """Return the channels of a TDMS file.

    Raises
    ------
    FileError
        If it is missing, damaged or holds none, or npTDMS is not installed.
    """
    nptdms = import_extra("nptdms", "tdms", str(path), FileError)
    logging.getLogger("nptdms").setLevel(logging.ERROR)  # a cut file is reported below, once
    require_file(path)
    with readable(path, "TDMS file", *TDMS_DAMAGE), nptdms.TdmsFile.open(path) as file:
        arrays = list(_arrays(file))
        cut = file.file_status.incomplete_final_segment
    if cut:
        raise FileError(f"{path}: the TDMS file was cut off before its end")
    return find_channels(arrays, path)


def _arrays(file: Any) -> Iterator[NamedArray]:
    for group in file.groups():
        for channel in group.channels():
            own = dict(channel.properties)
            notes = {**file.properties, **group.properties, **own}
            yield NamedArray(f"{group.name}/{channel.name}", np.asarray(channel[:]), notes, own)
