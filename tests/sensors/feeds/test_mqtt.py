"""MQTT through a real broker."""

import asyncio
import json
import socket
import socketserver
import struct
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from aiomqtt import MqttError
from paho.mqtt import client as paho
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.deploy.certificates import make_certificates
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.scada import ScadaSample
from sensors.feeds.address import parsed
from sensors.feeds.live import LiveFeed, Measured
from sensors.feeds.mqtt import MqttFeed, SamplesReader
from sensors.feeds.open_feed import open_feed
from sensors.feeds.payloads.frame import Frame, encoded
from sensors.feeds.position import position_file
from sensors.feeds.protocol import FeedCounts, FeedError
from sensors.feeds.socket_reading import pass_over_closed_socket
from sensors.files.layout_file import LayoutFile, MappedChannel
from tests.sensors.feeds.broker import Broker, broker, free_port, mosquitto, publisher
from tests.sensors.feeds.payloads.shapes import sparkplug, thingsboard
from tests.sensors.feeds.scripted import measured_until

X, Y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
LAYOUT = LayoutFile((MappedChannel("ax", 100.0, X), MappedChannel("ay", 100.0, Y)), "t1", "top")
START = 1_700_000_000 * NANOSECONDS
RATE = 40

pytestmark = pytest.mark.skipif(mosquitto() is None, reason="mosquitto is not installed")


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Broker]:
    with broker(tmp_path_factory.mktemp("broker")) as made:
        yield made


def frame(number: int, session: int = 1) -> bytes:
    samples = np.full((RATE, 2), float(number))
    start_ns = START + number * NANOSECONDS
    return encoded(Frame(number, session, start_ns, RATE, samples, ("ax", "ay")))


def blocks_of(given: list[Measured]) -> list[AccelerationBlock]:
    return [each for each in given if isinstance(each, AccelerationBlock)]


def test_frames_become_blocks(running: Broker) -> None:
    live = open_feed(f"mqtt://127.0.0.1:{running.port}/frames/#", LAYOUT)
    with publisher(running.port) as sender:

        def send() -> None:
            for number in range(6):
                sender.publish("frames/top", frame(number))

        given = measured_until(live, lambda: live.counts.received == 6, send)
    blocks = blocks_of(given)
    assert [block.samples[0, 1] for block in blocks] == [0, 1, 2, 3, 4, 5]
    assert [block.start_ns for block in blocks] == [START + i * NANOSECONDS for i in range(6)]


def test_channels_on_json_topics_of_their_own_are_put_together(running: Broker) -> None:
    live = open_feed(f"mqtt://127.0.0.1:{running.port}/json/+", LAYOUT)
    with publisher(running.port) as sender:

        def send() -> None:
            for number in range(5):
                for offset, name in enumerate(("ax", "ay")):
                    values = [number + offset] * RATE
                    said = {"time": 1_700_000_000 + number, "rate": RATE, "value": values}
                    sender.publish(f"json/{name}", json.dumps(said))

        given = measured_until(live, lambda: live.counts.received == 10, send)
    assert [tuple(block.samples[0]) for block in blocks_of(given)] == [(i, i + 1) for i in range(5)]


def test_cpsens_metadata_that_were_said_before_are_known(running: Broker) -> None:
    layout = LayoutFile((MappedChannel("1", 100.0, X), MappedChannel("2", 100.0, Y)), "t1", "top")
    live = open_feed(f"mqtt://127.0.0.1:{running.port}/cpsens/#", layout)
    metadata = {
        "Data": {"Type": "float", "Unit": "m/s^2"},
        "Analysis chain": [{"Sampling": 64.0}],
    }
    with publisher(running.port) as sender:
        for channel in (1, 2):
            topic = f"cpsens/daq/module/{channel}/acc/raw/metadata"
            sender.publish(topic, json.dumps(metadata), retain=True)
        sender.settled()

        def send() -> None:
            for number in range(12):
                for channel in (1, 2):
                    seconds, rest = divmod(number * 500_000_000, NANOSECONDS)
                    head = struct.pack("<HHQQQ", 28, 2, 1_700_000_000 + seconds, rest, number * 32)
                    values = struct.pack("<32f", *[number + channel] * 32)
                    sender.publish(f"cpsens/daq/module/{channel}/acc/raw/data", head + values)

        given = measured_until(live, lambda: live.counts.received == 26, send)
    blocks = blocks_of(given)
    samples = np.concatenate([block.samples for block in blocks])
    np.testing.assert_array_equal(samples[::32], [(i + 1, i + 2) for i in range(12)])
    assert live.counts.malformed == 0


