"""SeedLink over the loopback interface: records in, accelerations out, nothing twice."""

import socket
import ssl
import sys
import threading
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from obspy.clients.seedlink.client.seedlinkconnection import SeedLinkConnection
from obspy.clients.seedlink.slpacket import SLPacket

from pipeline.deploy.certificates import make_certificates
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.feeds.address import parsed
from sensors.feeds.assembly.assembler import Assembler
from sensors.feeds.live import LiveFeed, Measured
from sensors.feeds.open_feed import open_feed
from sensors.feeds.protocol import FeedError
from sensors.feeds.seedlink import SeedLinkFeed, stations_of
from sensors.files.layout_file import LayoutFile, MappedChannel
from tests.sensors.feeds.scripted import measured_until
from tests.sensors.feeds.seedlink_server import SeedLinkServer, records, seedlink_server

X, Y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
FA, SS = "XX.TWR.00.HNX", "XX.TWR.00.HNY"
COUNTS_PER_MS2 = 400_000.0
LAYOUT = LayoutFile(
    tuple(
        MappedChannel(name, 100.0, axis, unit="m/s²", sensitivity=COUNTS_PER_MS2)
        for name, axis in ((FA, X), (SS, Y))
    ),
    "t1",
    "top",
)
START = 1_700_000_000 * NANOSECONDS
RATE = 100.0


def counts_of(first: int, end: int) -> np.ndarray:
    """A vibration in a digitiser's counts; the same sample is the same number in every record."""
    time = np.arange(first, end)
    rng = np.random.default_rng(17)
    noise = rng.integers(-5000, 5000, 100_000)
    return (200_000 * np.sin(2 * np.pi * 0.16 * time / RATE)).astype(np.int32) + noise[first:end]


def measured(first: int, end: int, *, length: int = 512, miniseed: int = 2) -> list[bytes]:
    """Records of both channels, in the order in which a logger would have filled them."""
    start_ns = START + round(first / RATE * NANOSECONDS)
    of_both = [
        records(
            name,
            counts_of(first, end),
            start_ns=start_ns,
            sampling_rate=RATE,
            length=length,
            miniseed=miniseed,
        )
        for name in (FA, SS)
    ]
    return [record for pair in zip(*of_both, strict=True) for record in pair]


def joined(given: list[Measured]) -> dict[int, np.ndarray]:
    """Samples by their number since START."""
    return {
        round((block.start_ns - START) * 1e-9 * RATE) + i: row
        for block in given
        if isinstance(block, AccelerationBlock)
        for i, row in enumerate(block.samples)
    }


def live_of(server: SeedLinkServer, path: str = "XX.TWR") -> LiveFeed:
    return open_feed(f"seedlink://127.0.0.1:{server.port}/{path}", LAYOUT)


def test_records_become_accelerations() -> None:
    packets = measured(0, 3000)
    with seedlink_server() as server:
        live = live_of(server)
        given = measured_until(
            live, lambda: live.counts.received == len(packets), lambda: server.add(packets)
        )
    samples = joined(given)
    assert sorted(samples) == list(range(3000))
    expected = counts_of(0, 3000) / COUNTS_PER_MS2
    both = np.array([samples[i] for i in range(3000)])
    np.testing.assert_allclose(both[:, 0], expected, rtol=1e-6)
    np.testing.assert_allclose(both[:, 1], expected, rtol=1e-6)
    assert server.asked[:4] == ["HELLO", "STATION TWR XX", "DATA", "END"]


def test_obspys_own_client_reads_the_same_packets_of_the_same_server() -> None:
    packets = measured(0, 1000)
    with seedlink_server() as server:
        client = SeedLinkConnection(timeout=20)
        client.set_sl_address(f"127.0.0.1:{server.port}")
        client.add_stream("XX", "TWR", "HN?", 0, None)
        server.add(packets)
        read = [client.collect() for _ in packets]
        client.close()
    assert all(isinstance(each, SLPacket) for each in read)
    assert [bytes(each.msrecord) for each in read] == packets
    assert [each.get_sequence_number() for each in read] == list(range(1, len(packets) + 1))


def test_a_link_that_was_cut_goes_on_with_the_next_packet(caplog: pytest.LogCaptureFixture) -> None:
    first, second, third = measured(0, 1000), measured(1000, 2000), measured(2000, 3000)
    with seedlink_server(first=0xFFFF0) as server:
        live = live_of(server)
        cuts: list[int] = []

        def cut() -> bool:
            if live.counts.received == len(first) and not cuts:
                cuts.append(1)
                server.stop()
                server.add(second)  # measured while nobody is connected
                server.start()
            return live.counts.received == len(first + second + third)

        given = measured_until(live, cut, lambda: server.add(first), lambda: server.add(third))
    assert sorted(joined(given)) == list(range(3000))
    assert (live.counts.connections, live.missing_blocks, live.counts.duplicate) == (2, 0, 0)
    assert f"DATA {0xFFFF0 + len(first):06X}" in server.asked
    assert any("the link was cut" in line for line in caplog.messages)


