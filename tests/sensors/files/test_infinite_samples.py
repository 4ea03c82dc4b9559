"""An infinite sample is a missing one, and is named with its channel."""

import warnings
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from pipeline.offline.new_project import start_project
from sensors.files.formats import read_file

N = 2000


def written(path: Path, samples: np.ndarray) -> Path:
    """Two channels at 40 Hz in the format of the file's suffix."""
    times = np.arange(N) / 40
    if path.suffix == ".npz":
        np.savez(path, LAT097_FA=samples[:, 0], LAT050_SS=samples[:, 1], fs=40.0)
    elif path.suffix == ".parquet":
        columns = {"time": times, "LAT097_FA [g]": samples[:, 0], "LAT050_SS [g]": samples[:, 1]}
        parquet.write_table(pa.table({name: pa.array(c) for name, c in columns.items()}), path)
    else:
        rows = [f"{t:.3f},{a},{b}" for t, (a, b) in zip(times, samples.tolist(), strict=True)]
        path.write_text("\n".join(["time [s],LAT097_FA [g],LAT050_SS [g]", *rows]))
    return path


@pytest.mark.parametrize("suffix", ["csv", "parquet", "npz"])
@pytest.mark.parametrize("value", [np.inf, -np.inf, 1e300, -1.7e308])
@pytest.mark.parametrize("place", [0, 1200])
def test_infinite_samples_are_missing_and_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, suffix: str, value: float, place: int
) -> None:
    samples = np.random.default_rng(4).standard_normal((N, 2))
    samples[place : place + 3, 1] = value
    path = written(tmp_path / f"tower.{suffix}", samples)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        table = read_file(path)
        project = start_project([path], tmp_path / "made")
    assert project.sampling_rate == 40.0
    missing = np.flatnonzero(np.isnan(table.samples).any(axis=1))
    assert missing.tolist() == [place, place + 1, place + 2]
    assert caplog.messages.count(
        f"{path}: LAT050_SS is infinite, the first time in sample {place + 1}; infinite samples "
        "are taken as missing"
    ) == 1  # fmt: skip
    assert not [each for each in caplog.messages if "LAT097_FA is infinite" in each]
