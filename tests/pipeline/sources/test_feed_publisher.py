"""A live instrument on the bus."""

import json
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from pipeline.cli import main
from pipeline.messages import Message, NodeStatus, StreamEnd
from pipeline.run.options import SessionOptions
from pipeline.run.run import run_session
from pipeline.scenario import Scenario
from pipeline.sources.feed_publisher import FeedAccount, publish_feed
from pipeline.sources.sources import Source
from pipeline.transport.bus import Inbox
from pipeline.transport.zenoh_bus import ZenohBus, ZenohSettings, free_endpoint, hub
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.scada import ScadaSample
from sensors.feeds.assembly.assembler import Assembler
from sensors.feeds.assembly.channel_map import sensor_layout
from sensors.feeds.live import LiveFeed
from sensors.feeds.open_feed import layout_file_of, open_feed
from sensors.feeds.protocol import ChannelSamples
from sensors.files.layout_file import LayoutFile, MappedChannel
from tests.pipeline.transport.test_bus import PATIENCE
from tests.sensors.feeds.scripted import ScriptedFeed
from tests.sensors.feeds.test_udp import frame

START = 1_700_000_000 * NANOSECONDS
LAYOUT = LayoutFile((MappedChannel("ax", 100.0, (1.0, 0.0, 0.0)),), "t1", "top")


def second(number: int, names: tuple[str, ...] = ("ax",)) -> ChannelSamples:
    samples = np.full((40, len(names)), float(number))
    return ChannelSamples("a", names, samples, START + number * NANOSECONDS, 40.0)


def told_of(feed: ScriptedFeed, stopping: threading.Event) -> list[Message]:
    live = LiveFeed(feed, Assembler(LAYOUT, feed.counts))
    return list(FeedAccount(live, sensor_layout(LAYOUT), lambda: START).messages(stopping))


def test_a_feed_says_its_layout_then_its_blocks_and_at_the_end_what_was_missing() -> None:
    stopping = threading.Event()
    feed = ScriptedFeed([second(i) for i in range(10) if i != 4], stopping.set)
    feed.counts.lost = 1
    reached: list[str] = []
    live = LiveFeed(feed, Assembler(LAYOUT, feed.counts))
    account = FeedAccount(
        live, sensor_layout(LAYOUT), lambda: START, connected=lambda: reached.append("reached")
    )
    layout, ready, *blocks, last = account.messages(stopping)
    assert reached == ["reached"]
    assert isinstance(layout, SensorLayout)
    assert isinstance(ready, NodeStatus)
    assert [block.sequence for block in blocks if isinstance(block, AccelerationBlock)] == [
        0, 1, 2, 3, 5, 6, 7, 8, 9,
    ]  # fmt: skip
    assert isinstance(last, NodeStatus)
    assert (last.turbine, last.node, last.state) == ("t1", "feed-top", "stopped")
    assert (last.lost, last.last_sequence) == (1, 9)
    assert [warning.code for warning in last.warnings] == ["gap"]


def test_channels_that_no_layout_lists_are_named(caplog: pytest.LogCaptureFixture) -> None:
    stopping = threading.Event()
    feed = ScriptedFeed([second(i, ("ax", "temp")) for i in range(4)], stopping.set)
    *_, last = told_of(feed, stopping)
    assert isinstance(last, NodeStatus)
    assert last.warnings[0].text == "scripted sends what no layout lists: temp"
    assert caplog.messages == ["scripted: no layout lists the channel 'temp'"]


def test_a_link_that_is_up_and_brings_nothing_is_logged_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    stopping, feed = threading.Event(), ScriptedFeed([])
    feed.counts.connections = 1
    moments = [START]

    def clock() -> int:
        moments[0] += 30 * NANOSECONDS
        if moments[0] > START + 400 * NANOSECONDS:
            stopping.set()
        return moments[0]

    live = LiveFeed(feed, Assembler(LAYOUT, feed.counts))
    *_, last = FeedAccount(live, sensor_layout(LAYOUT), clock).messages(stopping)
    assert isinstance(last, NodeStatus)
    sentence = (
        "scripted: the link is up and nothing has ever come; is the address right, is data sent, "
        "and may this user read it?"
    )
    assert caplog.messages == [sentence]
    assert [(warning.code, warning.text) for warning in last.warnings] == [("quiet", sentence)]


