"""MQTT: whatever a broker passes on, by topic (needs the extra `mqtt`).

    mqtt://[USER@]HOST/TOPIC[?qos=1&format=auto&rate=40&client=NAME]

A message's format is recognised (format=auto), or given by the option: `json` (`json_samples.py`),
`float32` (`frame.py`) or `cpsens` (`cpsens.py`); mapping=NAME or mapping=FILE reads other JSON and
Sparkplug B (`mapping.py`). With client=NAME the broker keeps what comes while the link
is cut (quality of service 1 or 2), and gives it afterwards; without, it is lost, and counted where
messages are numbered. Of Sparkplug B data whose birth certificate did not come the node is asked
for it, unless rebirth=no; nothing else is ever published. A feed that remembers keeps each message
on disk until it is published (`message_journal.py`). mqtt=5 speaks MQTT 5 instead of 3.1.1.
mqtts:// checks the broker's certificate, by the authorities in ca=FILE or the system's; cert=FILE
and key=FILE are the client's own.
"""

import asyncio
import logging
import re
import socket
import ssl
import time
from collections.abc import Callable, Coroutine, Iterator, Sequence
from contextlib import suppress
from hashlib import sha256
from importlib import import_module
from typing import Any, Protocol

from sensors.bounded_dict import BoundedDict
from sensors.extras import import_extra
from sensors.feeds.address import FeedAddress
from sensors.feeds.message_journal import MessageJournal, TopicPayload
from sensors.feeds.payloads.cpsens import CpSensReader, is_cpsens
from sensors.feeds.payloads.frame import FRAME_MAGIC
from sensors.feeds.payloads.frame_reader import FrameReader
from sensors.feeds.payloads.json_samples import JsonReader, MessageError, json_of
from sensors.feeds.payloads.mapped_reader import MappedReader
from sensors.feeds.payloads.mapping import mapping_named
from sensors.feeds.payloads.scada import RisingTimes, ScadaReader
from sensors.feeds.payloads.sparkplug import RebirthRequests
from sensors.feeds.protocol import Arrival, ArrivalQueue, ChannelSamples, FeedCounts, FeedError
from sensors.feeds.reconnect import LinkError, kept_connected
from sensors.feeds.socket_reading import SocketReading, pass_over_closed_socket

logger = logging.getLogger(__name__)

FORMATS = ("auto", "json", "float32", "cpsens")
KEEP_ALIVE = 10  # a silent broker is given up after one and a half of it [s]
REFUSED_SUBSCRIPTION = 128  # SUBACK: from here on there is no subscription
_REFUSED = {4, 5, 134, 135}  # CONNACK: bad user name or password, not authorised (MQTT 3.1.1, 5)
LONGEST_TOPIC = 1000  # [characters]
LARGEST_MQTT_PAYLOAD = 2**22  # [bytes]: a second of 100 channels at 10 kHz


_CODE = re.compile(r"^\[[^\]]*\] | \(_ssl\.c:\d+\)$")


class Reader(Protocol):
    """Turns messages into arrivals."""

    def read(self, topic: str, payload: bytes, *, retained: bool) -> Iterator[Arrival]:
        """Return what a message brings. Raises MessageError."""
        ...

    def learn(self, topic: str, payload: bytes) -> None:
        """Take a message of before that describes others. Raises MessageError."""
        ...


