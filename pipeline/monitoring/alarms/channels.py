"""The channels: each delivers one alarm message, or reports why it could not.

    webhook   POST, answered by 2xx; a redirect is a failure and is never followed
    mail      SMTP with STARTTLS, TLS from the first byte, or none; one result a recipient
    mqtt      PUBLISH with quality of service 1, confirmed by the broker

Every delivery has one deadline for all of it: names, connection, TLS, answer. A receiver that
answers one byte a second holds a channel no longer than one that does not answer.
"""

import asyncio
import json
import logging
import os
import shlex
import ssl
from collections.abc import Coroutine, Mapping
from email.message import EmailMessage
from email.utils import formatdate
from typing import Any, Protocol, TypeVar
from urllib.parse import urlsplit

import aiosmtplib
import httpx

from pipeline.monitoring.alarms.alarm_rules import WHOLE_SESSION, moment_text
from pipeline.monitoring.alarms.settings import (
    AlarmError,
    AlarmSettings,
    MailSettings,
    MqttSettings,
    WebhookSettings,
    secret,
)
from sensors.extras import import_extra

logger = logging.getLogger(__name__)

LONGEST_SUBJECT = 160  # [characters]
LONGEST_REASON = 200  # of a failure, some of which the receiver writes [characters]
REFUSES_MESSAGE = frozenset({400, 413, 415, 422})  # HTTP: another message may be accepted

JsonBody = Mapping[str, Any]
_T = TypeVar("_T")


class DeliveryFailed(Exception):  # noqa: N818  # a state of the delivery, not a fault of the program
    """The receiver did not accept a message; the text is the reason.

    Parameters
    ----------
    reason : str
        One line.
    message_only : bool
        Whether the failure concerns this message alone; otherwise no message gets through.
    remaining : tuple of str
        Recipients that have not got the message; empty: all of them.
    """

    def __init__(
        self, reason: str, *, message_only: bool = False, remaining: tuple[str, ...] = ()
    ) -> None:
        line = "".join(c if c.isprintable() else " " for c in reason)
        super().__init__(" ".join(line.split())[:LONGEST_REASON])
        self.message_only = message_only
        self.remaining = remaining


class AlarmChannel(Protocol):
    """One way to the receiver."""

    @property
    def name(self) -> str:
        """Unique among the channels and the same from run to run: names the outbox's folder."""
        ...

    @property
    def place(self) -> str:
        """The receiver, without secrets."""
        ...

    def send(self, message: JsonBody, recipients: tuple[str, ...] = ()) -> None:
        """Deliver one message.

        Parameters
        ----------
        message : mapping
            `AlarmMessage.as_json` with `host`, `session` (the folder to acknowledge it in) and
            `serial`.
        recipients : tuple of str
            Those that an earlier attempt has not reached; empty: all.

        Raises
        ------
        DeliveryFailed
            If the receiver does not confirm it.
        """
        ...


class Webhook:
    """POST of JSON. `Idempotency-Key` stays the same over the attempts of one message."""

    def __init__(self, name: str, settings: WebhookSettings) -> None:
        self.name = name
        self.place = origin(settings.url)
        self._settings = settings

    def send(self, message: JsonBody, recipients: tuple[str, ...] = ()) -> None:
        """See `AlarmChannel`. 2xx alone is a delivery."""
        post_json(self._settings, message, {"Idempotency-Key": idempotency_key(message)})


def idempotency_key(message: JsonBody) -> str:
    """Return the key of one message, the same in every attempt and of no other message."""
    return f"{message['turbine']}-{message['id']}-{message['serial']}"


def post_json(settings: WebhookSettings, content: JsonBody, headers: Mapping[str, str]) -> None:
    """POST to the origin of the settings and to no other host.

    Parameters
    ----------
    settings : WebhookSettings
        With the URL, the token's place and the timeout.
    content : JsonBody
        The body.
    headers : mapping of str to str
        Beside content type, user agent and token.

    Raises
    ------
    DeliveryFailed
        For any answer but 2xx, a redirect among them, and for none within the timeout.
    """
    token = secret(settings.token_environment)
    sent = {"Content-Type": "application/json", "User-Agent": "pilewatch", **headers}
    if token:
        sent["Authorization"] = f"Bearer {token}"
    body = json.dumps(content, ensure_ascii=False).encode()
    place = origin(settings.url)
    try:
        status, location = _finished(_post(settings, body, sent), settings.timeout, place)
    except (httpx.HTTPError, httpx.InvalidURL, OSError, ValueError) as error:
        raise DeliveryFailed(f"{place}: {_system_reason(error)}") from error
    if 300 <= status < 400:
        target = origin(location) if urlsplit(location).netloc else "a path of its own"
        raise DeliveryFailed(
            f"{place} answered {status}, a redirect to {target}; redirects are not followed: "
            "set url to the final address"
        )
    if not 200 <= status < 300:
        raise DeliveryFailed(f"{place} answered {status}", message_only=status in REFUSES_MESSAGE)