def test_a_retained_measurement_is_of_another_time_and_left_out(running: Broker) -> None:
    live = open_feed(f"mqtt://127.0.0.1:{running.port}/kept/#", LAYOUT)
    with publisher(running.port) as sender:
        sender.publish("kept/top", frame(3), retain=True)
        sender.settled()

        def send() -> None:
            for number in range(100, 104):
                sender.publish("kept/top", frame(number))

        given = measured_until(live, lambda: live.counts.received == 4, send)
    assert [block.samples[0, 0] for block in blocks_of(given)] == [100, 101, 102, 103]
    assert (live.counts.lost, live.counts.retained) == (0, 1)


def test_what_is_nothing_is_counted_and_told(running: Broker) -> None:
    live = open_feed(f"mqtt://127.0.0.1:{running.port}/nothing/#", LAYOUT)
    with publisher(running.port) as sender:

        def send() -> None:
            for payload in (b"", b"\x00\xff", b"{", b"PWB1", b'{"time": 1}'):
                sender.publish("nothing/x", payload)

        measured_until(live, lambda: live.counts.malformed == 5, send)
    assert live.counts.refusal == "nothing/x: no values in it"


def test_what_the_controller_says_is_a_scada_sample(running: Broker) -> None:
    address = f"scada+mqtt://127.0.0.1:{running.port}/scada?wind_speed=Wind.Avg&power=P_kW*1000"
    live = open_feed(address, LAYOUT, turbine="t9")
    said = {"time": "2023-11-14T22:13:20Z", "Wind.Avg": "9.5", "P_kW": 3.2, "state": "Parked"}
    with publisher(running.port) as sender:
        given = measured_until(
            live,
            lambda: live.counts.received == 2,
            lambda: [sender.publish("scada", json.dumps(each)) for each in ({}, said)],
        )
    (sample,) = given
    assert isinstance(sample, ScadaSample)
    assert (sample.turbine, sample.time_ns, sample.state) == ("t9", START, "parked")
    assert (sample.wind_speed, sample.power) == (9.5, 3200.0)
    assert np.isnan(sample.yaw)
    assert live.counts.refusal == "scada: no 'time' in it; it has "


def test_a_broker_that_dies_and_comes_back_is_found_again_and_the_loss_is_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with broker(tmp_path) as dying:
        live = open_feed(f"mqtt://127.0.0.1:{dying.port}/#?qos=0", LAYOUT)
        deaths: list[int] = []

        def before() -> None:
            with publisher(dying.port) as sender:
                for number in range(5):
                    sender.publish("top", frame(number))
                sender.settled()

        def die() -> bool:
            if live.counts.received == 5 and not deaths:
                deaths.append(1)
                dying.kill()
                dying.start()  # frames 5 to 64 are measured and nobody hears them
            return live.counts.received == 10

        def after() -> None:
            with publisher(dying.port) as sender:
                for number in range(65, 70):
                    sender.publish("top", frame(number))
                sender.settled()

        blocks = blocks_of(measured_until(live, die, before, after))
    assert [block.samples[0, 0] for block in blocks] == [0, 1, 2, 3, 4, 65, 66, 67, 68, 69]
    assert [block.sequence for block in blocks] == [0, 1, 2, 3, 4, 65, 66, 67, 68, 69]
    assert (live.counts.lost, live.missing_blocks, live.counts.connections) == (60, 60, 2)
    assert any("the link was cut" in line for line in caplog.messages)
    assert caplog.messages[-1].endswith("connected again")


@pytest.mark.parametrize("version", ["3.1.1", "5"])
def test_with_a_name_the_broker_keeps_what_comes_while_nobody_listens(
    running: Broker, version: str
) -> None:
    topic = f"named/{version}"
    address = f"mqtt://127.0.0.1:{running.port}/{topic}?client=tower-{version}&mqtt={version}"
    first, second = open_feed(address, LAYOUT), open_feed(address, LAYOUT)
    with publisher(running.port) as sender:
        measured_until(
            first, lambda: first.counts.received == 1, lambda: sender.publish(topic, frame(0))
        )
        for number in range(1, 6):
            sender.publish(topic, frame(number))
        sender.settled()
        given = measured_until(second, lambda: second.counts.received == 5)
    assert [block.samples[0, 0] for block in blocks_of(given)] == [1, 2, 3, 4, 5]


