"""Accelerations as a table: time, then one column per channel with its unit.

CSV      `time [s]`: seconds since 1970-01-01 UTC, as `pilewatch identify` reads them
Parquet  `time`: timestamps of nanoseconds, UTC

Missing blocks are missing rows; the samples are the recorded 32-bit numbers.
"""

import re

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.export.table_file import TIMESTAMP, Format
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.files.text.column_titles import distinct


def samples_schema(
    block: AccelerationBlock, layout: SensorLayout | None, form: Format
) -> pa.Schema:
    """Return the columns of a unit's samples.

    Parameters
    ----------
    layout : SensorLayout | None
        Names and units of the channels; None or another number of channels: they are numbered.
    """
    time = pa.field("time [s]", pa.float64()) if form == "csv" else pa.field("time", TIMESTAMP)
    titles = (
        [f"ch{number + 1} [m/s²]" for number in range(block.samples.shape[1])]
        if layout is None or len(layout.channels) != block.samples.shape[1]
        else _titles(layout)
    )
    about = {
        "turbine": block.turbine,
        "unit": block.unit,
        "layout": block.layout_id,
        "sampling_rate_hz": repr(block.sampling_rate),
    }
    return pa.schema([time, *(pa.field(title, pa.float32()) for title in titles)], about)


def samples_table(block: AccelerationBlock, schema: pa.Schema) -> pa.Table:
    """Return the samples of one block."""
    times_ns = sample_times(block)
    if schema.field(0).type == TIMESTAMP:
        times = pa.array(times_ns, TIMESTAMP)
    else:  # whole seconds apart, so that 1767225600.025 is written and not …0250001
        times = pa.array(times_ns // NANOSECONDS + (times_ns % NANOSECONDS) / NANOSECONDS)
    columns = [pa.array(column) for column in np.ascontiguousarray(block.samples.T)]
    return pa.Table.from_arrays([times, *columns], schema=schema)


def sample_times(block: AccelerationBlock) -> NDArray[np.int64]:
    """Return the times of a block's samples, shape (n_samples,) [ns since 1970-01-01 UTC]."""
    since_start = np.arange(len(block.samples)) * (NANOSECONDS / block.sampling_rate)
    return np.asarray(block.start_ns + np.rint(since_start).astype(np.int64))


def _titles(layout: SensorLayout) -> list[str]:
    names = distinct([_plain(channel.name) for channel in layout.channels])
    units = [channel.unit for channel in layout.channels]
    return [f"{name} [{unit}]" for name, unit in zip(names, units, strict=True)]


def _plain(name: str) -> str:
    """Return a channel's name without separators of columns."""
    return re.sub(r'[,;\t"\r\n\[\]()]', "_", name)
