"""What an OPC UA server has kept of a gap, by pages, all channels together in time.

channel a  |▮▮▮▮▮▮▮▮▮▮▮▮|              an answer has HISTORY_VALUES of a channel at most
channel b  |▮▮▮▮▮▮▮▮▮▮|
                     └ until here all are complete; the next page begins there
channel c             ·····|▮▮▮              known until later: is asked from there

A page is of the channels that are not known beyond its begin: one that was silent for a month is
read over that month without the others. It ends where the next channel comes in.

Source: OPC 10000-4 5.10.3 (HistoryRead), OPC 10000-11 6.4.3 (raw values).
"""

import asyncio
from collections.abc import AsyncIterator, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from sensors.acquisition.blocks import NANOSECONDS
from sensors.feeds.opcua.values import moment_of, stamp_ns

HISTORY_VALUES = 5000  # of a channel in one answer

ALONG = 10 * NANOSECONDS  # of a channel, read twice rather than asked for by itself [ns]
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
    newest = dict(known)
    wanted = {name: stamp for name, value in present if (stamp := stamp_ns(value)) is not None}
    for attempt in range(HISTORIAN_TRIES + 1):
        behind = [newest[name] for name, time_ns in wanted.items() if newest[name] < time_ns]
        if not behind:
            return
        if attempt:
            await asyncio.sleep(HISTORIAN_PAUSE)
        begin_ns, end_ns = min(behind), max(wanted.values())
        while begin_ns < end_ns:
            asked = {name: nodes[name] for name in nodes if newest[name] <= begin_ns + ALONG}
            others = [newest[name] for name in nodes if name not in asked]
            page = await _page(client, asked, begin_ns, min([*others, end_ns]))
            fresh = [each for each in page.values if (stamp_ns(each[1]) or 0) > newest[each[0]]]
            for name, value in fresh:
                newest[name] = max(newest[name], stamp_ns(value) or 0)
            yield fresh
            if page.until_ns <= begin_ns:
                break  # the server does not go by the times that it is asked for
            begin_ns = page.until_ns


@dataclass(frozen=True, slots=True)
class HistoryPage:
    """One answer of a server's history."""

    values: list[NamedValue]
    """Channels and values."""
    until_ns: int
    """Up to where all channels are complete [ns since 1970-01-01 UTC]."""


async def _page(client: Any, nodes: Mapping[str, Any], begin_ns: int, end_ns: int) -> HistoryPage:
    """Of what is later than `begin_ns`, up to `end_ns` or as far as an answer reaches."""
    results = await _read(client, nodes, begin_ns + MICROSECOND, end_ns + MICROSECOND)
    found: list[tuple[int, NamedValue]] = []
    ends = []  # of channels that have more than an answer takes
    for name, result in zip(nodes, results, strict=True):
        result.StatusCode.check()
        kept = getattr(result.HistoryData, "DataValues", None) or []
        timed = [(stamp, (name, each)) for each in kept if (stamp := stamp_ns(each)) is not None]
        found += timed
        if timed and (result.ContinuationPoint or len(kept) >= HISTORY_VALUES):
            ends.append(timed[-1][0])
    until_ns = min([*ends, end_ns])
    return HistoryPage([value for time_ns, value in found if time_ns <= until_ns], until_ns)


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
