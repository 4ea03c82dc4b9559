"""A small server of the SeedLink protocol, 3.1 and 4.0: enough for what a client may ask of it."""

import io
import itertools
import socket
import socketserver
import ssl
import struct
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from fnmatch import fnmatchcase

import numpy as np
from obspy import Stream, Trace, UTCDateTime
from pymseed import MS3Record, sourceid2nslc

RECORD = 512  # [bytes]


def records(
    channel: str,
    counts: np.ndarray,
    *,
    start_ns: int,
    sampling_rate: float,
    length: int = RECORD,
    miniseed: int = 2,
) -> list[bytes]:
    """Samples of NET.STA.LOC.CHA as miniSEED records (Steim 2)."""
    network, station, location, code = channel.split(".")
    header = {
        "network": network,
        "station": station,
        "location": location,
        "channel": code,
        "sampling_rate": sampling_rate,
        "starttime": UTCDateTime(ns=start_ns),
    }
    file = io.BytesIO()
    Stream([Trace(counts.astype(np.int32), header)]).write(
        file, format="MSEED", reclen=length, encoding="STEIM2"
    )
    whole = file.getvalue()
    cut = [whole[i : i + length] for i in range(0, len(whole), length)]
    return cut if miniseed == 2 else [_as_version_3(record) for record in cut]


def _as_version_3(record: bytes) -> bytes:
    read = MS3Record.parse(record, unpack_data=True)
    read.formatversion = 3
    (written,) = (bytes(each) for each in read.generate())
    return written


class SeedLinkServer:
    """Keeps what it was given, and gives it to whoever asks, from the sequence that is asked for.

    first   sequence of the first packet
    """

    def __init__(
        self, first: int = 1, *, version: int = 3, tls: ssl.SSLContext | None = None
    ) -> None:
        self.first, self.version, self._tls = first, version, tls
        self.packets: list[tuple[str, bytes]] = []  # channel, record
        self.asked: list[str] = []  # commands of all clients
        self.changed = threading.Condition()
        self.port = 0
        self._server: socketserver.ThreadingTCPServer | None = None
        self._generation = 0

    def add(self, packets: list[bytes]) -> None:
        """More records, in this order."""
        for record in packets:
            channel = ".".join(sourceid2nslc(MS3Record.parse(record).sourceid))
            with self.changed:
                self.packets.append((channel, record))
                self.changed.notify_all()

    def forget(self, count: int) -> None:
        """Let go of the oldest packets, as a full buffer does."""
        with self.changed:
            self.packets[:count] = [("", b"")] * count

    @property
    def generation(self) -> int:
        """Which start this is; clients of an earlier one are cut off."""
        return self._generation

    def start(self) -> None:
        """Listen, at the same port as before."""
        owner = self

        class Handler(socketserver.StreamRequestHandler):
            def handle(self) -> None:
                with suppress(OSError):  # the client has gone
                    _serve(owner, self)

        class Server(socketserver.ThreadingTCPServer):
            allow_reuse_address = True
            daemon_threads = True

            def get_request(self) -> tuple[socket.socket, object]:
                link, place = super().get_request()
                if owner._tls is not None:
                    link = owner._tls.wrap_socket(link, server_side=True)
                return link, place

        self._server = Server(("127.0.0.1", self.port), Handler)
        self.port = self._server.server_address[1]
        threading.Thread(target=self._server.serve_forever, args=(0.01,), daemon=True).start()

    def stop(self) -> None:
        """Cut everybody off."""
        if self._server is not None:
            self._server.shutdown()
            self._server.server_close()
            self._server = None
        with self.changed:
            self._generation += 1
            self.changed.notify_all()


@contextmanager
def seedlink_server(
    first: int = 1, *, version: int = 3, tls: ssl.SSLContext | None = None
) -> Iterator[SeedLinkServer]:
    """A server that runs."""
    server = SeedLinkServer(first, version=version, tls=tls)
    server.start()
    try:
        yield server
    finally:
        server.stop()


class _Asked:
    """What one client has asked for."""

    def __init__(self) -> None:
        self.stations: list[tuple[str, list[str], int | None]] = []  # NET.STA, selectors, from

    def wants(self, sequence: int, channel: str) -> bool:
        for station, selectors, begin in self.stations:
            parts = channel.split(".")
            net_sta, loc_cha = ".".join(parts[:2]), "".join(parts[2:])
            if fnmatchcase(net_sta, station) and (begin is None or sequence >= begin):
                return not selectors or any(_selects(each, loc_cha) for each in selectors)
        return False


