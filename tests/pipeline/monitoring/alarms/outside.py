"""The outside world on the loopback interface: a web server, a mail server."""

import json
import ssl
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from email import message_from_bytes
from email.message import Message as Mail
from http.server import BaseHTTPRequestHandler, HTTPServer
from typing import Any

from aiosmtpd.controller import Controller
from aiosmtpd.smtp import AuthResult, Envelope, LoginPassword, Session


@dataclass
class WebServer:
    """What it was sent; answers with the codes it is given first, then with 200."""

    port: int
    answers: list[int] = field(default_factory=list)
    received: list[dict[str, Any]] = field(default_factory=list)
    headers: list[dict[str, str]] = field(default_factory=list)
    taken: threading.Event = field(default_factory=threading.Event)

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}/hook"


@contextmanager
def web_server(
    *answers: int, port: int = 0, location: int = 0, tls: ssl.SSLContext | None = None
) -> Iterator[WebServer]:
    """On the loopback interface; `location` is the port that its redirects name."""

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            code = told.answers.pop(0) if told.answers else 200
            told.headers.append(dict(self.headers))
            if code == 200:
                told.received.append(body)
            self.send_response(code)
            if location:
                self.send_header("Location", f"http://127.0.0.1:{location}/elsewhere")
            self.end_headers()
            told.taken.set()

        def log_message(self, *_: Any) -> None:
            pass

    server = HTTPServer(("127.0.0.1", port), Handler)
    if tls is not None:
        server.socket = tls.wrap_socket(server.socket, server_side=True)
    told = WebServer(server.server_port, list(answers))
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield told
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


@dataclass
class MailServer:
    """What it was sent, and over what."""

    port: int = 0
    received: list[Mail] = field(default_factory=list)
    recipients: list[str] = field(default_factory=list)
    encrypted: list[bool] = field(default_factory=list)
    users: list[str] = field(default_factory=list)
    refused: str = ""

    async def handle_RCPT(  # noqa: N802
        self, _: Any, __: Session, envelope: Envelope, address: str, ___: Any
    ) -> str:
        if address == self.refused:
            return "550 no such user"
        envelope.rcpt_tos.append(address)
        return "250 OK"

    async def handle_DATA(self, _: Any, session: Session, envelope: Envelope) -> str:  # noqa: N802
        assert isinstance(envelope.content, bytes)
        self.received.append(message_from_bytes(envelope.content))
        self.recipients += envelope.rcpt_tos
        self.encrypted.append(session.ssl is not None)
        return "250 OK"

    def login(self, _: Any, __: Any, ___: Any, mechanism: str, data: LoginPassword) -> AuthResult:
        self.users.append(f"{data.login.decode()}:{data.password.decode()}")
        return AuthResult(success=True)


@contextmanager
def mail_server(
    port: int, tls: ssl.SSLContext | None = None, *, refused: str = "", at_once: bool = False
) -> Iterator[MailServer]:
    """`at_once`: TLS from the first byte, not by STARTTLS."""
    server = MailServer(port, refused=refused)
    controller = Controller(
        server,
        hostname="127.0.0.1",
        port=port,
        ssl_context=tls if at_once else None,
        tls_context=None if at_once else tls,
        require_starttls=tls is not None and not at_once,
        authenticator=server.login,
        auth_require_tls=tls is not None and not at_once,
    )
    controller.start()
    try:
        yield server
    finally:
        controller.stop()
