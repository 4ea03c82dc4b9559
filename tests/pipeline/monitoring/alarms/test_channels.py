"""What goes out arrives as it was said, or it is said why not."""

import json
import ssl
from pathlib import Path
from typing import Any

import pytest
from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion

from pipeline.deploy.certificates import make_certificates
from pipeline.monitoring.alarms.channels import DeliveryFailed, Mail, Mqtt, Webhook
from pipeline.monitoring.alarms.settings import MailSettings, MqttSettings, WebhookSettings
from tests.pipeline.monitoring.alarms.outside import mail_server, web_server
from tests.sensors.feeds.broker import Broker, free_port, mosquitto

TELLING: dict[str, Any] = {
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


def test_a_webhook_gets_the_telling_as_json_with_its_token(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("HOOK_TOKEN", "abc")
    with web_server() as server:
        Webhook("webhook-1", WebhookSettings(server.url, "HOOK_TOKEN")).send(TELLING)

    assert server.received == [TELLING]
    (headers,) = server.headers
    assert headers["Authorization"] == "Bearer abc"
    assert headers["Idempotency-Key"] == "t1-3-17"


def test_a_webhook_that_answers_an_error_or_nothing_has_failed() -> None:
    with web_server(503) as server:
        webhook = Webhook("webhook-1", WebhookSettings(server.url))
        with pytest.raises(DeliveryFailed, match="answered 503"):
            webhook.send(TELLING)
    with pytest.raises(DeliveryFailed, match="Connection refused"):
        webhook.send(TELLING)


def test_a_mail_says_it_in_its_subject_and_how_to_acknowledge_it() -> None:
    settings = MailSettings(
        "127.0.0.1", "p@example.org", ("a@example.org", "b@example.org"), free_port(), False
    )
    with mail_server(settings.port) as server:
        Mail("mail-1", settings).send(TELLING)
        Mail("mail-1", settings).send(TELLING | {"occasion": "ended"})

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


def test_a_mail_goes_over_starttls_with_the_password_of_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_certificates(tmp_path, ["mail"], host="127.0.0.1")
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    tls.load_cert_chain(tmp_path / "mail.pem", tmp_path / "mail-key.pem")
    monkeypatch.setenv("SSL_CERT_FILE", str(tmp_path / "ca.pem"))
    monkeypatch.setenv("MAIL_PASSWORD", "secret")
    settings = MailSettings(
        "127.0.0.1",
        "p@example.org",
        ("a@example.org",),
        free_port(),
        user="p",
        password_environment="MAIL_PASSWORD",
    )
    with mail_server(settings.port, tls) as server:
        Mail("mail-1", settings).send(TELLING)

    assert server.encrypted == [True]
    assert server.users == ["p:secret"]


def test_a_mail_server_that_cannot_encrypt_gets_nothing() -> None:
    settings = MailSettings("127.0.0.1", "p@example.org", ("a@example.org",), free_port())
    with mail_server(settings.port) as server, pytest.raises(DeliveryFailed, match="STARTTLS"):
        Mail("mail-1", settings).send(TELLING)

    assert server.received == []


@pytest.mark.skipif(mosquitto() is None, reason="mosquitto is not installed")
def test_a_broker_passes_the_telling_on_and_a_dead_one_has_failed(tmp_path: Path) -> None:
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
            channel.send(TELLING)
            for _ in range(20):
                listener.loop(0.05)
    finally:
        broker.kill()

    assert heard[0].topic == "pilewatch/notices/t1/change"
    assert json.loads(heard[0].payload) == TELLING
    with pytest.raises(DeliveryFailed, match="Connection refused"):
        channel.send(TELLING)
