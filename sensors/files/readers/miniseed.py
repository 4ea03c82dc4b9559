"""miniSEED → SEP005 channels.

Every NET.STA.LOC.CHA is a channel; parts of it that follow each other are joined, what is missing
between them is a gap. The samples are a digitiser's counts: a layout file's `sensitivity` makes
accelerations of them. Needs obspy (extra `miniseed`).

The second letter of a channel code names the instrument: N an accelerometer, H, L and P one of
velocity. Source: SEED manual 2.4, appendix A.
"""

import warnings
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from sensors.acquisition.blocks import NANOSECONDS
from sensors.extras import import_extra
from sensors.files.sep005 import Sep005Channel
from sensors.files.table import FileError, readable, require_file

INSTRUMENTS = {"N": "a", "H": "v", "L": "v", "P": "v"}


def read_miniseed(path: Path) -> list[Sep005Channel]:
    """Return the channels of a miniSEED file.

    Raises
    ------
    FileError
        If it is missing, damaged or holds none, parts of a channel contradict each other, or
        obspy is not installed.
    """
    obspy = import_extra("obspy", "miniseed", str(path), FileError)
    stream = _read(obspy, require_file(path))
    for trace in [each for each in stream if each.data.dtype.kind not in "iuf"]:
        stream.remove(trace)  # a log
    try:
        stream.merge(method=0)  # what overlaps and differs becomes a gap, as what is missing
    except Exception as error:  # obspy raises bare Exceptions
        reason = " ".join(str(error).split())
        raise FileError(f"{path}: parts of a channel do not fit together: {reason}") from error
    return [_channel(trace) for trace in stream]


def _read(obspy: Any, path: Path) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # obspy only warns of records that are cut off
        with readable(path, "miniSEED file", Exception):  # obspy raises bare Exceptions
            stream = obspy.read(str(path), format="MSEED", check_compression=False)
            cut = import_module("obspy.io.mseed.util").get_record_information(str(path))
    if cut["excess_bytes"]:
        raise FileError(f"{path}: the miniSEED file was cut off within its last record")
    return stream


def _channel(trace: Any) -> Sep005Channel:
    stats = trace.stats
    start = np.datetime64(int(stats.starttime.ns), "ns")
    return Sep005Channel(
        data=np.ma.asarray(trace.data, dtype=np.float64),
        name=trace.id,
        unit_str="",
        fs=float(stats.sampling_rate),
        start_timestamp=str(start) if stats.starttime.ns > NANOSECONDS else None,
        quantity=INSTRUMENTS.get(stats.channel[1:2]),
    )
