"""Read the channels of a recording or of a file of measurements as one table."""

import heapq
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pipeline.messages import Message
from pipeline.nodes.operating_state import OperationLog
from pipeline.oma.windows.unit_alignment import UnitJoiner
from pipeline.oma.windows.windowing import Beginning, BlockOrder, MissingSamples
from pipeline.sources.session_files import session_files, session_messages
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout, layout_difference
from sensors.acquisition.scada import ScadaSample
from sensors.errors import InputError
from sensors.files.conditions import with_rotor_speed_apart
from sensors.files.formats import read_file
from sensors.files.layout_file import LayoutFile, layout_by_names
from sensors.files.table import EVERYTHING, UNSTATED, ChannelTable, FileError, TimeColumn, dated
from sensors.files.text.columns import log_once

JOINING = 5.0  # waiting time for a missing unit [s]

# with the layout that counted when it came; None where none had come
_PlacedBlock = tuple[AccelerationBlock, SensorLayout | None]


@dataclass(frozen=True, slots=True, eq=False)
class PlacedChannels:
    """Samples of channels and the places of these channels."""

    table: ChannelTable
    layout: SensorLayout | None
    """Of the table's channels, in their order; None where it is not known."""


def measured_channels(
    path: Path,
    layout: LayoutFile | None = None,
    time: TimeColumn = UNSTATED,
    *,
    rate_known: bool = False,
    turbine: str | None = None,
) -> PlacedChannels:
    """Return the channels that a layout file lists; all, as in the file, without one.

    Parameters
    ----------
    path : Path
        Of a recording, a session's folder, or a file of measurements.
    rate_known : bool
        Whether the rate is stated beside the file, which then needs no time.
    turbine : str, optional
        Of a recording; the first one in it by default.

    Raises
    ------
    InputError
        If the file cannot be read or lacks a channel, or the recording the turbine.
    """
    if path.suffix == ".mcap" or path.is_dir():
        recorded = recorded_channels(session_files(path), turbine)
        table, own = recorded.table, recorded.layout
    elif turbine is not None:
        raise InputError(f"turbine is {turbine!r}; {path} is no recording, which alone has some")
    else:
        wanted = dated(EVERYTHING if layout is None else layout.wanted(), time)
        wanted = replace(wanted, rate_known=rate_known)
        table, own = with_rotor_speed_apart(read_file(path, wanted=wanted)), None
    if layout is not None:
        table, own = layout.chosen(table), None
    known = layout or layout_by_names(table.names)
    if own is None and known is not None:
        own = known.sensor_layout(table)
    return PlacedChannels(table, own)


def recorded_channels(files: Sequence[Path], turbine: str | None = None) -> PlacedChannels:
    """Return the samples of one turbine of a recording, in order of time.

    Missing blocks are visible in `times`. Several acquisition units are joined on one clock. Where
    a unit came back with other channels, each column has one channel by its name, NaN where the
    unit lacked it.

    Parameters
    ----------
    files : sequence of Path
        Of the recording, in order of time.
    turbine : str, optional
        By default the first one of which there are blocks; a warning names others.

    Raises
    ------
    RecordingError, FileError
        If it holds no blocks of the turbine, or the layouts of its units do not fit one another.
    """
    origin = files[0] if len(files) == 1 else files[0].parent
    messages = session_messages(files, (SensorLayout, AccelerationBlock, ScadaSample))
    return channels_of_messages(messages, str(origin), turbine)


