"""A subscription to variables of an OPC UA server: every value, also one that equals the last.

Source: OPC 10000-4 5.13 (monitored items), 5.14 (subscriptions), 7.22 (monitoring filters).
"""

import asyncio
from collections.abc import Mapping
from importlib import import_module
from typing import Any

from sensors.feeds.opcua.history import NamedValue
from sensors.feeds.protocol import FeedError
from sensors.feeds.reconnect import LinkError

SERVER_QUEUE = 10_000  # values of a variable between two publishings, as far as the server allows


class DataChanges:
    """What a subscription brings; asyncua calls its methods by their names.

    Parameters
    ----------
    channels : mapping
        Channel of each node id.
    """

    def __init__(self, channels: Mapping[Any, str]) -> None:
        self._channels = channels
        self._waiting: asyncio.Queue[NamedValue | None] = asyncio.Queue()

    def datachange_notification(self, node: Any, value: Any, change: Any) -> None:
        """Keep a value."""
        self._waiting.put_nowait((self._channels[node.nodeid], change.monitored_item.Value))

    def status_change_notification(self, status: Any) -> None:
        """The subscription ended, or the link."""
        self._waiting.put_nowait(None)

    async def present(self, patience: float) -> list[NamedValue]:
        """The values that a subscription begins with; none where none come in time [s]."""
        try:
            return await asyncio.wait_for(self.batch(), patience)
        except TimeoutError:
            return []

    async def batch(self) -> list[NamedValue]:
        """All that waits, at least one value. Raises LinkError where the subscription ended."""
        taken = [await self._waiting.get()]
        while not self._waiting.empty():
            taken.append(self._waiting.get_nowait())
        values = [each for each in taken if each is not None]
        if not values:
            raise LinkError("the server ended it")
        if len(values) < len(taken):
            self._waiting.put_nowait(None)  # for the next call
        return values


async def subscribed(client: Any, nodes: Mapping[str, Any], interval: float) -> DataChanges:
    """What a server sends of some variables from now on.

    Parameters
    ----------
    nodes : mapping
        Variable of each channel.
    interval : float
        How often it sends what it has [ms].

    Raises
    ------
    FeedError
        If it refuses one of them.
    """
    ua = import_module("asyncua.ua")
    changes = DataChanges({node.nodeid: name for name, node in nodes.items()})
    wanted = ua.CreateSubscriptionParameters()
    wanted.RequestedPublishingInterval = interval
    wanted.RequestedMaxKeepAliveCount = client.get_keepalive_count(interval)
    wanted.RequestedLifetimeCount = 10 * wanted.RequestedMaxKeepAliveCount
    wanted.MaxNotificationsPerPublish = 0  # all that there are, so that they can be ordered
    wanted.PublishingEnabled = True
    subscription = await client.create_subscription(wanted, changes)
    items = [_item(ua, handle, node) for handle, node in enumerate(nodes.values())]
    results = await subscription.create_monitored_items(items)
    for name, result in zip(nodes, results, strict=True):
        if isinstance(result, ua.StatusCode):
            raise FeedError(f"the server refuses {name}: {result.name}")
    return changes


def _item(ua: Any, handle: int, node: Any) -> Any:
    item = ua.MonitoredItemCreateRequest()
    item.ItemToMonitor.NodeId = node.nodeid
    item.ItemToMonitor.AttributeId = ua.AttributeIds.Value
    item.MonitoringMode = ua.MonitoringMode.Reporting
    wanted = ua.MonitoringParameters()
    wanted.ClientHandle, wanted.QueueSize, wanted.DiscardOldest = handle, SERVER_QUEUE, True
    wanted.SamplingInterval = 0.0  # as fast as the server can
    wanted.Filter = ua.DataChangeFilter()
    wanted.Filter.Trigger = ua.DataChangeTrigger.StatusValueTimestamp
    item.RequestedParameters = wanted
    return item
