"""Receivers that answer oddly: a web server, a mail server and a broker, each from a seed.

Each keeps its own account of what it confirmed, so that a delivery which the channel counts and the
receiver never confirmed is found.
"""

import json
import re
import socket
import struct
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field

import numpy as np

GOOD = b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n"
DRIP = 0.05  # between two bytes of an answer that never ends [s]
_CONFIRMS = re.compile(rb"(?:HTTP/1\.1 100 Continue\r\n\r\n)*HTTP/1\.[01] 2\d\d[ \r]")


@dataclass
class Account:
    """What a receiver was asked and what it confirmed."""

    port: int = 0
    answers: int = 0
    confirmed: Counter[str] = field(default_factory=Counter)  # by message, and recipient of a mail
    reached: list[bytes] = field(default_factory=list)  # of a foreign host: whatever came


@contextmanager
def receiver(serve: Callable[[socket.socket, Account], None]) -> Iterator[Account]:
    """A TCP server on the loopback interface; `serve` has each connection to itself."""
    account, ending = Account(), threading.Event()

    def one(link: socket.socket) -> None:
        with closing(link), suppress(OSError, ValueError, IndexError, struct.error):
            link.settimeout(2.0)
            serve(link, account)

    def accepted() -> None:
        while not ending.is_set():
            with suppress(TimeoutError):
                link, _ = listener.accept()
                threading.Thread(target=one, args=(link,), daemon=True).start()

    with closing(socket.create_server(("127.0.0.1", 0))) as listener:
        listener.settimeout(0.02)
        account.port = listener.getsockname()[1]
        thread = threading.Thread(target=accepted)
        thread.start()
        try:
            yield account
        finally:
            ending.set()
            thread.join()


def foreign(link: socket.socket, account: Account) -> None:
    """A host that no message may reach."""
    account.reached.append(link.recv(65536))
    link.sendall(GOOD)


def noise(random: np.random.Generator, most: int = 300) -> bytes:
    """Bytes of no protocol."""
    return bytes(random.integers(0, 256, int(random.integers(0, most)), dtype=np.uint8))


def odd_http(random: np.random.Generator, stranger: int) -> bytes | None:
    """One answer; None: it drips and never ends. `stranger` is the port of another host."""
    code = int(random.integers(0, 1000))
    redirect = int(random.choice([300, 301, 302, 303, 304, 307, 308]))
    target = str(random.choice([f"http://127.0.0.1:{stranger}/steal", "/elsewhere", "//x", ""]))
    flipped = bytearray(GOOD)
    for place in random.integers(0, len(GOOD), int(random.integers(1, 6))):
        flipped[place] = int(random.integers(0, 256))
    kinds = (
        lambda: GOOD,
        lambda: b"",
        lambda: noise(random),
        lambda: b"NONSENSE\r\n\r\n",
        lambda: b"HTTP/1.1\r\n\r\n",
        lambda: b"HTTP/1.1 two hundred OK\r\n\r\n",
        lambda: f"HTTP/1.1 {code:03d} X\r\nContent-Length: 0\r\n\r\n".encode(),
        lambda: f"HTTP/1.1 {redirect} Moved\r\nLocation: {target}\r\n\r\n".encode(),
        lambda: f"HTTP/1.1 {redirect} Moved\r\nLocation: {target}\r\n\r\n".encode(),
        lambda: GOOD[: int(random.integers(1, len(GOOD)))],
        lambda: bytes(flipped),
        lambda: b"HTTP/1.1 100 Continue\r\n\r\n" * int(random.integers(1, 40)),
        lambda: b"HTTP/1.1 100 Continue\r\n\r\n" + GOOD,
        lambda: b"HTTP/1.1 200 OK\r\nX: " + b"a" * 200_000 + b"\r\n\r\n",
        lambda: b"HTTP/1.1 200 OK\r\nContent-Length: -5\r\nContent-Length: 9\r\n\r\n",
        lambda: b"HTTP/1.1 503 Busy\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n",
        lambda: b"\x16\x03\x01" + noise(random),
        lambda: None if random.random() < 0.2 else GOOD,
    )
    return kinds[int(random.integers(0, len(kinds)))]()


def odd_web(seed: int, fuzzed: int, stranger: int) -> Callable[[socket.socket, Account], None]:
    """A web server with `fuzzed` odd answers, then good ones."""
    random = np.random.default_rng(seed)

    def serve(link: socket.socket, account: Account) -> None:
        head, _, body = _until(link, b"\r\n\r\n").partition(b"\r\n\r\n")
        length = int(re.search(rb"content-length: (\d+)", head.lower())[1])  # type: ignore[index]
        while len(body) < length:
            body += _some(link)
        account.answers += 1
        answer = odd_http(random, stranger) if account.answers <= fuzzed else GOOD
        if answer is None:
            _drip(link, b"HTTP/1.1 200 OK\r\nX-Slow: " + b"a" * 1000)
            return
        if _CONFIRMS.match(answer):  # before it is sent: a channel may be faster than this thread
            account.confirmed[json.loads(body)["text"]] += 1
        link.sendall(answer)

    return serve


