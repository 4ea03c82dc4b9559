"""A message arrives as it was sent, or its channel reports why not."""

import asyncio
import errno
import json
import os
import socket
import ssl
import threading
import time
from dataclasses import replace
from email.header import decode_header, make_header
from pathlib import Path
from typing import Any

import pytest
from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion

from pipeline.deploy.certificates import make_certificates
from pipeline.monitoring.alarms.channels import DeliveryFailed, Mail, Mqtt, Webhook
from pipeline.monitoring.alarms.settings import (
    AlarmError,
    MailSettings,
    MqttSettings,
    WebhookSettings,
)
from tests.pipeline.monitoring.alarms.fuzz import PROTOCOLS, fuzzed
from tests.pipeline.monitoring.alarms.odd_answers import Account, foreign, receiver
from tests.pipeline.monitoring.alarms.outside import mail_server, web_server
from tests.sensors.feeds.broker import Broker, free_port, mosquitto

MESSAGE: dict[str, Any] = {
    "occasion": "raised",
    "id": 3,
    "serial": 17,
    "kind": "change",
    "turbine": "t1",
    "text": "t1: k22 fell by 10 % ± 1 %",
    "cause": "k22 fell by 10 % ± 1 %",
    "host": "shore-1",
    "session": "/srv/my session",
    "count": 2,
    "first_ns": 1_700_000_000 * 10**9,
    "last_ns": 1_700_000_600 * 10**9,
    "acknowledged": False,
}


