"""Read the channels of a recording or of a file of measurements as one table."""

import heapq
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.messages import Message
from pipeline.nodes.operating_state import OperationLog
from pipeline.oma.windows.unit_alignment import UnitJoiner
from pipeline.oma.windows.windowing import BlockOrder, MissingSamples
from pipeline.recording.reader import read_messages
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.scada import ScadaSample
from sensors.files.conditions import with_rotor_speed_apart
from sensors.files.formats import read_file
from sensors.files.layout_file import LayoutFile
from sensors.files.table import EVERYTHING, UNSTATED, ChannelTable, FileError, TimeColumn, dated

JOINING = 5.0  # waiting time for a missing unit [s]


def measured_channels(
    path: Path,
    layout: LayoutFile | None = None,
    time: TimeColumn = UNSTATED,
    *,
    rate_known: bool = False,
) -> ChannelTable:
    """Return the channels that a layout file lists; all, as in the file, without one.

    Parameters
    ----------
    rate_known : bool
        Whether the rate is stated beside the file, which then needs no time.

    Raises
    ------
    InputError
        If the file cannot be read or lacks a channel.
    """
    if path.suffix == ".mcap":
        table = recorded_channels(path)
    else:
        wanted = dated(EVERYTHING if layout is None else layout.wanted(), time)
        wanted = replace(wanted, rate_known=rate_known)
        table = with_rotor_speed_apart(read_file(path, wanted=wanted))
    return table if layout is None else layout.chosen(table)


def recorded_channels(path: Path) -> ChannelTable:
    """Return the samples of a recording's first turbine, in order of time.

    Missing blocks are visible in `times`. Several acquisition units are joined on one clock.

    Raises
    ------
    RecordingError, FileError
        If it holds no blocks.
    """
    messages = read_messages(path, (SensorLayout, AccelerationBlock, ScadaSample))
    return channels_of_messages(messages, str(path))


def channels_of_messages(messages: Iterable[Message], origin: str) -> ChannelTable:
    """Return the samples of the first turbine among messages, as `recorded_channels` does.

    Parameters
    ----------
    messages : iterable of Message
        Layouts before their blocks; blocks may be late, repeated or missing.
    origin : str
        Where they are from, for the error.

    Raises
    ------
    FileError
        If there are no blocks.
    """
    layouts: dict[str, SensorLayout] = {}
    blocks: dict[str, list[AccelerationBlock]] = {}  # of the first turbine, by unit
    operation: dict[str, OperationLog] = {}
    turbine = ""
    for message in messages:
        if isinstance(message, ScadaSample):
            operation.setdefault(message.turbine, OperationLog(None)).note(message)
        elif isinstance(message, SensorLayout):
            layouts[message.layout_id] = message
        elif isinstance(message, AccelerationBlock):
            turbine = turbine or message.turbine
            if message.turbine == turbine:
                blocks.setdefault(message.unit, []).append(message)
    if not blocks:
        raise FileError(f"{origin} holds no acceleration blocks")
    by_unit = {unit: _in_order(blocks[unit]) for unit in sorted(blocks)}
    if len(by_unit) > 1:
        table = _join_blocks(by_unit, layouts)
    else:
        (ordered,) = by_unit.values()
        table = _table(ordered, layouts)
    return _with_speed(table, operation.get(turbine, OperationLog()))


def _with_speed(table: ChannelTable, operation: OperationLog) -> ChannelTable:
    assert table.times is not None
    end_ns = table.start_ns + round(float(table.times[-1]) * NANOSECONDS) + 1
    seconds = np.linspace(0.0, float(table.times[-1]), len(table.times))
    speed = operation.rotor_speed(table.start_ns, end_ns, len(seconds))
    if speed is None:
        return table
    return replace(table, rotor_speed=np.interp(table.times, seconds, speed))


def _in_order(blocks: list[AccelerationBlock]) -> list[AccelerationBlock]:
    once = {(block.session, block.sequence): block for block in blocks}
    return sorted(once.values(), key=lambda block: block.start_ns)


def _join_blocks(
    by_unit: dict[str, list[AccelerationBlock]], layouts: dict[str, SensorLayout]
) -> ChannelTable:
    joiner = UnitJoiner([layouts[blocks[0].layout_id] for blocks in by_unit.values()], JOINING)
    orders = {unit: BlockOrder(JOINING) for unit in by_unit}
    chunks: list[AccelerationBlock | MissingSamples] = []
    for block in heapq.merge(*by_unit.values(), key=lambda block: block.start_ns):
        chunks += joiner.push(block, list(orders[block.unit].push(block)))
    chunks += joiner.finish()
    joined = [chunk for chunk in chunks if isinstance(chunk, AccelerationBlock)]
    return _table(joined, {joiner.layout.layout_id: joiner.layout})


def _table(blocks: list[AccelerationBlock], layouts: dict[str, SensorLayout]) -> ChannelTable:
    start_ns = blocks[0].start_ns
    times = [
        (block.start_ns - start_ns) / NANOSECONDS
        + np.arange(len(block.samples)) / block.sampling_rate
        for block in blocks
    ]
    samples = np.concatenate([block.samples for block in blocks]).astype(np.float64)
    layout = layouts.get(blocks[0].layout_id)
    names = tuple(f"ch{i + 1}" for i in range(samples.shape[1]))
    units = ("m/s²",) * len(names)
    if layout is not None:
        names, units = layout.channel_names, tuple(channel.unit for channel in layout.channels)
    return ChannelTable(names, units, samples, np.concatenate(times), start_ns)