def _commands(link: socketserver.StreamRequestHandler) -> Iterator[str]:
    """What a client says; a line feed behind the carriage return is its choice."""
    line = b""
    while byte := link.rfile.read(1):
        if byte not in b"\r\n":
            line += byte
        elif line:
            yield line.decode()
            line = b""


def _selects(selector: str, loc_cha: str) -> bool:
    return fnmatchcase(loc_cha, selector if len(selector) > 3 else f"*{selector}")


def _serve(server: SeedLinkServer, link: socketserver.StreamRequestHandler) -> None:
    asked, generation = _Asked(), server.generation
    newest = server.first + len(server.packets)
    for line in _commands(link):
        server.asked.append(line)
        word, *rest = line.split()
        if word == "HELLO":
            speaks = b"SLPROTO:4.0 SLPROTO:3.1" if server.version == 4 else b"SLPROTO:3.1"
            link.wfile.write(b"SeedLink v3.1 (test) :: " + speaks + b"\r\nof the tests\r\n")
        elif line == "SLPROTO 4.0" and server.version == 4:
            link.wfile.write(b"OK\r\n")
        elif word == "STATION" and rest[0] != "NONE":
            station = rest[0].replace("_", ".", 1) if len(rest) == 1 else f"{rest[1]}.{rest[0]}"
            asked.stations.append((station, [], newest))
            link.wfile.write(b"OK\r\n")
        elif word == "SELECT":
            asked.stations[-1][1].append(rest[0].replace("_", ""))
            link.wfile.write(b"OK\r\n")
        elif word == "DATA":
            station, selectors, begin = asked.stations[-1]
            asked.stations[-1] = (station, selectors, _sequence(server, rest[0]) if rest else begin)
            link.wfile.write(b"OK\r\n")
        elif word == "END":
            _stream(server, link, asked, generation)
            return
        else:
            link.wfile.write(b"ERROR\r\n")


def _stream(
    server: SeedLinkServer,
    link: socketserver.StreamRequestHandler,
    asked: _Asked,
    generation: int,
) -> None:
    threading.Thread(target=_answer, args=(server, link), daemon=True).start()
    at = 0
    while True:
        with server.changed:
            server.changed.wait_for(
                lambda after=at: len(server.packets) > after or server.generation != generation
            )
            if server.generation != generation:
                link.request.shutdown(2)
                return
            channel, record = server.packets[at]
        sequence = server.first + at
        at += 1
        if record and asked.wants(sequence, channel):
            link.wfile.write(_packet(server, sequence, channel, record))


def _sequence(server: SeedLinkServer, written: str) -> int:
    return int(written, 10 if server.version == 4 else 16)


def _packet(server: SeedLinkServer, sequence: int, channel: str, record: bytes) -> bytes:
    if server.version == 3:
        return f"SL{sequence:06X}".encode() + record
    station = "_".join(channel.split(".")[:2]).encode()
    kind = b"3" if record.startswith(b"MS\x03") else b"2"
    head = struct.pack("<2sccIQB", b"SE", kind, b"D", len(record), sequence, len(station))
    return head + station + record


def _answer(server: SeedLinkServer, link: socketserver.StreamRequestHandler) -> None:
    """INFO requests between the packets."""
    try:
        for line in _commands(link):
            server.asked.append(line)
            link.wfile.write(b"SLINFO  " + bytes(RECORD))
    except (OSError, ValueError):
        return


def main(port: int = 18000) -> None:
    """Stand in for a data logger: `python -m tests.sensors.feeds.seedlink_server [PORT]`.

    Two channels of station XX.TWR at 100 Hz, vibrating, a record of each every two seconds.
    """
    server = SeedLinkServer()
    server.port = port
    server.start()
    begin, size, rate = time.time(), 200, 100.0
    for number in itertools.count():
        time.sleep(max(0.0, begin + (number + 1) * size / rate - time.time()))
        at = np.arange(number * size, (number + 1) * size) / rate
        for channel, frequency in (("HNX", 0.16), ("HNY", 0.63)):
            counts = np.round(40_000 * np.sin(2 * np.pi * frequency * at))
            start_ns = int((begin + number * size / rate) * 1e9)
            name = f"XX.TWR.00.{channel}"
            server.add(records(name, counts, start_ns=start_ns, sampling_rate=rate))


if __name__ == "__main__":
    main(*(int(each) for each in sys.argv[1:]))