def channels_of_messages(
    messages: Iterable[Message], origin: str, turbine: str | None = None
) -> PlacedChannels:
    """Return the samples of one turbine among messages, as `recorded_channels` does.

    Parameters
    ----------
    messages : iterable of Message
        Layouts and blocks, which may be late, repeated or missing.
    origin : str
        Where they are from, for the error.
    turbine : str, optional
        By default the first one of which there are blocks; a warning names others.

    Raises
    ------
    FileError
        If there are no blocks of the turbine, or the layouts of its units do not fit one another.
    """
    layouts: dict[tuple[str, str, str], SensorLayout] = {}  # by turbine, unit and layout_id
    blocks: dict[str, dict[str, list[_PlacedBlock]]] = {}  # by turbine and unit; of one turbine
    operation: dict[str, OperationLog] = {}
    for message in messages:
        if isinstance(message, ScadaSample):
            operation.setdefault(message.turbine, OperationLog(None)).note(message)
        elif isinstance(message, SensorLayout):
            layouts[message.turbine, message.unit, message.layout_id] = message
        elif isinstance(message, AccelerationBlock):
            units = blocks.setdefault(message.turbine, {})
            if message.turbine == (turbine or next(iter(blocks))):
                layout = layouts.get((message.turbine, message.unit, message.layout_id))
                units.setdefault(message.unit, []).append((message, layout))
    chosen = turbine or next(iter(blocks), "")
    if not blocks.get(chosen):
        of = f" of {turbine!r}; it has blocks of {', '.join(blocks)}" if turbine and blocks else ""
        raise FileError(f"{origin} holds no acceleration blocks{of}")
    if turbine is None and len(blocks) > 1:
        log_once(
            f"{origin} has blocks of {len(blocks)} turbines, {', '.join(blocks)}; those of "
            f"{chosen}, the first, are read"
        )
    streams = [
        _unit_stream(_in_order(blocks[chosen][unit]), layouts, origin)
        for unit in sorted(blocks[chosen])
    ]
    recorded = (_joined(streams, origin) if len(streams) > 1 else streams[0]).table()
    speed = operation.get(chosen, OperationLog())
    return replace(recorded, table=_with_speed(recorded.table, speed))


def _with_speed(table: ChannelTable, operation: OperationLog) -> ChannelTable:
    assert table.times is not None
    end_ns = table.start_ns + round(float(table.times[-1]) * NANOSECONDS) + 1
    seconds = np.linspace(0.0, float(table.times[-1]), len(table.times))
    speed = operation.rotor_speed(table.start_ns, end_ns, len(seconds))
    if speed is None:
        return table
    return replace(table, rotor_speed=np.interp(table.times, seconds, speed))


def _in_order(blocks: list[_PlacedBlock]) -> list[_PlacedBlock]:
    once = {(block.session, block.sequence): (block, layout) for block, layout in blocks}
    return sorted(once.values(), key=lambda each: each[0].start_ns)


@dataclass(frozen=True, slots=True, eq=False)
class _Stream:
    """Blocks in order of time, all with the same columns."""

    blocks: list[AccelerationBlock]
    names: tuple[str, ...]
    layout: SensorLayout | None
    """None where a block has none: its columns are numbered."""

    def table(self) -> PlacedChannels:
        """Return the blocks' samples as one table."""
        start_ns = self.blocks[0].start_ns
        times = [
            (block.start_ns - start_ns) / NANOSECONDS
            + np.arange(len(block.samples)) / block.sampling_rate
            for block in self.blocks
        ]
        samples = np.concatenate([block.samples for block in self.blocks]).astype(np.float64)
        units = ("m/s²",) * len(self.names)
        if self.layout is not None:
            units = tuple(channel.unit for channel in self.layout.channels)
        table = ChannelTable(self.names, units, samples, np.concatenate(times), start_ns)
        return PlacedChannels(table, self.layout)


