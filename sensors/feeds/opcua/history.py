"""What an OPC UA server has kept of a gap, by pages, all channels together in time.

channel a  |▮▮▮▮▮▮▮▮▮▮▮▮|              an answer has HISTORY_VALUES of a channel at most
channel b  |▮▮▮▮▮▮▮▮▮▮|
                     └ until here all are complete; the next page begins there

Source: OPC 10000-4 5.10.3 (HistoryRead), OPC 10000-11 6.4.3 (raw values).
"""

import asyncio
from collections.abc import AsyncIterator, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from sensors.feeds.opcua.values import moment_of, stamp_ns

HISTORY_VALUES = 5000  # of a channel in one answer

HISTORIAN_TRIES = 5  # until the present values are in the history
HISTORIAN_PAUSE = 1.0  # between two of them [s]
MICROSECOND = 1000  # the step of a stamp here [ns]

NamedValue = tuple[str, Any]  # a channel's name, an OPC UA DataValue


async def history(
    client: Any,
    nodes: Mapping[str, Any],
    known: Mapping[str, int],
    present: Iterable[NamedValue],
) -> AsyncIterator[list[NamedValue]]:
    """Yield what a server has kept between the values that are known and the present ones.

    Parameters
    ----------
    nodes : mapping
        Variable of each channel.
    known : mapping
        Time of the last known value of each channel [ns since 1970-01-01 UTC].
    present : iterable of (str, DataValue)
        Values that the history has to reach; a historian writes some time after its server sends.

    Raises
    ------
    asyncua.ua.UaStatusCodeError
        If the server keeps no history.
    """
    newest, patience = dict(known), HISTORIAN_TRIES
    wanted = {name: stamp for name, value in present if (stamp := stamp_ns(value)) is not None}
    while behind := [name for name, time_ns in wanted.items() if newest[name] < time_ns]:
        begin_ns, end_ns = min(newest[each] for each in behind), max(wanted.values())
        page = await _page(client, nodes, begin_ns + MICROSECOND, end_ns + MICROSECOND)
        fresh = [each for each in page.values if (stamp_ns(each[1]) or 0) > newest[each[0]]]
        for name, value in fresh:
            newest[name] = max(newest[name], stamp_ns(value) or 0)
        yield fresh
        if page.is_last and not patience:
            return
        if page.is_last:
            patience -= 1
            await asyncio.sleep(HISTORIAN_PAUSE)


@dataclass(frozen=True, slots=True)
class HistoryPage:
    """One answer of a server's history."""

    values: list[NamedValue]
    """Channels and values, up to where all channels are complete."""
    is_last: bool
    """Whether nothing follows."""


async def _page(client: Any, nodes: Mapping[str, Any], begin_ns: int, end_ns: int) -> HistoryPage:
    results = await _read(client, nodes, begin_ns, end_ns)
    found: list[tuple[int, NamedValue]] = []
    ends = []  # of channels that have more than an answer takes
    for name, result in zip(nodes, results, strict=True):
        result.StatusCode.check()
        kept = getattr(result.HistoryData, "DataValues", None) or []
        timed = [(stamp, (name, each)) for each in kept if (stamp := stamp_ns(each)) is not None]
        found += timed
        if timed and (result.ContinuationPoint or len(kept) >= HISTORY_VALUES):
            ends.append(timed[-1][0])
    until_ns = min(ends, default=end_ns)
    return HistoryPage([value for time_ns, value in found if time_ns <= until_ns], not ends)


async def _read(client: Any, nodes: Mapping[str, Any], begin_ns: int, end_ns: int) -> Sequence[Any]:
    ua, session = import_module("asyncua.ua"), client.uaclient.session
    wanted = ua.HistoryReadParameters()
    wanted.HistoryReadDetails = ua.ReadRawModifiedDetails(
        StartTime=moment_of(begin_ns),
        EndTime=moment_of(end_ns),
        NumValuesPerNode=HISTORY_VALUES,
        ReturnBounds=False,
    )
    wanted.TimestampsToReturn = ua.TimestampsToReturn.Both
    wanted.NodesToRead = [ua.HistoryReadValueId(NodeId=each.nodeid) for each in nodes.values()]
    results: Sequence[Any] = await session.history_read(wanted)
    unfinished = [
        ua.HistoryReadValueId(NodeId=each.NodeId, ContinuationPoint=result.ContinuationPoint)
        for each, result in zip(wanted.NodesToRead, results, strict=True)
        if result.ContinuationPoint
    ]
    if unfinished:  # the next page is asked by its time: a server keeps few places to go on from
        wanted.NodesToRead, wanted.ReleaseContinuationPoints = unfinished, True
        with suppress(ua.UaStatusCodeError):
            await session.history_read(wanted)
    return results