class MqttFeed:
    """Messages of one topic filter of one broker.

    Parameters
    ----------
    address : FeedAddress
        Of the broker, with the topic filter and options.
    reader : Reader
        Of the messages.
    counts : FeedCounts
        That the reader writes too.
    once : bool
        Give up where the broker cannot be reached at the start.
    journal : MessageJournal, optional
        Of messages that are not published yet; with one the broker keeps what comes while this feed
        is away, also without client=NAME.
    asking : callable, optional
        Gives what is to be published in turn: topics and payloads.

    Raises
    ------
    FeedError
        If aiomqtt is missing, and for options that are none.
    """

    def __init__(
        self,
        address: FeedAddress,
        reader: Reader,
        counts: FeedCounts,
        *,
        once: bool,
        journal: MessageJournal | None = None,
        asking: Callable[[], Sequence[TopicPayload]] = tuple,
    ) -> None:
        self.name = address.text
        self.counts = counts
        self._address, self._reader, self._once = address, reader, once
        self._journal, self._asking = journal, asking
        self._client_id = address.options.get("client") or (
            None if journal is None else _stable_id(address)
        )
        self._aiomqtt = import_extra("aiomqtt", "mqtt", "MQTT", FeedError)
        self._is_5 = address.one_of("mqtt", ("3.1.1", "5")) == "5"
        self._qos = int(address.one_of("qos", ("1", "0", "2")))
        self._tls = _tls(address)
        self._password = address.secret("password") if address.user else ""

    async def run(self, inbox: ArrivalQueue) -> None:
        """Raises FeedError for a user or a password that the broker refuses at the start."""
        logging.getLogger("mqtt").setLevel(logging.CRITICAL)  # its own words on what is logged here

        async def session() -> None:
            await self._session(inbox)

        asyncio.get_running_loop().set_exception_handler(pass_over_closed_socket)
        await self._resume(inbox)
        try:
            await kept_connected(session, self.name, self.counts, once=self._once)
        finally:
            if self._journal is not None:
                self._journal.close()

    async def _resume(self, inbox: ArrivalQueue) -> None:
        """Take what a feed that was killed had received and not published."""
        if self._journal is None:
            return
        descriptions, messages = self._journal.resumed()
        received = self.counts.received
        for topic, payload in descriptions:
            with suppress(MessageError):
                self._reader.learn(topic, payload)
        for topic, payload in messages:
            for arrival in self._arrivals(topic, payload, retained=False):
                left: Arrival | None = arrival
                if isinstance(arrival, ChannelSamples):
                    left = self._journal.unpublished(arrival)
                if left is not None:
                    await inbox.put(left)
        self.counts.received = received  # by the feed before

    async def _session(self, inbox: ArrivalQueue) -> None:
        connection = self._client()
        reading = SocketReading(connection)
        try:
            async with connection as client:
                taking = asyncio.create_task(self._take(client, reading, inbox))
                try:  # what the broker has kept comes before its answer to a subscription
                    await self._while_taking(taking, self._subscribe(client))
                    if self.counts.connect():
                        logger.warning("%s: connected again", self.name)
                    await taking
                finally:
                    taking.cancel()
                    await asyncio.wait({taking})
        except self._aiomqtt.MqttError as error:
            code = getattr(error, "rc", None)
            if getattr(code, "value", code) in _REFUSED:
                self._refuse_user(error)
            raise LinkError(self.reason(error)) from error

    async def _take(self, client: Any, reading: SocketReading, inbox: ArrivalQueue) -> None:
        """Messages until the link is cut; what had come until then is confirmed, and stays."""
        try:
            async for message in client.messages:
                reading.go_on_if_few_wait()
                for arrival in self._of(message):
                    await inbox.put(arrival)
                for topic, payload in self._asking():
                    await client.publish(topic, payload, qos=0)
        except self._aiomqtt.MqttError:
            for message in reading.waiting():
                for arrival in self._of(message):
                    await inbox.put(arrival)
            raise

    def _of(self, message: Any) -> Iterator[Arrival]:
        topic, payload = message.topic.value, bytes(message.payload or b"")
        return self._arrivals(topic, payload, retained=message.retain)

    @staticmethod
    async def _while_taking(taking: "asyncio.Task[None]", doing: Coroutine[Any, Any, None]) -> None:
        """Do something while messages are taken. Raises what ends either of them."""
        task = asyncio.create_task(doing)
        try:
            await asyncio.wait({taking, task}, return_when=asyncio.FIRST_COMPLETED)
            if not task.done():
                taking.result()
            await task
        finally:
            task.cancel()
            await asyncio.wait({task})

    def reason(self, error: Exception) -> str:
        """Return why the link is down in few words, without the numbers of codes."""
        cause = error.__cause__ or error
        if isinstance(cause, TimeoutError) or "timed out" in str(cause):
            wanted = [] if self._address.tls else ["mqtts://"]
            if self._address.tls and "cert" not in self._address.options:
                wanted.append("a client's certificate (cert=, key=)")
            wanted += [] if self._is_5 else ["mqtt=5"]
            question = f"; does it want {' or '.join(wanted)}?" if wanted else ""
            return f"no answer as a broker gives within {KEEP_ALIVE} s{question}"
        words = getattr(cause, "strerror", None) or _CODE.sub("", str(cause))
        if words == "Unspecified error":  # paho's words where the socket was closed
            return "the broker ended it"
        return " ".join(words.split()) or type(cause).__name__

    def _refuse_user(self, error: Exception) -> None:
        if self._address.user:
            sentence = f"the broker refuses the user {self._address.user} or the password"
        else:
            sentence = (
                "the broker wants a user: mqtt://USER@HOST/…, and the password in "
                "PILEWATCH_FEED_PASSWORD or ?password-file=FILE"
            )
        if self.counts.connections:
            raise LinkError(sentence) from error
        raise FeedError(f"{self.name}: {sentence}") from error

    async def _subscribe(self, client: Any) -> None:
        topic = self._address.path
        try:
            granted = await self._granted(client, topic)
        except ValueError as error:
            raise FeedError(
                f"{self.name}: {topic!r} is no topic; + stands for a level, # for all at the end"
            ) from error
        if any(getattr(code, "value", code) >= REFUSED_SUBSCRIPTION for code in granted):
            if self.counts.connections:
                raise LinkError(f"the broker refuses the topic {topic!r}")
            raise FeedError(f"{self.name}: the broker refuses this user the topic {topic!r}")

    async def _granted(self, client: Any, topic: str) -> Any:
        """The answer to a subscription; as long as messages come it may be behind them."""
        while True:
            received = self.counts.received
            try:
                return await client.subscribe(topic, qos=self._qos)
            except self._aiomqtt.MqttError:
                if self.counts.received == received:
                    raise

    def _client(self) -> Any:
        address, versions = self._address, self._aiomqtt.ProtocolVersion
        client = self._client_id
        kept: dict[str, Any] = {"clean_session": client is None}
        if self._is_5:
            kept = {"clean_start": client is None, "properties": _kept_for_ever(client is not None)}
        connection = self._aiomqtt.Client(
            address.host,
            address.port,
            username=address.user or None,
            password=self._password or None,
            identifier=client,
            protocol=versions.V5 if self._is_5 else versions.V311,
            **kept,
            tls_context=self._tls,
            keepalive=KEEP_ALIVE,
            timeout=KEEP_ALIVE,
        )
        if self._journal is not None:
            self._keep_before_confirming(connection._client, self._journal)
        return connection

    @staticmethod
    def _keep_before_confirming(paho: Any, journal: MessageJournal) -> None:
        """Paho confirms a message after its callback has returned."""
        queue = paho.on_message

        def kept(client: Any, given: Any, message: Any) -> None:
            if is_kept(message.topic, retained=message.retain):
                payload = bytes(message.payload or b"")
                if message.dup and journal.has(message.topic, payload):
                    return  # it was taken; a sample without a number would be another one
                journal.keep(message.topic, payload)
            queue(client, given, message)

        paho.on_message = kept

    def _arrivals(self, topic: str, payload: bytes, *, retained: bool) -> Iterator[Arrival]:
        journal = self._journal if is_kept(topic, retained=retained) else None
        try:
            if len(topic) > LONGEST_TOPIC:
                raise MessageError(f"a topic of {len(topic)} letters; at most {LONGEST_TOPIC}")
            if len(payload) > LARGEST_MQTT_PAYLOAD:
                raise MessageError(f"{len(payload)} bytes; at most {LARGEST_MQTT_PAYLOAD}")
            for arrival in self._reader.read(topic, payload, retained=retained):
                if journal is not None and isinstance(arrival, ChannelSamples):
                    journal.taken(arrival)
                yield arrival
        except MessageError as error:
            self.counts.refuse(f"{topic}: {error}")
        if journal is not None:
            journal.taken(None)