def test_what_the_server_has_no_longer_is_a_gap() -> None:
    first, second, third = measured(0, 1000), measured(1000, 2000), measured(2000, 3000)
    with seedlink_server() as server:
        live = live_of(server)
        cuts: list[int] = []

        def cut() -> bool:
            if live.counts.received == len(first) and not cuts:
                cuts.append(1)
                server.stop()
                server.add(second)
                server.forget(len(first + second))
                server.start()
            return live.counts.received == len(first + third)

        given = measured_until(live, cut, lambda: server.add(first), lambda: server.add(third))
    assert sorted(joined(given)) == [*range(1000), *range(2000, 3000)]
    assert live.missing_blocks == 10
    assert len({block.session for block in given if isinstance(block, AccelerationBlock)}) == 1


def test_channels_are_selected_by_location_and_code() -> None:
    other = records("XX.TWR.10.LNX", counts_of(0, 200), start_ns=START, sampling_rate=RATE)
    packets = measured(0, 1000)
    with seedlink_server() as server:
        live = live_of(server, "XX.TWR.00.HN*")
        given = measured_until(
            live, lambda: live.counts.received == len(packets), lambda: server.add(other + packets)
        )
    assert len(joined(given)) == 1000
    assert not live.counts.unknown
    assert "SELECT 00HN?" in server.asked


def test_a_packet_that_is_no_miniseed_is_counted_and_hurts_nobody() -> None:
    packets = measured(0, 1000)
    with seedlink_server() as server:
        live = live_of(server)

        def send() -> None:
            server.packets.append((FA, b"\xff" * 512))
            server.packets.append((FA, packets[0][:64] + b"\xa5" * 448))
            server.add(packets)

        given = measured_until(live, lambda: live.counts.received == len(packets) + 2, send)
    assert len(joined(given)) == 1000
    assert 1 <= live.counts.malformed <= 2
    assert "is no miniSEED" in live.counts.refusal


def test_a_server_that_is_quiet_is_asked_and_one_that_is_silent_given_up() -> None:
    with seedlink_server() as server:
        feed = SeedLinkFeed(
            parsed(f"seedlink://127.0.0.1:{server.port}/XX.TWR"), once=False, quiet=1.0
        )
        live = LiveFeed(feed, Assembler(LAYOUT, feed.counts))
        measured_until(live, lambda: server.asked.count("INFO ID") == 2)
        assert live.counts.connections == 1
    with closing(socket.create_server(("127.0.0.1", 0))) as silent:
        port = silent.getsockname()[1]

        def greet() -> None:
            link, _ = silent.accept()
            link.sendall(b"SeedLink v3.1\r\nsilent\r\nOK\r\nOK\r\n")
            hold.append(link)

        hold: list[socket.socket] = []
        threading.Thread(target=greet, daemon=True).start()
        feed = SeedLinkFeed(parsed(f"seedlink://127.0.0.1:{port}/XX.TWR"), once=False, quiet=0.1)
        live = LiveFeed(feed, Assembler(LAYOUT, feed.counts))
        measured_until(live, lambda: live.counts.problem == "nothing for 0.2 s")
        for link in hold:
            link.close()


def test_a_station_that_the_server_does_not_have_is_one_line() -> None:
    with seedlink_server() as server:
        live = live_of(server, "XX.NONE")
        with pytest.raises(FeedError, match="the server refuses 'STATION NONE XX'"):
            list(live.measured(threading.Event()))


def test_nobody_at_the_start_is_one_line_with_once() -> None:
    with closing(socket.socket()) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        live = open_feed(f"seedlink://127.0.0.1:{port}/XX.TWR", LAYOUT, once=True)
        with pytest.raises(FeedError, match=r"cannot be reached: .*refused"):
            list(live.measured(threading.Event()))


@pytest.mark.parametrize(
    "path", ["TWR", "XX.", "XXX.TWR", "XX.TWR.00", "XX.TWR.00.HNXX", "XX.TWR,"]
)
def test_what_is_no_station_is_one_line(path: str) -> None:
    with pytest.raises(FeedError, match=r"is no station; NET\.STA or NET\.STA\.LOC\.CHA"):
        stations_of(parsed(f"seedlink://h/{path}"))