def test_a_password_that_is_refused_is_one_line_and_the_right_one_lets_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    passwords = tmp_path / "passwords"
    program = Path(mosquitto() or "").with_name("mosquitto_passwd")
    if not program.exists():
        program = Path("/usr/bin/mosquitto_passwd")
    subprocess.run([program, "-b", "-c", passwords, "unit", "right"], check=True)
    passwords.chmod(0o644)
    with broker(tmp_path, "allow_anonymous false", f"password_file {passwords}") as closed:
        address = f"mqtt://unit@127.0.0.1:{closed.port}/#"
        monkeypatch.setenv("PILEWATCH_FEED_PASSWORD", "wrong")
        with pytest.raises(FeedError, match="refuses the user unit or the password") as caught:
            list(open_feed(address, LAYOUT).measured(threading.Event()))
        assert "wrong" not in str(caught.value)
        with pytest.raises(FeedError, match=r"the broker wants a user: mqtt://USER@HOST"):
            list(open_feed(f"mqtt://127.0.0.1:{closed.port}/#", LAYOUT).measured(threading.Event()))
        monkeypatch.setenv("PILEWATCH_FEED_PASSWORD", "right")
        live = open_feed(address, LAYOUT)
        measured_until(live, lambda: live.counts.connected)


@pytest.mark.parametrize("qos", [0, 2])
def test_every_quality_of_service_brings_each_frame_once(running: Broker, qos: int) -> None:
    live = open_feed(f"mqtt://127.0.0.1:{running.port}/qos{qos}/#?qos={qos}", LAYOUT)
    with publisher(running.port) as sender:

        def send() -> None:
            for number in range(5):
                sender.publish(f"qos{qos}/top", frame(number), qos=qos)

        given = measured_until(live, lambda: live.counts.received == 5, send)
    assert [block.samples[0, 0] for block in blocks_of(given)] == [0, 1, 2, 3, 4]
    assert (live.counts.lost, live.counts.duplicate) == (0, 0)


class RefusingBroker(socketserver.StreamRequestHandler):
    """Lets everybody in and grants no topic (MQTT 3.1.1)."""

    def handle(self) -> None:
        def packet() -> tuple[int, bytes]:
            kind, length = self.rfile.read(2)  # none is longer than 127 bytes
            return kind >> 4, self.rfile.read(length)

        assert packet()[0] == 1  # CONNECT
        self.wfile.write(b"\x20\x02\x00\x00")  # CONNACK: welcome
        kind, content = packet()
        assert kind == 8  # SUBSCRIBE
        self.wfile.write(b"\x90\x03" + content[:2] + b"\x80")  # SUBACK: failure
        self.rfile.read(2)


def test_a_topic_that_the_broker_refuses_is_one_line() -> None:
    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), RefusingBroker) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        live = open_feed(f"mqtt://127.0.0.1:{server.server_address[1]}/a/#", LAYOUT)
        with pytest.raises(FeedError, match="refuses this user the topic 'a/#'"):
            list(live.measured(threading.Event()))
        server.shutdown()


def test_what_is_said_of_a_link_is_for_people() -> None:
    feed = MqttFeed(parsed("mqtt://h/t"), SamplesReader(parsed("mqtt://h/t"), (), FeedCounts()),
                    FeedCounts(), once=True)  # fmt: skip
    said = {
        feed.reason(error)
        for error in (
            MqttError("[Errno 111] Connection refused"),
            MqttError("[code:135] Not authorized"),
            MqttError("Operation timed out"),
            MqttError("Unspecified error"),
        )
    }
    assert said == {
        "Connection refused",
        "Not authorized",
        "the broker ended it",
        "no answer as a broker gives within 10 s; does it want mqtts:// or mqtt=5?",
    }


def test_a_topic_that_is_none_is_one_line(running: Broker) -> None:
    live = open_feed(f"mqtt://127.0.0.1:{running.port}/a/#/b", LAYOUT)
    with pytest.raises(FeedError, match=r"'a/#/b' is no topic"):
        list(live.measured(threading.Event()))


def test_tls_knows_the_broker_by_its_certificate(tmp_path: Path) -> None:
    make_certificates(tmp_path, ["broker"], host="localhost")
    for path in tmp_path.iterdir():
        path.chmod(0o644)
    lines = [f"certfile {tmp_path}/broker.pem", f"keyfile {tmp_path}/broker-key.pem"]
    with broker(tmp_path, *lines) as encrypted:
        address = f"mqtts://localhost:{encrypted.port}/#"
        live = open_feed(f"{address}?ca={tmp_path}/ca.pem", LAYOUT)
        measured_until(live, lambda: live.counts.connected)
        with pytest.raises(FeedError, match=r"cannot be reached: .*certificate verify failed"):
            list(open_feed(address, LAYOUT, once=True).measured(threading.Event()))