async def _post(
    settings: WebhookSettings, body: bytes, headers: Mapping[str, str]
) -> tuple[int, str]:
    """Status and Location of the answer; its body is not read."""
    context = tls_context(settings.ca)
    async with (
        httpx.AsyncClient(verify=context, timeout=settings.timeout, follow_redirects=False) as http,
        http.stream("POST", settings.url, content=body, headers=headers) as answer,
    ):
        return answer.status_code, answer.headers.get("location", "")


def origin(url: str) -> str:
    """Scheme, host and port: path, query and user of a webhook's URL are often its secret."""
    parts = urlsplit(url)
    return f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}"


class Mail:
    """An e-mail of a few lines."""

    def __init__(self, name: str, settings: MailSettings) -> None:
        self.name = name
        self.place = f"{settings.host}:{settings.port}"
        self._settings = settings

    def send(self, message: JsonBody, recipients: tuple[str, ...] = ()) -> None:
        """See `AlarmChannel`. Each recipient is confirmed or refused on its own."""
        settings, place = self._settings, self.place
        wanted = recipients or settings.recipients
        try:
            refused = _finished(self._sent(message, wanted), settings.timeout, place)
        except aiosmtplib.SMTPRecipientsRefused as error:
            refused = {each.recipient: f"{each.code} {each.message}" for each in error.recipients}
        except (aiosmtplib.SMTPSenderRefused, aiosmtplib.SMTPDataError) as error:
            raise DeliveryFailed(f"{place}: {error}", message_only=True) from error
        except (aiosmtplib.SMTPException, OSError, ValueError) as error:
            raise DeliveryFailed(f"{place}: {_system_reason(error)}") from error
        if refused:
            reasons = "; ".join(f"{who}: {why}" for who, why in refused.items())
            raise DeliveryFailed(
                f"{place} refuses {reasons}", message_only=True, remaining=tuple(refused)
            )

    async def _sent(self, message: JsonBody, recipients: tuple[str, ...]) -> dict[str, str]:
        """The refused recipients, each with the server's reason."""
        settings = self._settings
        client = aiosmtplib.SMTP(
            hostname=settings.host,
            port=settings.port,
            timeout=settings.timeout,
            use_tls=settings.tls,
            start_tls=settings.starttls and not settings.tls,
            tls_context=tls_context(settings.ca),
        )
        try:
            await client.connect()
            if settings.user:
                await client.login(settings.user, secret(settings.password_environment))
            refused, _ = await client.send_message(
                self._message(message), sender=settings.sender, recipients=list(recipients)
            )
        finally:
            client.close()  # without QUIT: an odd answer to it undoes no delivery
        return {who: f"{answer.code} {answer.message}" for who, answer in refused.items()}

    def _message(self, message: JsonBody) -> EmailMessage:
        mail = EmailMessage()
        headline = _headline(message)
        mail["Subject"] = " ".join(f"[pilewatch] {headline}".split())[:LONGEST_SUBJECT]
        mail["From"] = self._settings.sender
        mail["To"] = ", ".join(self._settings.recipients)
        mail["Date"] = formatdate(message["last_ns"] / 1e9)
        number = f"{message['id']}.{message['serial']}.{message['last_ns']}"
        mail["Message-ID"] = f"<{number}@pilewatch>"  # the same in every attempt
        first, last = moment_text(message["first_ns"]), moment_text(message["last_ns"])
        seen = "once" if message["count"] == 1 else f"{message['count']} times"
        when = f"at {first}" if first == last else f"since {first}, last at {last}"
        lines = [headline, "", f"kind {message['kind']}, seen {seen}, {when}"]
        if message["occasion"] in ("raised", "reminder"):
            lines.append(
                f"acknowledge it on {message['host']}: "
                f"pilewatch ack {message['id']} --out {shlex.quote(message['session'])}"
            )
        mail.set_content("\n".join([*lines, ""]))
        return mail


