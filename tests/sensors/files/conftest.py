"""One measurement, written in every format that is read."""

import struct
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import obspy
import pyarrow as pa
import pytest
import pyuff
from nptdms import ChannelObject, RootObject, TdmsWriter
from numpy.typing import NDArray
from pyarrow import parquet
from scipy.io import savemat

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


def write_mat(path: Path) -> None:
    notes = {"fs": RATE, "start_timestamp": START, "names": np.array(NAMES, dtype=object)}
    savemat(path, {"tower": notes | {"samples": SAMPLES, "units": "m/s^2"}}, do_compression=True)


def write_uff(path: Path) -> None:
    blank = {
        f"{axis}_{key}": 0
        for axis in ("abscissa", "ordinate", "orddenom", "z_axis")
        for key in ("spec_data_type", "len_unit_exp", "force_unit_exp", "temp_unit_exp")
    }
    labels = ("abscissa", "ordinate", "orddenom", "z_axis")
    blank |= {f"{axis}_axis_units_lab": "NONE" for axis in labels}
    blank |= dict.fromkeys(("id1", "id2", "id3", "id4", "id5"), "NONE")
    blank |= dict.fromkeys(("ver_num", "load_case_id", "ref_node", "ref_dir", "z_axis_value"), 0)
    blank |= dict.fromkeys(("rsp_ent_name", "ref_ent_name"), "NONE")
    for node, column in zip((145, 106), SAMPLES.T, strict=True):
        own = {
            **{"type": 58, "binary": 1, "func_type": 1, "rsp_node": node, "rsp_dir": 1},
            **{"ord_data_type": 4, "num_pts": len(column), "data": column, "x": SECONDS},
            **{"abscissa_spacing": 1, "abscissa_min": 0.0, "abscissa_inc": 1 / RATE},
            **{"ordinate_spec_data_type": 12, "ordinate_axis_units_lab": "m/s^2"},
        }
        pyuff.UFF(str(path)).write_sets(blank | own, mode="add")


def write_outb(path: Path) -> None:
    """Uncompressed, as OpenFAST writes with OutFmt binary and full precision."""
    path.write_bytes(
        struct.pack("<hiidd", 3, 2, len(SAMPLES), 0.0, 1 / RATE)
        + struct.pack("<i", 4)
        + b"test"
        + b"".join(f"{text:<10}".encode() for text in ("Time", *NAMES))
        + b"".join(f"{text:<10}".encode() for text in ("(s)", "(m/s^2)", "(m/s^2)"))
        + SAMPLES.astype("<f8").tobytes()
    )


WRITERS: dict[str, Callable[[Path], None]] = {
    "csv": write_csv,
    "parquet": write_parquet,
    "npz": write_npz,
    "h5": write_hdf5,
    "tdms": write_tdms,
    "mseed": write_miniseed,
    "mat": write_mat,
    "uff": write_uff,
    "outb": write_outb,
}


@pytest.fixture(params=WRITERS)
def measurement(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """The measurement as a file of each format in turn."""
    path = tmp_path / f"measured.{request.param}"
    WRITERS[request.param](path)
    return path