def test_nobody_at_the_start_is_one_line_with_once_and_patience_without() -> None:
    address = f"mqtt://127.0.0.1:{free_port()}/#"
    with pytest.raises(FeedError, match=r"cannot be reached: .*refused") as caught:
        list(open_feed(address, LAYOUT, once=True).measured(threading.Event()))
    assert "\n" not in str(caught.value)
    live = open_feed(address, LAYOUT)
    assert measured_until(live, lambda: bool(live.counts.problem)) == []


@pytest.mark.parametrize(
    ("query", "sentence"),
    [
        ("qos=3", "qos=3 is none of 1, 0, 2"),
        ("format=xml", "format=xml is none of auto, json, float32, cpsens"),
        ("ca=x.pem", "ca is for mqtts://"),
    ],
)
def test_options_that_are_none_are_one_line(query: str, sentence: str) -> None:
    with pytest.raises(FeedError, match=sentence):
        open_feed(f"mqtt://h/t?{query}", LAYOUT)


def test_a_missing_package_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "aiomqtt", None)
    with pytest.raises(FeedError, match=r"pip install 'pilewatch\[mqtt\]'"):
        open_feed("mqtt://h/t", LAYOUT)


@pytest.mark.parametrize("may_ask", [True, False])
def test_a_sparkplug_node_is_asked_for_its_birth_certificate_unless_that_is_forbidden(
    running: Broker, may_ask: bool
) -> None:
    birth, *data = sparkplug()
    asked: list[tuple[str, bytes, bool]] = []
    option = "" if may_ask else "&rebirth=no"
    address = (
        f"mqtt://127.0.0.1:{running.port}/spBv1.0/farm/+/edge/#?mapping=sparkplug-b&rate=40{option}"
    )
    live = open_feed(address, LAYOUT)
    node: Any = paho.Client(paho.CallbackAPIVersion.VERSION2)

    def answer(client: Any, _: Any, message: Any) -> None:
        asked.append((message.topic, message.payload, message.retain))
        client.publish(*birth, qos=1)
        for topic, payload in data[20:]:
            client.publish(topic, payload, qos=1)

    node.on_message = answer
    node.on_connect = lambda client, *_: client.subscribe("spBv1.0/farm/NCMD/edge", 1)
    node.connect("127.0.0.1", running.port)
    node.loop_start()

    def publish() -> None:
        for topic, payload in data[:20]:
            node.publish(topic, payload, qos=1)

    given = measured_until(live, lambda: live.counts.received >= (40 if may_ask else 20), publish)
    node.loop_stop()
    assert live.counts.malformed == 20
    if not may_ask:
        assert "ask the node for another" in live.counts.refusal
        assert not asked
        return
    ((topic, payload, retained),) = asked
    assert (topic, retained) == ("spBv1.0/farm/NCMD/edge", False)
    assert b"Node Control/Rebirth" in payload
    assert sum(len(block.samples) for block in blocks_of(given)) >= 19


def test_sniffing_prints_what_comes_and_the_preset_that_reads_it(running: Broker) -> None:
    listening = threading.Event()

    def publish() -> None:
        with publisher(running.port) as client:
            while not listening.wait(0.05):
                for topic, payload in thingsboard():
                    client.publish(topic, payload)

    thread = threading.Thread(target=publish)
    thread.start()
    address = f"mqtt://127.0.0.1:{running.port}/v1/#"
    done = CliRunner().invoke(app, ["feed", address, "--sniff", "--for", "1"])
    listening.set()
    thread.join()

    assert done.exit_code == 0, done.output
    assert "use ?mapping=thingsboard" in done.stdout
    assert "samples of ax" in done.stdout