def _headline(message: JsonBody) -> str:
    """The text of a message; where it is about the whole session, after its machine's name."""
    text = str(message["text"])
    if message["turbine"] != WHOLE_SESSION:
        return text
    return f"{message['host']}: {text.removeprefix(f'{WHOLE_SESSION}: ')}"


class Mqtt:
    """JSON with quality of service 1 under topic/TURBINE/KIND."""

    def __init__(self, name: str, settings: MqttSettings) -> None:
        import_extra("aiomqtt", "mqtt", "[[mqtt]]", AlarmError)
        self.name = name
        self.place = f"{settings.host}:{settings.port}"
        self._settings = settings

    def send(self, message: JsonBody, recipients: tuple[str, ...] = ()) -> None:
        """See `AlarmChannel`. The broker's PUBACK is the delivery."""
        from aiomqtt import MqttError

        logging.getLogger("mqtt").setLevel(logging.CRITICAL)  # its own lines on a failed link
        try:
            _finished(self._publish(message), self._settings.timeout, self.place)
        except (MqttError, OSError, ValueError) as error:
            raise DeliveryFailed(f"{self.place}: {_system_reason(error)}") from error

    async def _publish(self, message: JsonBody) -> None:
        from aiomqtt import Client, MqttError

        settings = self._settings
        client = Client(
            settings.host,
            settings.port,
            username=settings.user or None,
            password=secret(settings.password_environment) or None,
            tls_context=tls_context(settings.ca) if settings.tls else None,
            timeout=settings.timeout,
        )
        levels = (_topic_level(message["turbine"]), _topic_level(message["kind"]))
        confirmed = False
        try:
            async with client:
                payload = json.dumps(message, ensure_ascii=False)
                await client.publish("/".join((settings.topic, *levels)), payload, qos=1)
                confirmed = True
        except MqttError:
            if not confirmed:  # a link that breaks after PUBACK undoes no delivery
                raise


def _topic_level(name: str) -> str:
    return "".join("_" if letter in "+#/\0" else letter for letter in name) or "_"


def tls_context(authority: str) -> ssl.SSLContext:
    """Certificates are checked against one authority's file; "": against the system's."""
    return ssl.create_default_context(cafile=authority or None)


def _finished(delivery: Coroutine[Any, Any, _T], seconds: float, place: str) -> _T:
    """Run a delivery to its end within one deadline for all of it [s]."""

    async def bounded() -> _T:
        asyncio.get_running_loop().set_exception_handler(_in_a_callback)
        async with asyncio.timeout(seconds):
            return await delivery

    try:
        with asyncio.Runner() as runner:
            return runner.run(bounded())
    except TimeoutError as error:
        raise DeliveryFailed(f"{place}: no confirmation within {seconds:g} s") from error


def _in_a_callback(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """A library's callback that fails on an odd answer: the delivery then ends by its deadline."""
    logger.debug("a delivery's callback: %s", context.get("message"))


def _system_reason(error: BaseException) -> str:
    """The system's words at the root of an error, without the wrappers' "all attempts failed"."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, ssl.SSLCertVerificationError):
            return f"the certificate is refused: {cause.verify_message}"
        of_system = isinstance(cause, OSError) and not isinstance(cause, ssl.SSLError)
        if of_system and (number := getattr(cause, "errno", 0) or 0) > 0:
            return os.strerror(number)
        cause = cause.__cause__ or cause.__context__
    return str(error) or type(error).__name__


def channels_of(settings: AlarmSettings) -> tuple[AlarmChannel, ...]:
    """Return every channel of the settings.

    Raises
    ------
    AlarmError
        If an extra is not installed.
    """
    return (
        *(Webhook(f"webhook-{i}", each) for i, each in enumerate(settings.webhook, start=1)),
        *(Mqtt(f"mqtt-{i}", each) for i, each in enumerate(settings.mqtt, start=1)),
        *(Mail(f"mail-{i}", each) for i, each in enumerate(settings.mail, start=1)),
    )
