"""One measurement, written in every format that is read."""

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import obspy
import pyarrow as pa
import pytest
from nptdms import ChannelObject, RootObject, TdmsWriter
from numpy.typing import NDArray
from pyarrow import parquet

from sensors.acquisition.blocks import NANOSECONDS

RATE = 40.0  # [Hz]
START = "2024-03-01T12:00:00.250"
START_NS = 1_709_294_400 * NANOSECONDS + 250_000_000
NAMES = ("z145-fa", "z145-ss")
SAMPLES: NDArray[np.float64] = np.random.default_rng(41).normal(size=(400, 2))  # [m/s²]
SECONDS = np.arange(len(SAMPLES)) / RATE


def write_csv(path: Path) -> None:
    stamps = np.datetime64(START_NS, "ns") + np.round(SECONDS * 1e9).astype("timedelta64[ns]")
    rows = [f"{t},{a!r},{b!r}" for t, (a, b) in zip(stamps, SAMPLES.tolist(), strict=True)]
    path.write_text("\n".join(["time,z145-fa [m/s2],z145-ss [m/s2]", *rows]) + "\n")


def write_parquet(path: Path) -> None:
    stamps = START_NS + np.round(SECONDS * 1e9).astype(np.int64)
    columns = {"time": pa.array(stamps).cast(pa.timestamp("ns"))}
    columns |= {
        f"{name} [m/s²]": pa.array(column) for name, column in zip(NAMES, SAMPLES.T, strict=True)
    }
    parquet.write_table(pa.table(columns), path, row_group_size=150)


def write_npz(path: Path) -> None:
    notes = {"fs": RATE, "start_timestamp": START, "names": NAMES, "units": "m/s²"}
    np.savez(path, samples=SAMPLES, **{key: np.array(each) for key, each in notes.items()})


def write_hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.attrs["start_timestamp"] = START
        group = file.create_group("tower")
        group.attrs["sampling_rate"] = RATE
        for name, column in zip(NAMES, SAMPLES.T, strict=True):
            group.create_dataset(name, data=column, chunks=True).attrs["unit"] = "m/s^2"


def write_tdms(path: Path) -> None:
    notes = {
        "wf_increment": 1 / RATE,
        "wf_start_time": np.datetime64(START, "us"),
        "unit_string": "m/s^2",
    }
    with TdmsWriter(path) as writer:
        channels = [
            ChannelObject("tower", name, np.ascontiguousarray(column), properties=notes)
            for name, column in zip(NAMES, SAMPLES.T, strict=True)
        ]
        writer.write_segment([RootObject(), *channels])


def write_miniseed(path: Path) -> None:
    traces = []
    for code, column in zip(("BNX", "BNY"), SAMPLES.T, strict=True):
        header = {
            "network": "OW",
            "station": "T1",
            "channel": code,
            "sampling_rate": RATE,
            "starttime": obspy.UTCDateTime(ns=START_NS),
        }
        traces.append(obspy.Trace(np.ascontiguousarray(column), header))
    obspy.Stream(traces).write(str(path), format="MSEED", encoding="FLOAT64")


WRITERS: dict[str, Callable[[Path], None]] = {
    "csv": write_csv,
    "parquet": write_parquet,
    "npz": write_npz,
    "h5": write_hdf5,
    "tdms": write_tdms,
    "mseed": write_miniseed,
}


@pytest.fixture(params=WRITERS)
def measurement(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """The measurement as a file of each format in turn."""
    path = tmp_path / f"measured.{request.param}"
    WRITERS[request.param](path)
    return path