def is_description(topic: str) -> bool:
    """Whether messages of a topic describe others: CP-SENS metadata, Sparkplug B certificates."""
    return topic.endswith("/metadata") or any(
        level in ("NBIRTH", "DBIRTH") for level in topic.split("/")[2:3]
    )


def is_kept(topic: str, *, retained: bool) -> bool:
    """Whether a message belongs in the journal; what a broker retained is of another time."""
    return len(topic) <= LONGEST_TOPIC and (not retained or is_description(topic))


def _stable_id(address: FeedAddress) -> str:
    """The same whenever this machine listens to this address."""
    place = f"{socket.gethostname()} {address.text}"
    return f"pilewatch-{sha256(place.encode()).hexdigest()[:12]}"  # 22 letters: MQTT 3.1.1 takes 23


def _kept_for_ever(wanted: bool) -> Any:
    """Return what makes a broker of MQTT 5 keep messages while the link is cut."""
    properties = import_module("paho.mqtt.properties").Properties(
        import_module("paho.mqtt.packettypes").PacketTypes.CONNECT
    )
    if wanted:
        properties.SessionExpiryInterval = 2**32 - 1  # [s]; the largest means for ever
    return properties


class SamplesReader:
    """Accelerations in any of the formats.

    Parameters
    ----------
    address : FeedAddress
        Its options choose.
    names : tuple of str
        Of the layout's channels.
    counts : FeedCounts
        Takes what the format's reader counts.
    """

    def __init__(self, address: FeedAddress, names: tuple[str, ...], counts: FeedCounts) -> None:
        self._format = address.one_of("format", FORMATS)
        self._counts = counts
        mapping, rate = address.options.get("mapping"), address.number("rate")
        may_ask = address.one_of("rebirth", ("yes", "no")) == "yes"
        self._rebirths = RebirthRequests() if may_ask else None
        self._mapped = (
            None
            if mapping is None
            else MappedReader(mapping_named(mapping), names, counts, rate, self._rebirths)
        )
        self._json = JsonReader(names, counts)
        self._frames = FrameReader(names, counts, address.secret("key").encode())
        self._cpsens = CpSensReader(
            names, counts, sampling_rate=address.number("rate"), clock=time.time_ns
        )

    def read(self, topic: str, payload: bytes, *, retained: bool) -> Iterator[Arrival]:
        """Yield what one message brings."""
        if self._mapped is not None:
            kind = "mapped"
        else:
            kind = self._format if self._format != "auto" else kind_of(topic, payload)
        if retained and not topic.endswith("/metadata"):
            self._counts.retained += 1  # of another time, and its number is no loss
            return
        if kind == "float32":
            piece = self._frames.read(payload, topic)
        else:
            self._counts.received += 1
            if self._mapped is not None:
                yield from self._mapped.read(payload, topic)
                return
            if kind == "json":
                yield from self._json.read(payload, topic)
                return
            piece = self._cpsens.read(payload, topic)
        if piece is not None:
            yield piece

    def asking(self) -> Sequence[TopicPayload]:
        """What senders are asked: Sparkplug B nodes for their birth certificates."""
        return () if self._rebirths is None else self._rebirths.taken()

    def learn(self, topic: str, payload: bytes) -> None:
        """Take the names of a birth certificate, or the metadata of a CP-SENS channel."""
        if self._mapped is not None:
            self._mapped.learn(payload, topic)
        else:
            self._cpsens.read(payload, topic)