def test_an_instrument_that_was_never_reached_is_reported_at_the_end() -> None:
    stopping, feed = threading.Event(), ScriptedFeed([])
    feed.counts.problem = "Connection refused"
    stopping.set()
    *_, last = told_of(feed, stopping)
    assert isinstance(last, NodeStatus)
    assert [(each.code, each.text) for each in last.warnings] == [
        ("link-down", "scripted: Connection refused")
    ]


def test_a_feed_of_the_controller_says_no_layout() -> None:
    stopping = threading.Event()
    sample = ScadaSample("t1", START, "parked", 9.0, 0.0, 90.0, 0.0, 0.0, 0.1)
    live = LiveFeed(ScriptedFeed([sample], stopping.set), None)
    ready, published, last = FeedAccount(live, sensor_layout(LAYOUT)).messages(stopping)
    assert published == sample
    assert isinstance(ready, NodeStatus)
    assert isinstance(last, NodeStatus)
    assert last.node == "feed-scada"


def test_what_comes_by_udp_is_received_over_zenoh() -> None:
    endpoint, stopping, inbox = free_endpoint(), threading.Event(), Inbox()
    live = open_feed("udp://:0", LAYOUT)

    def send() -> None:
        with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as sender:
            for number in range(5):
                sender.sendto(frame(number), ("127.0.0.1", live.port))

    heard: list[Message] = []
    sent = False
    with closing(ZenohBus(hub(endpoint))) as bus:
        bus.subscribe((SensorLayout, AccelerationBlock, NodeStatus, StreamEnd), inbox)
        publisher = threading.Thread(
            target=publish_feed,
            args=(live, sensor_layout(LAYOUT), ZenohSettings(connect=(endpoint,))),
            kwargs={"stopping": stopping},
        )
        publisher.start()
        while (message := inbox.get(timeout=20.0)) is not None:
            heard.append(message)
            if isinstance(message, NodeStatus) and message.state == "running":
                if message.received[0].count == 5:
                    stopping.set()
                elif not sent:
                    sent = True
                    send()
            if isinstance(message, StreamEnd):
                break
        publisher.join()
    assert [each for each in heard if isinstance(each, SensorLayout)] == [sensor_layout(LAYOUT)]
    blocks = [each for each in heard if isinstance(each, AccelerationBlock)]
    assert [block.samples[0, 0] for block in blocks] == [0, 1, 2, 3, 4]
    assert isinstance(heard[-1], StreamEnd)
    assert heard[-1].n_blocks == 5


def exit_of(*words: str) -> int | str | None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["pilewatch", *words])
        with pytest.raises(SystemExit) as ended:
            main()
    return ended.value.code


