"""OPC UA over the loopback interface: variables of asyncua's own server, accelerations out."""

import asyncio
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from asyncua import ua
from asyncua.crypto.cert_gen import setup_self_signed_certificate
from cryptography.x509.oid import ExtendedKeyUsageOID

from pipeline.deploy.certificates import make_certificates
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock, BlockStatus
from sensors.acquisition.scada import ScadaSample
from sensors.feeds.address import parsed
from sensors.feeds.live import LiveFeed, Measured
from sensors.feeds.opcua.nodes import Variable, chosen, declared_nodes
from sensors.feeds.opcua.security import secure
from sensors.feeds.opcua.values import OVERFLOW, ScadaValueReader, ValueReader, nanoseconds_of
from sensors.feeds.open_feed import listed_variables, open_feed
from sensors.feeds.payloads.scada import ScadaReader
from sensors.feeds.protocol import ChannelSamples, FeedCounts, FeedError
from sensors.files.layout_file import LayoutFile, MappedChannel
from tests.sensors.feeds.opcua_server import BEGIN, SPACE, OpcUaServer
from tests.sensors.feeds.scripted import measured_until

RATE = 20.0
STEP = 10  # samples of a channel before the other's are written
LAYOUT = LayoutFile(
    (MappedChannel("ax", 100.0, (1.0, 0.0, 0.0)), MappedChannel("ay", 100.0, (0.0, 1.0, 0.0))),
    "t1",
    "top",
)
STEPS = np.random.default_rng(5).integers(-9, 9, (400, 2)) * 0.125  # many equal their neighbours
RISING = (
    STEPS + np.arange(1, 401)[:, None] / 1024
)  # none does: this server's historian keeps changes


def certificate(folder: Path, name: str, usage: Any) -> tuple[Path, Path]:
    key, path = folder / f"{name}.key.pem", folder / f"{name}.der"
    made = setup_self_signed_certificate(key, path, f"urn:{name}", "localhost", [usage], {})
    asyncio.run(made)
    return path, key


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Path, Path]]:
    folder = tmp_path_factory.mktemp("certificates")
    return {
        "ours": certificate(folder, "tower-unit", ExtendedKeyUsageOID.CLIENT_AUTH),
        "theirs": certificate(folder, "controller", ExtendedKeyUsageOID.SERVER_AUTH),
    }


@pytest.fixture(scope="module")
def server(certificates: dict[str, tuple[Path, Path]]) -> Iterator[OpcUaServer]:
    running = OpcUaServer(*certificates["theirs"])
    yield running
    running.close()


@pytest.fixture
def empty_server(certificates: dict[str, tuple[Path, Path]]) -> Iterator[OpcUaServer]:
    """Without the towers of other tests."""
    running = OpcUaServer(*certificates["theirs"])
    yield running
    running.close()


def live_of(server: OpcUaServer, tower: str, **others: Any) -> LiveFeed:
    nodes = f"nodes=ns=2;s={tower}.{{name}}"
    return open_feed(f"opcua://127.0.0.1:{server.port}/?{nodes}", LAYOUT, **others)


def write(
    server: OpcUaServer, tower: str, first: int, end: int, all_values: np.ndarray = RISING
) -> None:
    """Half a second of each channel in turn: none runs ahead by more than a feed waits."""
    for begin in range(first, end, STEP):
        for name, column in zip(("ax", "ay"), all_values.T, strict=True):
            values = [float(each) for each in column[begin : min(begin + STEP, end)]]
            server.write(f"{tower}.{name}", values, begin, RATE)


def joined(given: list[Measured]) -> dict[int, np.ndarray]:
    """Samples by their number since BEGIN."""
    begin_ns = nanoseconds_of(BEGIN)
    rows: dict[int, np.ndarray] = {}
    for block in given:
        assert isinstance(block, AccelerationBlock)
        first = round((block.start_ns - begin_ns) / NANOSECONDS * RATE)
        for i, row in enumerate(block.samples):
            assert first + i not in rows
            rows[first + i] = row
    return rows


def newest(live: LiveFeed, number: int) -> bool:
    """Whether both channels came up to a sample."""
    reached = live._feed._reader.newest_ns  # type: ignore[attr-defined]
    last_ns = nanoseconds_of(BEGIN + timedelta(seconds=number / RATE))
    return [reached.get(name) for name in ("ax", "ay")] == [last_ns, last_ns]