def odd_mail(seed: int, fuzzed: int) -> Callable[[socket.socket, Account], None]:
    """A mail server that answers oddly at one stage of `fuzzed` connections."""
    random = np.random.default_rng(seed)
    odd = (
        lambda: noise(random),
        lambda: b"",
        lambda: b"421 go away\r\n",
        lambda: b"550 no\r\n",
        lambda: b"451 later\r\n",
        lambda: b"250-part one\r\n" + noise(random, 50),
        lambda: b"999 what\r\n",
        lambda: b"ok\r\n",
        lambda: b"250 " + b"a" * 100_000 + b"\r\n",
        lambda: None,
    )

    def serve(link: socket.socket, account: Account) -> None:
        account.answers += 1
        stage = int(random.integers(0, 9)) if account.answers <= fuzzed else 99
        stream = link.makefile("rb")
        recipients: list[str] = []
        for turn in range(40):
            command = b"" if turn == 0 else stream.readline(4096)
            if turn and not command:
                return
            verb = command[:4].upper()
            answer: bytes | None = b"220 hello\r\n" if turn == 0 else b"250 OK\r\n"
            text = ""
            if verb == b"DATA":
                answer = b"354 go\r\n"
            if turn == stage:
                drawn = odd[int(random.integers(0, len(odd)))]()
                answer = drawn if drawn is not None or random.random() < 0.1 else b"250 OK\r\n"
                if answer is None:
                    _drip(link, b"250-" + b"a" * 1000)
                    return
            if verb == b"RCPT" and answer.startswith(b"25"):
                recipients.append(command.split(b"<")[1].split(b">")[0].decode())
            link.sendall(answer)
            if verb == b"DATA" and answer.startswith(b"354"):
                lines = iter(stream.readline, b".\r\n")
                text = next(line for line in lines if line.startswith(b"Subject:")).decode()
                for _ in lines:
                    pass
                final = b"250 taken\r\n"
                if account.answers <= fuzzed and random.random() < 0.2:
                    final = odd[int(random.integers(0, len(odd) - 1))]() or b""
                if re.match(rb"2\d\d[ \r]", final):
                    for each in recipients:
                        account.confirmed[f"{text.split()[-1]} {each}"] += 1
                link.sendall(final)
                recipients = []

    return serve


def odd_broker(seed: int, fuzzed: int) -> Callable[[socket.socket, Account], None]:
    """A broker that answers oddly to CONNECT or PUBLISH in `fuzzed` connections (MQTT 3.1.1)."""
    random = np.random.default_rng(seed)

    def serve(link: socket.socket, account: Account) -> None:
        account.answers += 1
        odd = account.answers <= fuzzed and random.random() < 0.7
        stage = int(random.integers(0, 2)) if odd else 2
        _packet(link)
        refused = bytes([0x20, 2, 0, int(random.integers(1, 256))])
        connack = (noise(random, 40), b"", refused)[int(random.integers(0, 3))]
        link.sendall(connack if stage == 0 else b"\x20\x02\x00\x00")
        kind, content = _packet(link)
        if kind >> 4 != 3:
            return
        length = struct.unpack_from(">H", content)[0]
        number = struct.unpack_from(">H", content, 2 + length)[0]
        confirmation = struct.pack(">BBH", 0x40, 2, number)
        other = struct.pack(">BBH", 0x40, 2, number + 7)
        if stage == 1:
            confirmation = (noise(random, 40), b"", other, b"\x90\x01")[int(random.integers(0, 4))]
        if confirmation == struct.pack(">BBH", 0x40, 2, number):
            account.confirmed[json.loads(content[4 + length :])["text"]] += 1
        link.sendall(confirmation)
        with suppress(OSError):
            link.recv(100)

    return serve


def _packet(link: socket.socket) -> tuple[int, bytes]:
    """Kind and content of an MQTT packet."""
    kind, length, shift = _some(link, 1)[0], 0, 0
    while True:
        byte = _some(link, 1)[0]
        length |= (byte & 127) << shift
        shift += 7
        if not byte & 128:
            break
    content = b""
    while len(content) < length:
        content += _some(link, length - len(content))
    return kind, content


def _until(link: socket.socket, end: bytes) -> bytes:
    read = b""
    while end not in read:
        read += _some(link)
    return read


def _some(link: socket.socket, most: int = 65536) -> bytes:
    """Raises ValueError at the end of a link."""
    read = link.recv(most)
    if not read:
        raise ValueError("the link was cut")
    return read


def _drip(link: socket.socket, answer: bytes) -> None:
    for byte in answer:
        link.sendall(bytes([byte]))
        threading.Event().wait(DRIP)
