"""OPC UA: the variables of a server, by subscription (extra `opcua`).

    opcua://[USER@]HOST[:4840][/PATH][?nodes=ns=2;s=Tower.{name}&security=encrypt&…]
    scada+opcua://…?wind_speed=NODE&power=NODE*1000        what a controller measures

    connect, session          user and password, or none; the channel's security below
    browse                    which variable is which channel: `nodes.py`
    subscribe                 every value with its source time stamp, also where it does not change
    history                   after a cut or a restart: what the server has kept of the gap
    data changes, for ever    one value (or array) with status and stamps each: `values.py`

security=sign or encrypt (policy=Basic256Sha256, Aes128Sha256RsaOaep, Aes256Sha256RsaPss) wants the
client's own certificate (cert=FILE, key=FILE) and the server's (server=FILE): a server that shows
another one is not talked to. interval=500 is how often values are sent [ms]; rate=, stamp=last are
for variables that are arrays. What a server's queue dropped is counted by the overflow bit of its
status codes, all other losses by the gaps in the time stamps.

Why not asyncua's own reconnection: it begins a subscription again without its gap.

A subscription brings every value, also one that equals the last.

Source: OPC 10000-4 (Services) 5.12 to 5.14, 7.22 (monitoring filters), 7.39 (status codes).
"""

import asyncio
import logging
import os
from collections.abc import AsyncIterator, Iterable, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager, suppress
from importlib import import_module
from typing import Any, Protocol

from sensors.acquisition.blocks import NANOSECONDS
from sensors.extras import import_extra
from sensors.feeds.address import FeedAddress
from sensors.feeds.opcua.history import NamedValue, history
from sensors.feeds.opcua.nodes import SeenVariable, declared_nodes, found_nodes, variables_of
from sensors.feeds.opcua.security import check_security, secure
from sensors.feeds.opcua.values import content_of, stamp_ns
from sensors.feeds.position import FeedPosition
from sensors.feeds.protocol import Arrival, ArrivalQueue, ChannelSamples, FeedCounts, FeedError
from sensors.feeds.reconnect import LinkError, kept_connected

logger = logging.getLogger(__name__)

SERVER_ANSWER = 10.0  # for one of the server's answers [s]
GOODBYE = 2.0  # for the answer to a session's end [s]
PUBLISHING = 500.0  # how often the server sends what it has [ms]
SESSION_KEPT = 60_000  # without this client, by the server [ms]
SEAM = NANOSECONDS  # read again after a restart: what was published is left out by its time [ns]
MOST_VALUES_WAITING = 200_000  # values of all variables, some 200 MB, while a history is read
_USER_REFUSED = ("BadUserAccessDenied", "BadIdentityTokenRejected", "BadIdentityTokenInvalid")
_FINAL = (  # answers that no second attempt changes
    "BadUserAccessDenied",
    "BadIdentityToken",
    "BadCertificate",
    "BadSecurityChecksFailed",
    "BadSecurityPolicyRejected",
    "BadSecurityModeRejected",
)
SERVER_QUEUE = 10_000  # values of a variable between two publishings, as far as the server allows


class DataChanges:
    """What a subscription brings; asyncua calls its methods by their names.

    Parameters
    ----------
    channels : mapping
        Channel of each node id.

    Notes
    -----
    Where more than MOST_VALUES_WAITING wait it counts as ended: the next session reads what follows
    from the server's history.
    """

    def __init__(self, channels: Mapping[Any, str]) -> None:
        self._channels = channels
        self._waiting: asyncio.Queue[NamedValue | None] = asyncio.Queue()
        self._is_full = False

    def datachange_notification(self, node: Any, value: Any, change: Any) -> None:
        """Keep a value."""
        if not self._is_full and self._waiting.qsize() >= MOST_VALUES_WAITING:
            self._is_full = True
            self._waiting.put_nowait(None)
        if self._is_full:
            return  # all that follow: later ones alone would be behind a gap
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
            full = f"more than {MOST_VALUES_WAITING} values waited to be read"
            raise LinkError(full if self._is_full else "the server ended it")
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


class ValuesReader(Protocol):
    """Turns data values into arrivals."""

    newest_ns: dict[str, int]
    """Time of the last value of each channel, where a history is wanted [ns]."""

    def pass_over_known(self) -> None:
        """Values up to the newest may come again."""
        ...

    def read(self, name: str, value: Any) -> Iterator[Arrival]:
        """Return what a channel's data value brings."""
        ...