def test_a_webhook_gets_the_message_as_json_with_its_token(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("HOOK_TOKEN", "abc")
    with web_server() as server:
        Webhook("webhook-1", WebhookSettings(server.url, "HOOK_TOKEN")).send(MESSAGE)

    assert server.received == [MESSAGE]
    (headers,) = server.headers
    assert headers["Authorization"] == "Bearer abc"
    assert headers["Idempotency-Key"] == "t1-3-17"


def test_a_webhook_that_answers_an_error_or_nothing_has_failed() -> None:
    with web_server(503) as server:
        webhook = Webhook("webhook-1", WebhookSettings(server.url))
        with pytest.raises(DeliveryFailed, match="answered 503"):
            webhook.send(MESSAGE)
    with pytest.raises(DeliveryFailed, match="Connection refused"):
        webhook.send(MESSAGE)


@pytest.mark.parametrize("number", [errno.EPERM, errno.ENETUNREACH])
def test_why_a_system_makes_no_connection_is_in_its_own_words(
    number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A firewall's rule is the first of all numbers."""

    async def refused(*_: object) -> None:
        raise OSError(number, "in a library's words")

    monkeypatch.setattr(asyncio.SelectorEventLoop, "sock_connect", refused)
    with pytest.raises(DeliveryFailed, match=os.strerror(number)):
        Webhook("webhook-1", WebhookSettings("http://127.0.0.1:9/hook", "")).send(MESSAGE)


@pytest.mark.parametrize(("status", "message_only"), [(400, True), (422, True), (503, False)])
def test_an_answer_is_about_the_message_or_about_the_server(
    status: int, message_only: bool
) -> None:
    """After a message that is refused the next one is tried; a server that is away holds all up."""
    with web_server(status) as server, pytest.raises(DeliveryFailed) as failure:
        Webhook("webhook-1", WebhookSettings(server.url)).send(MESSAGE)
    assert failure.value.message_only is message_only


def test_a_mail_says_it_in_its_subject_and_how_to_acknowledge_it() -> None:
    settings = MailSettings(
        "127.0.0.1", "p@example.org", ("a@example.org", "b@example.org"), free_port(), False
    )
    with mail_server(settings.port) as server:
        Mail("mail-1", settings).send(MESSAGE)
        Mail("mail-1", settings).send(MESSAGE | {"occasion": "ended"})

    told, over = server.received
    assert told["Subject"] is not None
    text = str(told.get_payload(decode=True), "utf-8")  # type: ignore[arg-type]
    assert text.splitlines() == [
        "t1: k22 fell by 10 % ± 1 %",
        "",
        "kind change, seen 2 times, since 2023-11-14 22:13:20 UTC, last at 2023-11-14 22:23:20 UTC",
        "acknowledge it on shore-1: pilewatch ack 3 --out '/srv/my session'",
    ]
    assert b"pilewatch ack" not in over.get_payload(decode=True)  # type: ignore[operator]
    assert server.recipients == 2 * ["a@example.org", "b@example.org"]


def test_a_mail_about_the_whole_session_begins_with_its_machine() -> None:
    settings = MailSettings("127.0.0.1", "p@example.org", ("a@example.org",), free_port(), False)
    about = {"turbine": "session", "text": "session: over: the recorder waits"}
    with mail_server(settings.port) as server:
        Mail("mail-1", settings).send(MESSAGE | about)
        Mail("mail-1", settings).send(MESSAGE)

    whole, turbine = (str(make_header(decode_header(each["Subject"]))) for each in server.received)
    assert whole == "[pilewatch] shore-1: over: the recorder waits"
    assert turbine == "[pilewatch] t1: k22 fell by 10 % ± 1 %"
    (first, *_) = server.received[0].get_payload(decode=True).splitlines()  # type: ignore[union-attr]
    assert first == b"shore-1: over: the recorder waits"


def test_a_mail_goes_over_starttls_with_the_password_of_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ca = _certified(tmp_path, "mail")
    monkeypatch.setenv("SSL_CERT_FILE", str(ca))
    monkeypatch.setenv("MAIL_PASSWORD", "secret")
    settings = MailSettings(
        "127.0.0.1",
        "p@example.org",
        ("a@example.org",),
        free_port(),
        user="p",
        password_environment="MAIL_PASSWORD",
    )
    with mail_server(settings.port, _server_tls(tmp_path, "mail")) as server:
        Mail("mail-1", settings).send(MESSAGE)

    assert server.encrypted == [True]
    assert server.users == ["p:secret"]


def test_a_mail_server_that_cannot_encrypt_gets_nothing() -> None:
    settings = MailSettings("127.0.0.1", "p@example.org", ("a@example.org",), free_port())
    with mail_server(settings.port) as server, pytest.raises(DeliveryFailed, match="STARTTLS"):
        Mail("mail-1", settings).send(MESSAGE)

    assert server.received == []


@pytest.mark.parametrize("code", [301, 302, 303, 307, 308])
def test_a_redirect_is_no_delivery_and_no_token_goes_to_another_host(
    monkeypatch: pytest.MonkeyPatch, code: int
) -> None:
    monkeypatch.setenv("HOOK_TOKEN", "abc")
    with receiver(foreign) as other, web_server(code, location=other.port) as server:
        webhook = Webhook("webhook-1", WebhookSettings(server.url, "HOOK_TOKEN"))
        with pytest.raises(DeliveryFailed, match=rf"{code}, a redirect to http://127.0.0.1:"):
            webhook.send(MESSAGE)

    assert other.reached == []


def test_an_answer_that_drips_ends_by_the_deadline() -> None:
    def dripping(link: socket.socket, _: Account) -> None:
        link.recv(65536)
        for byte in 100 * b"HTTP/1.1 100 Continue\r\n\r\n":
            link.sendall(bytes([byte]))
            threading.Event().wait(0.05)

    with receiver(dripping) as server:
        url = f"http://127.0.0.1:{server.port}/"
        started = time.monotonic()
        with pytest.raises(DeliveryFailed, match=r"no confirmation within 0\.3 s"):
            Webhook("webhook-1", WebhookSettings(url, timeout=0.3)).send(MESSAGE)

    assert time.monotonic() - started < 2.0


def test_a_refusal_of_one_recipient_does_not_count_as_a_delivery_to_it() -> None:
    settings = MailSettings(
        "127.0.0.1", "p@example.org", ("a@example.org", "b@example.org"), free_port(), False
    )
    with mail_server(settings.port, refused="b@example.org") as server:
        channel = Mail("mail-1", settings)
        with pytest.raises(DeliveryFailed, match=r"refuses b@example.org: 550") as failure:
            channel.send(MESSAGE)
        with pytest.raises(DeliveryFailed):
            channel.send(MESSAGE, failure.value.remaining)

    assert failure.value.remaining == ("b@example.org",)
    assert server.recipients == ["a@example.org"]  # once


def test_a_mail_goes_over_tls_from_the_first_byte_with_a_private_authority(tmp_path: Path) -> None:
    settings = MailSettings(
        "127.0.0.1",
        "p@example.org",
        ("a@example.org",),
        free_port(),
        tls=True,
        ca=str(_certified(tmp_path, "mail")),
    )
    with mail_server(settings.port, _server_tls(tmp_path, "mail"), at_once=True) as server:
        Mail("mail-1", settings).send(MESSAGE)
        with pytest.raises(DeliveryFailed, match="certificate"):
            Mail("mail-1", replace(settings, ca="")).send(MESSAGE)

    assert len(server.received) == 1


def test_a_webhook_trusts_a_private_authority_and_no_other(tmp_path: Path) -> None:
    ca = _certified(tmp_path, "hook")
    with web_server(tls=_server_tls(tmp_path, "hook")) as server:
        url = server.url.replace("http:", "https:")
        Webhook("webhook-1", WebhookSettings(url, ca=str(ca))).send(MESSAGE)
        with pytest.raises(DeliveryFailed, match="certificate"):
            Webhook("webhook-1", WebhookSettings(url)).send(MESSAGE)

    assert server.received == [MESSAGE]


def test_no_part_of_a_url_that_may_be_a_secret_is_in_a_failure() -> None:
    webhook = Webhook("webhook-1", WebhookSettings("http://user:pw@127.0.0.1:9/T0/B0/secret?k=v"))
    with pytest.raises(DeliveryFailed) as failure:
        webhook.send(MESSAGE)

    assert str(failure.value) == "http://127.0.0.1:9: Connection refused"


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_odd_answers_lose_no_message_and_end_no_channel(
    protocol: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOOK_TOKEN", "the-secret-token")
    outcome = fuzzed(protocol, 25, 4, tmp_path)

    assert outcome.delivered > 5
    assert (outcome.silent, outcome.dead, outcome.foreign) == (0, 0, 0)


def _certified(folder: Path, name: str) -> Path:
    """The authority's file; a certificate of it for `name` lies beside it."""
    make_certificates(folder, [name], host="127.0.0.1")
    return folder / "ca.pem"


def _server_tls(folder: Path, name: str) -> ssl.SSLContext:
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    tls.load_cert_chain(folder / f"{name}.pem", folder / f"{name}-key.pem")
    return tls


@pytest.mark.skipif(mosquitto() is None, reason="mosquitto is not installed")
def test_a_broker_passes_the_message_on_and_a_dead_one_has_failed(tmp_path: Path) -> None:
    broker = Broker(tmp_path)
    broker.start()
    channel = Mqtt("mqtt-1", MqttSettings("127.0.0.1", broker.port))
    heard: list[MQTTMessage] = []
    listener = Client(CallbackAPIVersion.VERSION2)
    listener.on_message = lambda _, __, message: heard.append(message)
    try:
        listener.connect("127.0.0.1", broker.port)
        listener.subscribe("pilewatch/notices/#", qos=1)
        while not heard:
            channel.send(MESSAGE)
            for _ in range(20):
                listener.loop(0.05)
    finally:
        broker.kill()

    assert heard[0].topic == "pilewatch/notices/t1/change"
    assert json.loads(heard[0].payload) == MESSAGE
    with pytest.raises(DeliveryFailed, match="Connection refused"):
        channel.send(MESSAGE)


@pytest.mark.parametrize("port", [0, -1, 65_536])
def test_a_mail_servers_port_is_one_that_there_is(port: int) -> None:
    with pytest.raises(AlarmError, match=f"port is {port}"):
        MailSettings("localhost", "a@b.no", ("c@d.no",), port=port)