def test_the_command_publishes_for_a_while_and_says_what_came(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "layout.toml").write_text(
        'turbine = "t7"\n[[channels]]\nname = "ax"\nelevation = 100.0\ndirection = [1, 0, 0]\n'
    )
    layout = str(tmp_path / "layout.toml")
    assert exit_of("feed", "udp://:0", "--layout", layout, "--turbine", "t8", "--for", "0.3") == 0
    assert "0 blocks of t8 published; 0 messages received" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("ftp://x/y",), "is no feed"),
        (("udp://:0", "--for", "0"), "--for 0: a positive number of seconds is needed"),
        (("udp://:0",), "where on the tower are its channels?"),
        (("scada+csv:x.csv",), "of which turbine?"),
        (("udp://:0", "--layout", "none.toml"), "layout none.toml cannot be read"),
        (("udp://:0", "--layout", "a.toml", "--scenario", "parked"), "both define the channels"),
    ],
)
def test_a_mistake_of_the_command_is_one_line(
    words: tuple[str, ...], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exit_of("feed", *words) == 2
    printed = capsys.readouterr().err.strip()
    assert sentence in printed
    assert "\n" not in printed


def test_an_instrument_and_processes_are_two_commands(capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_of("run", "--source", "udp://:0", "--processes") == 2
    assert "run `pilewatch feed udp://:0` beside" in " ".join(capsys.readouterr().err.split())
    assert exit_of("run", "--source", "scada+csv:x.csv", "--scenario", "parked") == 2
    assert "measures no accelerations" in " ".join(capsys.readouterr().err.split())


def test_a_session_listens_to_an_instrument_itself(
    tmp_path: Path, short_scenario: Scenario
) -> None:
    stopping = threading.Event()
    names = short_scenario.layout.channel_names
    rng = np.random.default_rng(3)
    measured = [
        ChannelSamples(
            "a", names, rng.normal(size=(100, len(names))), START + i * NANOSECONDS, 100.0
        )
        for i in range(20)
        if i != 7
    ]
    feed = ScriptedFeed(measured, threading.Timer(3.0, stopping.set).start)
    channels = layout_file_of(short_scenario.layout)
    live = LiveFeed(feed, Assembler(channels, feed.counts))
    source = Source("udp://:5005", short_scenario, short_scenario.layout, None, None, feed=live)
    session = run_session(source, SessionOptions(out=tmp_path, rrd=False), stopping=stopping)
    assert session.figures["stream"]["published"] == session.figures["stream"]["recorded"] == 19
    assert session.figures["stream"]["lost"] == 0
    assert [(gap.first_sequence, gap.n_blocks) for gap in session.summary.main.gaps] == [(7, 1)]


WAITING_CLIENT = '{mode: "client", connect: {endpoints: ["%s"], timeout_ms: -1}}'
FEED = """
import sys
from pipeline.cli import main
sys.argv[0] = "pilewatch"
main()
"""


def until(condition: Callable[[], bool]) -> None:
    """Return when it holds."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.mark.parametrize("name", ["SIGTERM", "SIGINT"])
def test_a_feed_without_its_shore_listens_spools_and_ends_when_it_is_asked_to(
    tmp_path: Path, name: str
) -> None:
    """It waited for the shore without its port open, and took no signal."""
    config, layout = tmp_path / "unit.json5", tmp_path / "layout.toml"
    config.write_text(WAITING_CLIENT % free_endpoint())
    layout.write_text('[[channels]]\nname = "ax"\nelevation = 100.0\ndirection = [1, 0, 0]\n')
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as sender:
        sender.bind(("127.0.0.1", 0))
        port = sender.getsockname()[1]
    words = ["feed", f"udp://:{port}", "--layout", str(layout), "--zenoh-config", str(config)]
    process = subprocess.Popen(
        [sys.executable, "-c", FEED, *words, "--spool", str(tmp_path / "spool"), "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )

    def is_spooled() -> bool:
        with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as sender:
            sender.sendto(frame(numbers.pop(0)), ("127.0.0.1", port))
        files = (tmp_path / "spool").glob("*.blocks")
        return sum(path.stat().st_size for path in files) > 1000

    numbers = list(range(1000))
    until(is_spooled)
    process.send_signal(getattr(signal, name))
    printed, logged = process.communicate(timeout=5.0)
    assert process.returncode == 0, logged
    assert json.loads(printed)["blocks"] > 0
    assert "not acknowledged by a shore station; they stay in" in logged


def test_what_a_feed_measured_before_its_shore_was_there_arrives(tmp_path: Path) -> None:
    endpoint, stopping, inbox = free_endpoint(), threading.Event(), Inbox()
    config = tmp_path / "unit.json5"
    config.write_text(WAITING_CLIENT % endpoint)
    feed = ScriptedFeed([second(number) for number in range(10)])
    live = LiveFeed(feed, Assembler(LAYOUT, feed.counts))
    measured: list[AccelerationBlock] = []
    publisher = threading.Thread(
        target=publish_feed,
        args=(live, sensor_layout(LAYOUT), ZenohSettings(config_file=config)),
        kwargs={"stopping": stopping, "report": measured.append},
    )
    publisher.start()
    until(lambda: len(measured) >= 8)
    with closing(ZenohBus(ZenohSettings(mode="router", listen=(endpoint,)))) as bus:
        bus.subscribe((SensorLayout, AccelerationBlock), inbox)
        heard: list[Message | None] = []
        while heard.count(sensor_layout(LAYOUT)) < 1 or len(heard) < 9:  # in any order of keys
            heard.append(inbox.get(timeout=PATIENCE))
            assert heard[-1] is not None
        stopping.set()
        publisher.join()
    blocks = [each for each in heard if isinstance(each, AccelerationBlock)]
    assert [each.sequence for each in blocks] == list(range(len(heard) - 1))


def test_a_shore_that_does_not_answer_is_no_mistake_that_a_person_has_to_correct(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A service is started again after the one exit code, and not after the other."""
    (tmp_path / "layout.toml").write_text(
        '[[channels]]\nname = "ax"\nelevation = 100.0\ndirection = [1, 0, 0]\n'
    )
    endpoint = free_endpoint()
    words = ["udp://:0", "--layout", str(tmp_path / "layout.toml"), "--no-keep"]
    assert exit_of("feed", *words, "--mode", "client", "--connect", endpoint) == 75
    assert f"no Zenoh session answers at {endpoint}" in capsys.readouterr().err
    assert exit_of("feed", *words, "--zenoh-config", str(tmp_path / "none.json5")) == 2