def kind_of(topic: str, payload: bytes) -> str:
    """Return the format of a message. Raises MessageError where it is of none."""
    if payload.startswith(FRAME_MAGIC):
        return "float32"
    if is_cpsens(topic, payload):
        return "cpsens"
    if payload.lstrip()[:1] in (b"{", b"["):
        return "json"
    raise MessageError(f"{payload[:20]!r}… is neither JSON nor a frame nor CP-SENS")


class ScadaMessages:
    """What a controller reports as JSON, all at once or a figure a topic."""

    def __init__(self, reader: ScadaReader, counts: FeedCounts) -> None:
        self._reader, self._counts = reader, counts
        self._times: BoundedDict[str, RisingTimes] = BoundedDict()  # by topic

    def read(self, topic: str, payload: bytes, *, retained: bool) -> Iterator[Arrival]:
        """Yield the samples that one message brings."""
        self._counts.received += 1
        times = self._times.renewed(topic)
        if times is None:
            times = RisingTimes(self._counts)
            self._times.put(topic, times)
        content = json_of(payload)
        for each in content if isinstance(content, list) else [content]:
            if not isinstance(each, dict):
                raise MessageError(f"{each!r:.40} is no report; an object is")
            yield from times.taken(self._reader.sample(each))

    def learn(self, topic: str, payload: bytes) -> None:
        """A report describes no other."""


def _tls(address: FeedAddress) -> ssl.SSLContext | None:
    options = address.options
    if not address.tls:
        given = [name for name in ("ca", "cert", "key") if name in options]
        if given:
            raise FeedError(f"{address.text}: {given[0]} is for mqtts://")
        return None
    try:
        context = ssl.create_default_context(cafile=options.get("ca"))
        if "cert" in options:
            context.load_cert_chain(options["cert"], options.get("key"))
    except OSError as error:
        raise FeedError(
            f"{address.text}: its certificates cannot be read: {error.strerror or error}"
        ) from error
    return context