def _unit_stream(
    placed: list[_PlacedBlock],
    layouts: Mapping[tuple[str, str, str], SensorLayout],
    origin: str,
) -> _Stream:
    """Blocks of one unit with every channel that it had, each in the column of its name."""
    kept: list[tuple[AccelerationBlock, tuple[str, ...]]] = []
    used: list[SensorLayout] = []
    without = False  # whether a block has no layout
    unfit = 0
    for block, known in placed:
        # a layout may be recorded after the first of its blocks
        layout = known or layouts.get((block.turbine, block.unit, block.layout_id))
        n_channels = block.samples.shape[1]
        if layout is None:
            without = True
            kept.append((block, tuple(f"ch{i + 1}" for i in range(n_channels))))
        elif len(layout.channels) != n_channels:
            unfit += 1
        else:
            kept.append((block, layout.channel_names))
            if layout not in used[-1:]:
                used.append(layout)
    unit = placed[0][0].unit
    if not kept:
        raise FileError(f"{origin}: no block of unit {unit} has as many channels as its layout")
    if unfit:
        log_once(
            f"{origin}: {unfit} of {len(placed)} blocks of unit {unit} are left out: they have "
            "more or fewer channels than their layout"
        )
    names = tuple(dict.fromkeys(name for _, each in kept for name in each))
    blocks = [_in_columns(block, own, names) for block, own in kept]
    return _Stream(blocks, names, None if without else _one_layout(used, origin))


def _in_columns(
    block: AccelerationBlock, own: tuple[str, ...], names: tuple[str, ...]
) -> AccelerationBlock:
    """A block of the channels `own` with the columns `names`, NaN in those that it lacks."""
    if own == names:
        return block
    samples = np.full((len(block.samples), len(names)), np.nan, dtype=np.float32)
    samples[:, [names.index(name) for name in own]] = block.samples
    return replace(block, samples=samples)


def _one_layout(layouts: Sequence[SensorLayout], origin: str) -> SensorLayout:
    """All channels of a unit's layouts, each as the last one that has it states it.

    Raises
    ------
    FileError
        If a channel came back in another unit of measurement.
    """
    channels = {channel.name: channel for channel in layouts[0].channels}
    for layout in layouts[1:]:
        shared = [channel for channel in layout.channels if channel.name in channels]
        before = replace(layout, channels=tuple(channels[channel.name] for channel in shared))
        for old, new in zip(before.channels, shared, strict=True):
            if old.unit != new.unit:
                raise FileError(
                    f"{origin}: channel {new.name} of unit {layout.unit} is in {old.unit}, later "
                    f"in {new.unit}; a recording of each time alone can be read"
                )
        if moved := layout_difference(before, replace(layout, channels=tuple(shared))):
            log_once(
                f"{origin}: channel {moved.channel} of unit {layout.unit} {moved.before}, later it "
                f"{moved.after}; both are in one column, and the later place counts"
            )
        channels |= {channel.name: channel for channel in layout.channels}
    return replace(layouts[-1], channels=tuple(channels.values()))


def _joined(units: Sequence[_Stream], origin: str) -> _Stream:
    """All units' channels side by side on one clock."""
    layouts = [unit.layout for unit in units if unit.layout is not None]
    if len(layouts) < len(units):
        names = [unit.blocks[0].unit for unit in units if unit.layout is None]
        raise FileError(
            f"{origin} has no layout of unit {', '.join(names)}; several units are joined by theirs"
        )
    joiner = UnitJoiner(layouts, JOINING)
    orders: dict[str, BlockOrder] = {}
    newest: dict[str, AccelerationBlock] = {}
    chunks: list[AccelerationBlock | MissingSamples] = []
    for block in heapq.merge(*(unit.blocks for unit in units), key=lambda block: block.start_ns):
        before = newest.get(block.unit)
        if before is None or before.session != block.session:  # which counts its own samples
            if before is not None:
                chunks += joiner.push(before, list(orders[block.unit].flush()))
            beginning = Beginning(block.first_sample, block.sequence)
            orders[block.unit] = BlockOrder(JOINING, beginning)
        newest[block.unit] = block
        chunks += joiner.push(block, list(orders[block.unit].push(block)))
    for unit, block in newest.items():
        chunks += joiner.push(block, list(orders[unit].flush()))
    chunks += joiner.finish()
    joined = [chunk for chunk in chunks if isinstance(chunk, AccelerationBlock)]
    return _Stream(joined, joiner.layout.channel_names, joiner.layout)
