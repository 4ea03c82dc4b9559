"""A recording that was exported and is imported again holds the same samples, times and units."""

import tempfile
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.export.export import export
from pipeline.export.samples import sample_times
from pipeline.recording.reader import read_messages
from pipeline.sources.import_files import open_measurement, record_measurement
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import Accelerometer, SensorLayout
from sensors.files.layout_file import load_layout
from tests.pipeline.report.example_session import recorded

TEXT_ROUNDING_NS = 240  # seconds since 1970 as a 64-bit number
UNITS = ("m/s²", "m/s", "m", "V", "µε", "")

blocks_of_a_unit = st.fixed_dictionaries(
    {
        "rate": st.sampled_from([4.0, 15.0, 100 / 3, 64.0, 425.0, 1000.0, 2000.0]),
        "start_ns": st.integers(10**18, 2 * 10**18),
        "missing": st.lists(st.integers(0, 3), min_size=1, max_size=4),  # seconds before each block
        "units": st.lists(st.sampled_from(UNITS), min_size=1, max_size=3),
        "seed": st.integers(0, 2**32 - 1),
        "scale": st.sampled_from([1e-30, 1e-6, 1.0, 1e6, 1e30]),
        "lost": st.booleans(),  # one sample is NaN
    }
)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(unit=blocks_of_a_unit, form=st.sampled_from(["csv", "parquet"]))
def test_what_is_exported_and_imported_again_is_the_same(
    unit: dict[str, object], form: Literal["csv", "parquet"]
) -> None:
    with tempfile.TemporaryDirectory() as name:
        _there_and_back(Path(name), form, **unit)  # type: ignore[arg-type]


def _there_and_back(
    folder: Path,
    form: Literal["csv", "parquet"],
    *,
    rate: float,
    start_ns: int,
    missing: list[int],
    units: list[str],
    seed: int,
    scale: float,
    lost: bool,
) -> None:
    if len({unit for unit in units if unit in UNITS[:3]}) > 1:
        units = units[:1]  # a recording holds channels alike
    layout = SensorLayout(
        "l1",
        turbine="t1",
        unit="tower",
        channels=tuple(
            Accelerometer(f"ch-{i}", 10.0 * (i + 1), (1.0, 0.0, 0.0), unit=unit)
            for i, unit in enumerate(units)
        ),
    )
    samples = np.random.default_rng(seed).normal(scale=scale, size=(round(20 * rate), len(units)))
    samples = samples.astype(np.float32)
    if lost and len(units) > 1:
        samples[1, 0] = np.nan
    before = _blocks(layout, samples, rate, start_ns, np.cumsum(missing).tolist())
    recorded(folder / "a.mcap", [layout, *before])
    (file,) = export(folder / "a.mcap", folder / "out", form)
    mapping = "".join(
        f'[[channels]]\nname = "{each.name}"\nelevation = {each.elevation}\n'
        "direction = [1.0, 0.0, 0.0]\n" + 'unit = "V"\n' * (each.unit == "V")
        for each in layout.channels
    )
    (folder / "layout.toml").write_text(mapping, "utf-8")
    measurement = open_measurement([file.path], layout=load_layout(folder / "layout.toml"))
    record_measurement(measurement, folder / "b.mcap")
    after = list(read_messages(folder / "b.mcap"))
    (again,) = [each for each in after if isinstance(each, SensorLayout)]
    returned = [each for each in after if isinstance(each, AccelerationBlock)]
    assert [each.unit for each in again.channels] == units
    assert measurement.sampling_rate == pytest.approx(rate, rel=1e-6)
    np.testing.assert_array_equal(_samples(returned), _samples(before))
    tolerance = 2 * TEXT_ROUNDING_NS if form == "csv" else 2
    assert np.abs(_times(returned) - _times(before)).max() <= tolerance


def _blocks(
    layout: SensorLayout,
    samples: np.ndarray,
    rate: float,
    start_ns: int,
    delays: list[int],
) -> list[AccelerationBlock]:
    """The samples in equal parts, each as many seconds late as `delays` say."""
    blocks, first = [], 0
    for number, (part, delay) in enumerate(
        zip(np.array_split(samples, len(delays)), delays, strict=True)
    ):
        lost = round(delay * rate)
        begin = start_ns + round((first + lost) * NANOSECONDS / rate)
        blocks.append(
            AccelerationBlock(
                turbine="t1", unit="tower", session="s1", layout_id="l1",
                sequence=number + round(delay), first_sample=first + lost, start_ns=begin,
                sampling_rate=rate, samples=part,
            )
        )  # fmt: skip
        first += len(part)
    return blocks


def _samples(blocks: list[AccelerationBlock]) -> np.ndarray:
    return np.concatenate([block.samples for block in blocks])


def _times(blocks: list[AccelerationBlock]) -> np.ndarray:
    return np.concatenate([sample_times(block) for block in blocks])