def test_selectors_of_one_station_are_kept_together() -> None:
    first, second = stations_of(parsed("seedlink://h/XX.A.00.HNX,XX.B,XX.A..HN*"))
    assert (first.station, first.selectors) == ("A", ["00HNX", "HN?"])
    assert (second.station, second.selectors) == ("B", [])


def test_a_missing_package_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pymseed", None)
    with pytest.raises(FeedError, match=r"pip install 'pilewatch\[miniseed\]'"):
        open_feed("seedlink://h/XX.A", LAYOUT)


@pytest.mark.parametrize("version", [3, 4])
@pytest.mark.parametrize(("length", "miniseed"), [(512, 2), (4096, 2), (256, 2), (512, 3)])
def test_records_of_any_length_and_version_come_over_both_protocols(
    version: int, length: int, miniseed: int
) -> None:
    packets = measured(0, 4000, length=length, miniseed=miniseed)
    with seedlink_server(version=version) as server:
        live = live_of(server, "XX.TWR.00.HN*")
        given = measured_until(
            live, lambda: live.counts.received == len(packets), lambda: server.add(packets)
        )
    samples = joined(given)
    assert sorted(samples) == list(range(4000))
    found = np.array([samples[i][0] for i in range(4000)])
    np.testing.assert_allclose(found, counts_of(0, 4000) / COUNTS_PER_MS2, rtol=1e-6)
    assert ("SLPROTO 4.0" in server.asked) == (version == 4)
    wanted = {3: ["STATION TWR XX", "SELECT 00HN?"], 4: ["STATION XX_TWR", "SELECT 00_H_N_?"]}
    assert [each for each in server.asked if each[:2] in ("ST", "SE")] == wanted[version]


def test_a_station_may_have_wildcards() -> None:
    packets = measured(0, 1000)
    with seedlink_server() as server:
        live = live_of(server, "XX.TW*")
        given = measured_until(
            live, lambda: live.counts.received == len(packets), lambda: server.add(packets)
        )
    assert sorted(joined(given)) == list(range(1000))
    assert "STATION TW* XX" in server.asked


def test_seedlink_over_tls_knows_the_server_by_its_certificate(tmp_path: Path) -> None:
    make_certificates(tmp_path, ["logger"], host="127.0.0.1")
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    tls.load_cert_chain(tmp_path / "logger.pem", tmp_path / "logger-key.pem")
    packets = measured(0, 1000)
    with seedlink_server(tls=tls) as server:
        place = f"seedlinks://127.0.0.1:{server.port}/XX.TWR"
        live = open_feed(f"{place}?ca={tmp_path / 'ca.pem'}", LAYOUT)
        given = measured_until(
            live, lambda: live.counts.received == len(packets), lambda: server.add(packets)
        )
        with pytest.raises(FeedError, match="certificate"):
            list(open_feed(place, LAYOUT, once=True).measured(threading.Event()))

    assert sorted(joined(given)) == list(range(1000))
    assert parsed("seedlinks://h/XX.A").port == 18500


def killed(live: LiveFeed, blocks: int, act: Callable[[], None]) -> list[Measured]:
    """What a feed publishes before it is killed: nothing is written or finished at its end."""
    given: list[Measured] = []
    for each in live.measured(threading.Event()):
        if live.counts.connected and act is not None:
            act()
            act = lambda: None  # noqa: E731
        if each is not None:
            given.append(each)
            if len(given) > blocks:
                return given[:-1]  # the last one was not handed on
    return given


@pytest.mark.parametrize("version", [3, 4])
@pytest.mark.parametrize("kept", [True, False])
def test_a_killed_feed_goes_on_where_it_was_published(
    version: int, kept: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sensors.feeds.position.SAVED_EVERY", 0.0)
    first, second, third = measured(0, 3000), measured(3000, 6000), measured(6000, 9000)
    with seedlink_server(version=version) as server:
        address = f"seedlink://127.0.0.1:{server.port}/XX.TWR"
        live = open_feed(address, LAYOUT, state=tmp_path)
        before = killed(live, 12, lambda: server.add(first))
        server.add(second)  # while no feed runs
        if not kept:
            server.forget(len(first + second))
        again = open_feed(address, LAYOUT, state=tmp_path)
        fewest = len(third) + kept * len(second)

        after = measured_until(
            again, lambda: again.counts.received >= fewest + kept, lambda: server.add(third)
        )

    published, resumed = joined(before), joined(after)
    assert set(published) & set(resumed) == set()
    end = max(published) + 1
    assert sorted(published) == list(range(end))
    if kept:
        assert sorted(resumed)[:3000] == list(range(end, end + 3000))
        assert again.absent == 0
    else:
        assert min(resumed) == 6000
        assert again.absent == pytest.approx((6000 - end) / RATE)