def test_a_variable_that_is_not_there_is_one_line_with_those_that_are(
    empty_server: OpcUaServer,
) -> None:
    server = empty_server
    server.tower("N", ["acc_ax", "ay"])
    with pytest.raises(FeedError, match=r"no variable 'ax'; it has N\.acc_ax \(ns=2;s=N.acc_ax"):
        list(open_feed(f"opcua://127.0.0.1:{server.port}", LAYOUT).measured(threading.Event()))
    with pytest.raises(FeedError, match="refuses ax: BadNodeIdUnknown"):
        list(live_of(server, "N").measured(threading.Event()))


def test_every_value_comes_with_its_source_time_also_where_it_equals_the_last(
    server: OpcUaServer,
) -> None:
    server.tower("A", ["ax", "ay"])
    live = live_of(server, "A")
    given = measured_until(
        live, lambda: newest(live, 199), lambda: write(server, "A", 1, 200, STEPS)
    )
    samples = joined(given)
    assert sorted(samples) == list(range(200))
    np.testing.assert_array_equal([samples[i] for i in range(1, 200)], STEPS[1:200])
    assert (live.counts.lost, live.counts.malformed) == (0, 0)


@pytest.mark.parametrize("keeps", [True, False])
def test_what_came_during_a_cut_is_read_from_the_history_or_counted(
    keeps: bool, server: OpcUaServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sensors.feeds.opcua.history.HISTORIAN_PAUSE", 0.1)
    tower = f"cut-{keeps}"
    server.tower(tower, ["ax", "ay"], keeps_history=keeps)
    live = live_of(server, tower)
    cuts: list[int] = []

    def done() -> bool:
        if newest(live, 99) and not cuts:
            cuts.append(1)
            server.cut()
            write(server, tower, 100, 200)  # measured while nobody listens
            server.heal()
        return newest(live, 299)

    given = measured_until(
        live,
        done,
        lambda: write(server, tower, 1, 100),
        lambda: write(server, tower, 200, 300),
    )
    samples = joined(given)
    expected = range(300) if keeps else [*range(100), *range(199, 300)]
    assert sorted(samples) == list(expected)
    np.testing.assert_array_equal([samples[i] for i in expected[1:]], RISING[list(expected)[1:]])
    assert live.missing_blocks == (0 if keeps else 5)


def test_a_feed_that_was_killed_goes_on_where_it_had_published(
    server: OpcUaServer, tmp_path: Path
) -> None:
    server.tower("K", ["ax", "ay"], keeps_history=True)
    first = live_of(server, "K", state=tmp_path)
    given = measured_until(first, lambda: newest(first, 99), lambda: write(server, "K", 1, 100))
    write(server, "K", 100, 200)
    second = live_of(server, "K", state=tmp_path)
    given += measured_until(
        second, lambda: newest(second, 299), lambda: write(server, "K", 200, 300)
    )
    samples = joined(given)
    assert sorted(samples) == list(range(300))
    np.testing.assert_array_equal([samples[i] for i in range(1, 300)], RISING[1:300])


def test_an_encrypted_channel_wants_the_server_and_the_password_that_were_named(
    server: OpcUaServer,
    certificates: dict[str, tuple[Path, Path]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ours, theirs = certificates["ours"], certificates["theirs"]

    def feed(named: Path) -> LiveFeed:
        security = f"security=encrypt&cert={ours[0]}&key={ours[1]}&server={named}"
        address = f"opcua://operator@127.0.0.1:{server.port}/?nodes=ns=2;s=S.{{name}}&{security}"
        return open_feed(address, LAYOUT, once=True)

    server.tower("S", ["ax", "ay"])
    monkeypatch.setenv("PILEWATCH_FEED_PASSWORD", "of the tower")
    live = feed(theirs[0])
    given = measured_until(live, lambda: newest(live, 99), lambda: write(server, "S", 1, 100))
    assert sorted(joined(given)) == list(range(100))
    with pytest.raises(FeedError, match="the server shows another certificate") as error:
        list(feed(ours[0]).measured(threading.Event()))
    assert str(error.value).count("opcua://") == 1
    monkeypatch.setenv("PILEWATCH_FEED_PASSWORD", "guessed")
    with pytest.raises(FeedError, match="refuses the user operator or the password"):
        list(feed(theirs[0]).measured(threading.Event()))


def test_a_key_of_another_kind_or_certificate_is_one_line(
    server: OpcUaServer, certificates: dict[str, tuple[Path, Path]], tmp_path: Path
) -> None:
    make_certificates(tmp_path, ["feed"], host="localhost")  # elliptic curves
    elliptic = (tmp_path / "feed.pem", tmp_path / "feed-key.pem")
    ours, theirs = certificates["ours"], certificates["theirs"]
    for (certificate, key), sentence in (
        (elliptic, "is no RSA key, as OPC UA needs it"),
        ((ours[0], theirs[1]), "is not the key of cert="),
        ((ours[0], ours[0]), "its certificates cannot be used"),
    ):
        security = f"security=encrypt&cert={certificate}&key={key}&server={theirs[0]}"
        address = f"opcua://127.0.0.1:{server.port}/?{security}"
        with pytest.raises(FeedError, match=sentence):
            list(open_feed(address, LAYOUT, once=True).measured(threading.Event()))


def endpoint(mode: ua.MessageSecurityMode, policy: str, *users: str) -> Any:
    return SimpleNamespace(
        SecurityMode=mode,
        SecurityPolicyUri=f"http://opcfoundation.org/UA/SecurityPolicy#{policy}",
        UserIdentityTokens=[
            SimpleNamespace(TokenType=getattr(ua.UserTokenType, each)) for each in users
        ],
    )


@pytest.mark.parametrize(
    ("address", "offered", "sentence"),
    [
        (
            "opcua://h/",
            endpoint(ua.MessageSecurityMode.Sign, "Basic256Sha256"),
            "the server offers security=sign&policy=Basic256Sha256",
        ),
        (
            "opcua://h/",
            endpoint(ua.MessageSecurityMode.None_, "None", "UserName"),
            "the server wants a user: opcua://USER@HOST",
        ),
        (
            "opcua://me@h/",
            endpoint(ua.MessageSecurityMode.None_, "None", "Anonymous"),
            "the server takes no user; leave me@ out",
        ),
    ],
)
def test_what_a_server_does_not_offer_is_one_line(
    address: str, offered: Any, sentence: str
) -> None:
    async def endpoints() -> list[Any]:
        return [offered]

    client = SimpleNamespace(connect_and_get_server_endpoints=endpoints)
    with pytest.raises(FeedError, match=sentence):
        asyncio.run(secure(client, parsed(address)))


def test_a_servers_variables_are_listed(server: OpcUaServer) -> None:
    server.tower("L", ["ax"])
    found = {each.path: each for each in listed_variables(f"opcua://127.0.0.1:{server.port}")}
    assert found["L.ax"].node_id == "ns=2;s=L.ax"
    assert (found["L.ax"].content, found["L.ax"].time_ns) == (0.0, nanoseconds_of(BEGIN))
    with pytest.raises(FeedError, match="cannot be reached"):
        listed_variables("opcua://127.0.0.1:1")


@pytest.mark.parametrize("way", ["name", "file", "layout"])
def test_nodes_are_declared_by_namespace_file_or_layout(
    way: str, server: OpcUaServer, tmp_path: Path
) -> None:
    server.tower(way, ["ax", "ay"])
    layout, path = LAYOUT, tmp_path / "nodes.toml"
    path.write_text('[nodes]\nax = "ns=2;s=file.ax"\nay = "ns=2;s=file.ay"\n')
    nodes = {"name": f"?nodes=nsu={SPACE};s=name.{{name}}", "file": f"?nodes={path}", "layout": ""}
    if way == "layout":
        channels = (replace(each, name=f"layout.{each.name}") for each in LAYOUT.channels)
        layout = replace(LAYOUT, channels=tuple(channels))
    live = open_feed(f"opcua://127.0.0.1:{server.port}/{nodes[way]}", layout, once=True)
    measured_until(live, lambda: live.counts.received == 2)
    assert live.counts.connections == 1


def test_declared_nodes_and_their_mistakes(tmp_path: Path) -> None:
    assert declared_nodes("", ["ns=3;i=5", "ax"]) == {"ns=3;i=5": "ns=3;i=5"}
    path = tmp_path / "nodes.toml"
    for content, sentence in (
        ("[node]", r"a table \[nodes\] is needed"),
        ('[nodes]\nax = "Tower.ax"', "ax = 'Tower.ax' is no node id; e.g. ns=2;s=Tower.ax"),
        ("[nodes", "not valid TOML"),
    ):
        path.write_text(content)
        with pytest.raises(FeedError, match=sentence):
            declared_nodes(str(path), ["ax"])
    with pytest.raises(FeedError, match="No such file or directory; a pattern such as"):
        declared_nodes("Tower.ax", ["ax"])


def test_of_several_variables_of_one_name_none_is_chosen() -> None:
    def variable(path: str) -> Variable:
        return Variable(path, SimpleNamespace(nodeid=ua.NodeId(path, 2)))

    variables = [variable("Tower.top.ax"), variable("Tower.foot.ax"), variable("Nacelle.yaw")]
    assert chosen("top.ax", variables).path == "Tower.top.ax"
    assert chosen("yaw", variables).path == "Nacelle.yaw"
    with pytest.raises(FeedError, match="several variables 'ax': Tower"):
        chosen("ax", variables)


def value(content: Any, second: float = 0.0, status: int = 0) -> ua.DataValue:
    stamp = BEGIN + timedelta(seconds=second)
    return ua.DataValue(ua.Variant(content), ua.StatusCode(status), SourceTimestamp=stamp)


def pieces(reader: ValueReader, name: str, *values: ua.DataValue) -> list[ChannelSamples]:
    return [piece for each in values for piece in reader.read(name, each)]


def test_values_are_read_with_their_status() -> None:
    counts = FeedCounts()
    reader = ValueReader(counts, None, "first")
    bad = value(1.0, 0.0, ua.StatusCodes.BadSensorFailure)
    fault, dropped = pieces(reader, "ax", bad, value(1.0, 0.0), value(3, 1.0, OVERFLOW))
    assert np.isnan(fault.samples).all()
    assert fault.status is BlockStatus.SENSOR_FAULT
    assert dropped.samples.tolist() == [[3.0]]
    assert (counts.duplicate, counts.lost) == (1, 1)
    assert not pieces(reader, "ax", *(value(each, 2.0) for each in ("out", True, [1.0, 2.0])))
    assert counts.malformed == 3
    assert "need the option rate=" in counts.refusal
    never = ua.DataValue(StatusCode=ua.StatusCode(ua.StatusCodes.BadWaitingForInitialData))
    assert not pieces(reader, "ay", never)
    assert counts.malformed == 3


NO_TIME = datetime(1601, 1, 1, tzinfo=UTC)


def test_the_sources_time_stamp_goes_before_the_servers_and_either_will_do() -> None:
    counts = FeedCounts()
    reader = ValueReader(counts, None, "first")
    later = BEGIN + timedelta(seconds=1)
    values = [
        ua.DataValue(ua.Variant(1.0), SourceTimestamp=BEGIN, ServerTimestamp=later),
        ua.DataValue(ua.Variant(2.0), ServerTimestamp=later),
        ua.DataValue(
            ua.Variant(3.0), SourceTimestamp=NO_TIME, ServerTimestamp=later + timedelta(seconds=1)
        ),
        ua.DataValue(
            ua.Variant(4.0),
            ua.StatusCode(ua.StatusCodes.BadSensorFailure),
            ServerTimestamp=later + timedelta(seconds=2),
        ),
    ]
    found = pieces(reader, "ax", *values)
    assert [each.start_ns - nanoseconds_of(BEGIN) for each in found] == [
        second * NANOSECONDS for second in range(4)
    ]
    assert [each.samples.item() for each in found[:3]] == [1.0, 2.0, 3.0]
    assert found[3].status is BlockStatus.SENSOR_FAULT
    assert counts.malformed == 0


@pytest.mark.parametrize("controller", [False, True])
def test_a_value_without_any_time_stamp_is_refused(controller: bool) -> None:
    counts = FeedCounts()
    scada = ScadaReader(parsed("scada+opcua://h?wind_speed=W"), "t1")
    reader = ScadaValueReader(scada, counts) if controller else ValueReader(counts, None, "first")
    assert not list(reader.read("W", ua.DataValue(ua.Variant(1.0), SourceTimestamp=None)))
    assert counts.refusal == "W: a value without a time stamp since 1970"
    assert not list(reader.read("W", ua.DataValue(ua.Variant(1.0), ServerTimestamp=NO_TIME)))
    assert counts.refusal.endswith("since 1970: the server's is 1601-01-01 00:00")
    assert counts.malformed == 2


def test_a_server_that_sends_only_its_own_time_stamps_is_read(server: OpcUaServer) -> None:
    """asyncua's server stamps a value when it is written."""
    server.tower("Own", ("ax", "ay"))
    address = f"opcua://127.0.0.1:{server.port}?rate=20&interval=50&nodes=ns=2;s=Own.{{name}}"
    live = open_feed(address, LAYOUT)
    reached = live._feed._reader.newest_ns  # type: ignore[attr-defined]
    begun_ns = time.time_ns()

    def write() -> None:
        for channel in ("ax", "ay"):
            server.write(f"Own.{channel}", [1.0], 1, 20.0, stamps="ServerTimestamp")

    measured_until(live, lambda: live.counts.received >= 4, write)
    assert min(reached["ax"], reached["ay"]) >= begun_ns - 1000  # stamps end at a microsecond
    assert "time stamp" not in live.counts.refusal


@pytest.mark.parametrize(("stamp", "begin"), [("first", 0.0), ("last", -0.3)])
def test_an_array_is_samples_that_follow_each_other(stamp: str, begin: float) -> None:
    array = value([1.0, 2.0, 3.0, 4.0])
    (piece,) = pieces(ValueReader(FeedCounts(), 10.0, stamp), "ax", array)
    assert piece.samples.ravel().tolist() == [1.0, 2.0, 3.0, 4.0]
    assert piece.start_ns == nanoseconds_of(BEGIN + timedelta(seconds=begin))


def test_a_report_that_a_controller_repeats_is_one() -> None:
    counts = FeedCounts()
    controller = ScadaReader(parsed("scada+opcua://h?wind_speed=w"), "t1")
    reader = ScadaValueReader(controller, counts)
    seconds = (0.0, 1.0, 2.0, 3.0, 3.0, 2.0, 4.0)
    given = [each for second in seconds for each in reader.read("w", value(9.5, second))]
    assert len(given) == 5
    assert (counts.received, counts.late + counts.duplicate) == (7, 2)


def test_a_controllers_variables_are_reports(server: OpcUaServer) -> None:
    server.tower("C", ["Wind", "P_kW"])
    server.tower("C", ["Mode"], initial="")
    options = "wind_speed=ns=2;s=C.Wind&power=C.P_kW*1000&state=C.Mode"
    live = open_feed(f"scada+opcua://127.0.0.1:{server.port}?{options}", LAYOUT, once=True)

    def act() -> None:
        server.write("C.Wind", [9.5], 1, 1.0)
        server.write("C.P_kW", [2.5], 2, 1.0)
        server.write("C.Mode", ["parked"], 3, 1.0)

    given = measured_until(live, lambda: live.counts.received == 6, act)
    reports = [each for each in given if isinstance(each, ScadaSample)]
    assert [each.wind_speed for each in reports if each.wind_speed > 0] == [9.5]
    assert [each.power for each in reports if each.power > 0] == [2500.0]
    assert [each.state for each in reports if each.state] == ["parked"]
    with pytest.raises(FeedError, match="which variables"):
        open_feed(f"scada+opcua://127.0.0.1:{server.port}", LAYOUT)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ("?security=encrypt", "needs cert=FILE, this client's certificate"),
        ("?cert=a.pem", "cert is for security=sign or security=encrypt"),
        ("?security=tls", "security=tls is none of none, sign, encrypt"),
        ("?security=sign&cert=no.pem", "cert=no.pem: no such file"),
        ("?node=x", "did you mean 'nodes'"),
        ("?interval=0", "interval=0 is no positive number"),
    ],
)
def test_a_mistake_in_an_address_is_one_line(options: str, sentence: str) -> None:
    with pytest.raises(FeedError, match=sentence) as caught:
        open_feed(f"opcua://127.0.0.1/{options}", LAYOUT)
    assert "\n" not in str(caught.value)
