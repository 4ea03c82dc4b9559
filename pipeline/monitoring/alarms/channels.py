"""The ways out: each sends one telling or says why it could not."""

import json
import shlex
import smtplib
import ssl
import urllib.error
import urllib.request
from collections.abc import Mapping
from datetime import UTC, datetime
from email.message import EmailMessage
from email.utils import formatdate, make_msgid
from typing import Any, Protocol

from pipeline.monitoring.alarms.settings import (
    AlarmError,
    AlarmSettings,
    MailSettings,
    MqttSettings,
    WebhookSettings,
    secret,
)
from sensors.acquisition.blocks import NANOSECONDS

LONGEST_SUBJECT = 160  # [characters]

Json = Mapping[str, Any]


class DeliveryFailed(Exception):  # noqa: N818  # it says what happened
    """The outside did not take a telling; it is tried again. The text says why."""


class Channel(Protocol):
    """One way out."""

    @property
    def name(self) -> str:
        """Stays from run to run; unique among the channels. What waits is kept under it."""
        ...

    def send(self, telling: Json) -> None:
        """One telling, as `Telling.as_json` has it, with `host`, `session` (the folder in which it
        can be acknowledged) and `serial`. Raises DeliveryFailed."""
        ...


class Webhook:
    """POSTs JSON. A number that stays over retries is sent as `Idempotency-Key`."""

    def __init__(self, name: str, settings: WebhookSettings) -> None:
        self.name = name
        self._settings = settings

    def send(self, telling: Json) -> None:
        headers = {
            "Content-Type": "application/json",
            "User-Agent": "pilewatch",
            "Idempotency-Key": f"{telling['turbine']}-{telling['id']}-{telling['serial']}",
        }
        token = secret(self._settings.token_environment)
        if token:
            headers["Authorization"] = f"Bearer {token}"
        body = json.dumps(telling, ensure_ascii=False).encode()
        request = urllib.request.Request(  # http and https alone, by the settings
            self._settings.url, data=body, headers=headers, method="POST"
        )
        try:
            with urllib.request.urlopen(request, timeout=self._settings.timeout) as answer:
                answer.read(1024)
        except urllib.error.HTTPError as error:
            with error:
                raise DeliveryFailed(f"{self._settings.url} answered {error.code}") from error
        except (OSError, ValueError) as error:
            reason = getattr(error, "reason", error)
            raise DeliveryFailed(f"{self._settings.url}: {reason}") from error


class Mail:
    """An e-mail of a few lines, over STARTTLS unless the settings say otherwise."""

    def __init__(self, name: str, settings: MailSettings) -> None:
        self.name = name
        self._settings = settings

    def send(self, telling: Json) -> None:
        settings = self._settings
        try:
            with smtplib.SMTP(settings.host, settings.port, timeout=settings.timeout) as server:
                if settings.starttls:
                    server.starttls(context=ssl.create_default_context())
                if settings.user:
                    server.login(settings.user, secret(settings.password_environment))
                server.send_message(self._message(telling))
        except (OSError, smtplib.SMTPException) as error:
            raise DeliveryFailed(f"{settings.host}:{settings.port}: {error}") from error

    def _message(self, telling: Json) -> EmailMessage:
        message = EmailMessage()
        message["Subject"] = " ".join(f"[pilewatch] {telling['text']}".split())[:LONGEST_SUBJECT]
        message["From"] = self._settings.sender
        message["To"] = ", ".join(self._settings.recipients)
        message["Date"] = formatdate(telling["last_ns"] / 1e9)
        message["Message-ID"] = make_msgid(domain="pilewatch")
        first, last = _moment(telling["first_ns"]), _moment(telling["last_ns"])
        seen = "once" if telling["count"] == 1 else f"{telling['count']} times"
        when = f"at {first}" if first == last else f"since {first}, last at {last}"
        lines = [telling["text"], "", f"kind {telling['kind']}, seen {seen}, {when}"]
        if telling["occasion"] != "ended":
            lines.append(
                f"acknowledge it on {telling['host']}: "
                f"pilewatch ack {telling['id']} --out {shlex.quote(telling['session'])}"
            )
        message.set_content("\n".join([*lines, ""]))
        return message


def _moment(time_ns: int) -> str:
    return f"{datetime.fromtimestamp(time_ns // NANOSECONDS, UTC):%Y-%m-%d %H:%M:%S} UTC"


class Mqtt:
    """Publishes JSON with quality of service 1 under topic/TURBINE/KIND."""

    def __init__(self, name: str, settings: MqttSettings) -> None:
        try:
            import paho.mqtt.publish  # noqa: F401
        except ImportError:
            raise AlarmError(
                "[[mqtt]] needs the extra `mqtt`: pip install 'pilewatch[mqtt]'"
            ) from None
        self.name = name
        self._settings = settings

    def send(self, telling: Json) -> None:
        from paho.mqtt.client import Client
        from paho.mqtt.enums import CallbackAPIVersion, MQTTErrorCode

        settings = self._settings
        client = Client(CallbackAPIVersion.VERSION2)
        client.connect_timeout = settings.timeout
        if settings.user:
            client.username_pw_set(settings.user, secret(settings.password_environment) or None)
        if settings.tls:
            client.tls_set()
        topic = f"{settings.topic}/{telling['turbine']}/{telling['kind']}"
        place = f"{settings.host}:{settings.port}"
        try:
            client.connect(settings.host, settings.port)
            client.loop_start()
            told = client.publish(topic, json.dumps(telling, ensure_ascii=False), qos=1)
            told.wait_for_publish(settings.timeout)
            if told.rc != MQTTErrorCode.MQTT_ERR_SUCCESS or not told.is_published():
                raise DeliveryFailed(f"{place} did not confirm within {settings.timeout:g} s")
        except (OSError, ValueError, RuntimeError) as error:
            raise DeliveryFailed(f"{place}: {error}") from error
        finally:
            client.disconnect()
            client.loop_stop()


def channels_of(settings: AlarmSettings) -> tuple[Channel, ...]:
    """Every channel that the file names. Raises AlarmError where an extra is missing."""
    return (
        *(Webhook(f"webhook-{i}", each) for i, each in enumerate(settings.webhook, start=1)),
        *(Mqtt(f"mqtt-{i}", each) for i, each in enumerate(settings.mqtt, start=1)),
        *(Mail(f"mail-{i}", each) for i, each in enumerate(settings.mail, start=1)),
    )