def test_a_feed_that_remembers_gets_what_came_while_it_was_away_and_counts_what_did_not(
    running: Broker, tmp_path: Path
) -> None:
    address = f"mqtt://127.0.0.1:{running.port}/kept/#"

    def taken(count: int, numbers: Sequence[int]) -> tuple[list[AccelerationBlock], LiveFeed]:
        live = open_feed(address, LAYOUT, state=tmp_path)

        def publish() -> None:
            with publisher(running.port) as client:
                for number in numbers:
                    client.publish("kept/a", frame(number))
                client.settled()

        return blocks_of(measured_until(live, lambda: live.counts.received >= count, publish)), live

    first, _ = taken(10, range(10))
    with publisher(running.port) as client:
        for number in range(10, 20):  # while no feed runs
            client.publish("kept/a", frame(number))
        client.settled()
    second, live = taken(15, range(20, 25))
    third, later = taken(5, range(25, 30))

    numbers = [int(block.samples[0, 0]) for block in (*first, *second, *third)]
    assert numbers == list(range(30))
    assert (live.absent, later.absent) == (0, 0)


def test_a_killed_feed_publishes_what_it_had_confirmed_and_not_published(
    running: Broker, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Blocks last a second: half of one was in memory alone, and the broker had forgotten it."""
    monkeypatch.setattr("sensors.feeds.position.SAVED_EVERY", 0.0)
    address = f"mqtt://127.0.0.1:{running.port}/killed/#?rate={RATE}"

    def publish(begin: int, end: int) -> None:
        with publisher(running.port) as client:
            for number in range(begin, end):
                sample = {"time": START / 1e9 + number / RATE, "ax": number, "ay": 0.0}
                client.publish("killed/a", json.dumps(sample).encode())
            client.settled()

    live = open_feed(address, LAYOUT, state=tmp_path)
    blocks: list[AccelerationBlock] = []
    sent = False
    for each in live.measured(threading.Event()):
        if isinstance(each, AccelerationBlock):
            blocks.append(each)
        if live.counts.connected and not sent:
            publish(0, 100)
            sent = True
        if each is None and live.counts.received >= 100:
            break  # nothing is written or finished
    assert sum(len(block.samples) for block in blocks) == 80
    again = open_feed(address, LAYOUT, state=tmp_path)
    given = measured_until(again, lambda: again.counts.received >= 60, lambda: publish(100, 160))

    numbers = [int(x) for block in (*blocks, *blocks_of(given)) for x in block.samples[:, 0]]
    assert numbers == list(range(160))
    assert again.absent == 0


def test_what_a_broker_has_kept_comes_whole_however_much_it_is(
    running: Broker, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It comes before the broker's answer to the subscription."""
    monkeypatch.setattr("sensors.feeds.socket_reading.WAITING_MESSAGES", 20)
    address = f"mqtt://127.0.0.1:{running.port}/many/#?client=many-{free_port()}"
    live = open_feed(address, LAYOUT)
    measured_until(live, lambda: live.counts.connected, lambda: None)
    with publisher(running.port) as client:
        for number in range(500):
            client.publish("many/a", frame(number))
        client.settled()
    again = open_feed(address, LAYOUT)
    given = measured_until(again, lambda: again.counts.received >= 500, lambda: None)

    assert [int(block.samples[0, 0]) for block in blocks_of(given)] == list(range(500))
    assert (again.counts.lost, again.counts.connections) == (0, 1)


def test_what_a_broker_did_not_keep_is_counted_by_the_stamps(
    running: Broker, tmp_path: Path
) -> None:
    address = f"mqtt://127.0.0.1:{running.port}/lost/#?client=none-{free_port()}"
    live = open_feed(address, LAYOUT, state=tmp_path)

    def publish(numbers: Sequence[int]) -> None:
        with publisher(running.port) as client:
            for number in numbers:
                client.publish("lost/a", frame(number))
            client.settled()

    measured_until(live, lambda: live.counts.received >= 5, lambda: publish(range(5)))
    (file,) = tmp_path.glob("*.json")
    other = f"{address}-2"  # a session that the broker does not know
    file.rename(position_file(tmp_path, other))
    again = open_feed(other, LAYOUT, state=tmp_path)
    measured_until(again, lambda: again.counts.received >= 5, lambda: publish(range(12, 17)))

    assert again.absent == 7.0


def test_a_socket_that_is_closed_before_the_loop_watches_it_is_no_traceback(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def watch_closed() -> None:
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(pass_over_closed_socket)
        with socket.socket() as ended:
            number = ended.fileno()
        loop.call_soon(loop.add_reader, number, print)
        loop.call_soon(int, "another error")
        await asyncio.sleep(0)

    asyncio.run(watch_closed())
    assert [str(record.exc_info[1]) for record in caplog.records if record.exc_info] == [
        "invalid literal for int() with base 10: 'another error'"
    ]