class OpcUaFeed:
    """The values of some variables of one server.

    Parameters
    ----------
    address : FeedAddress
        Its options choose.
    names : sequence of str
        Of the variables.
    reader : ValuesReader
        Of their values.
    counts : FeedCounts
        That the reader writes too.
    once : bool
        Give up where the server cannot be reached at the start.
    position : FeedPosition, optional
        How far it was published before.

    Raises
    ------
    FeedError
        If asyncua is missing, and for options that are none.
    """

    def __init__(
        self,
        address: FeedAddress,
        names: Sequence[str],
        reader: ValuesReader,
        counts: FeedCounts,
        *,
        once: bool,
        position: FeedPosition | None = None,
    ) -> None:
        self.name = address.text
        self.counts, self._reader = counts, reader
        self._asyncua = import_extra("asyncua", "opcua", "OPC UA", FeedError)
        self._ua = import_module("asyncua.ua")
        self._address, self._names, self._once = address, tuple(names), once
        self._position = position or FeedPosition(None)
        self._declared = declared_nodes(address.options.get("nodes", ""), self._names)
        self._interval = address.number("interval", PUBLISHING) or PUBLISHING
        self._password = address.secret("password") if address.user else ""
        check_security(address)

    async def run(self, inbox: ArrivalQueue) -> None:
        """Raises FeedError for a user, a certificate or variables that the server refuses."""
        logging.getLogger("asyncua").setLevel(logging.CRITICAL)  # its words on what is logged here

        async def session() -> None:
            await self._session(inbox)

        await kept_connected(session, self.name, self.counts, once=self._once)

    async def _session(self, inbox: ArrivalQueue) -> None:
        async with self._connection() as client:
            try:
                found = await found_nodes(client, self._names, self._declared)
                nodes = dict(zip(self._names, found, strict=True))
                changes = await subscribed(client, nodes, self._interval)
            except FeedError as error:
                self._refuse(str(error), error)
            if self.counts.connect():
                logger.warning("%s: connected again", self.name)
            present = await changes.present(2 * self._interval / 1000 + 1)
            await self._catch_up(client, nodes, present, inbox)
            await self._put(inbox, present)
            while True:
                await self._put(inbox, await changes.batch())

    async def variables(self) -> list[SeenVariable]:
        """Every variable of the server with its present value.

        Raises
        ------
        FeedError
            If it cannot be reached.
        """
        logging.getLogger("asyncua").setLevel(logging.CRITICAL)
        try:
            async with self._connection() as client:
                found = await variables_of(client)
                values = await client.read_attributes([each.node for each in found])
        except LinkError as error:
            raise FeedError(f"{self.name} cannot be reached: {error}") from error
        return [
            SeenVariable(
                each.path, each.node.nodeid.to_string(), content_of(value), stamp_ns(value)
            )
            for each, value in zip(found, values, strict=True)
        ]

    async def _put(self, inbox: ArrivalQueue, values: Iterable[NamedValue]) -> None:
        """In order of time: a server sends one variable after the other."""
        arrivals = [each for name, value in values for each in self._reader.read(name, value)]
        for arrival in sorted(arrivals, key=_time_ns):
            await inbox.put(arrival)

    @asynccontextmanager
    async def _connection(self) -> AsyncIterator[Any]:
        """A session. Raises LinkError where it cannot be made, or is cut."""
        client = self._client()
        try:
            await self._secured(client)
            await client.connect()
            yield client
        except self._ua.UaStatusCodeError as error:
            reason = f"{type(error).__name__}: {_sentence(error)}"
            if self._address.user and type(error).__name__ in _USER_REFUSED:
                reason = f"the server refuses the user {self._address.user} or the password"
            if type(error).__name__.startswith(_FINAL):
                self._refuse(reason, error)
            raise LinkError(reason) from error
        except self._ua.UaError as error:
            raise LinkError(_sentence(error)) from error
        except TimeoutError as error:
            raise LinkError(
                f"no answer as an OPC UA server gives within {SERVER_ANSWER:g} s"
            ) from error
        except OSError as error:
            raise LinkError(_sentence(error)) from error
        finally:
            with suppress(self._ua.UaError, OSError, TimeoutError):
                await asyncio.wait_for(client.disconnect(), GOODBYE)

    def _refuse(self, sentence: str, error: Exception) -> None:
        """Raise what a person must correct at the start; later the server may be restarting."""
        if self.counts.connections:
            raise LinkError(sentence) from error
        raise FeedError(f"{self.name}: {sentence}") from error

    async def _secured(self, client: Any) -> None:
        try:
            await secure(client, self._address)
        except FeedError as error:
            self._refuse(str(error).removeprefix(f"{self.name}: "), error)

    def _client(self) -> Any:
        address = self._address
        host = f"[{address.host}]" if ":" in address.host else address.host
        url = f"opc.tcp://{host}:{address.port}/{address.path}"
        client = self._asyncua.Client(url, timeout=SERVER_ANSWER, watchdog_intervall=SERVER_ANSWER)
        client.session_timeout = SESSION_KEPT
        client.name = client.description = "pilewatch"
        client.application_uri = "urn:pilewatch:feed"
        if address.user:
            client.set_user(address.user)
            client.set_password(self._password)
        return client

    async def _catch_up(
        self,
        client: Any,
        nodes: Mapping[str, Any],
        present: Iterable[NamedValue],
        inbox: ArrivalQueue,
    ) -> None:
        """Put what the server has kept between the last values and the present ones."""
        reader, resumed_ns = self._reader, self._position.resumed_ns
        known = {name: reader.newest_ns.get(name, resumed_ns - SEAM) for name in nodes}
        if min(known.values()) <= 0:
            return
        try:
            async for values in history(client, nodes, known, present):
                await self._put(inbox, values)
        except self._ua.UaStatusCodeError as error:
            logger.warning(
                "%s keeps no history (%s): the gap stays", self.name, type(error).__name__
            )
        reader.pass_over_known()


def _time_ns(arrival: Arrival) -> int:
    return arrival.start_ns if isinstance(arrival, ChannelSamples) else arrival.time_ns


def _sentence(error: Exception) -> str:
    """Return what an error says, in one line."""
    number = getattr(
        error, "errno", None
    )  # asyncio puts the address where the system's words belong
    words = os.strerror(number) if number and number > 0 else str(error)
    return " ".join(words.split()) or type(error).__name__
