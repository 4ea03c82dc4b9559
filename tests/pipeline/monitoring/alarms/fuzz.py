"""A channel against a receiver that answers oddly: what was delivered, and what was lost."""

import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.monitoring.alarms.channels import AlarmChannel, Mail, Mqtt, Webhook
from pipeline.monitoring.alarms.outbox import (
    MOST_REFUSALS,
    REFUSED_DELIVERY,
    DeliveryThread,
    Outbox,
    decoded_waiting,
)
from pipeline.monitoring.alarms.settings import MailSettings, MqttSettings, WebhookSettings
from tests.pipeline.monitoring.alarms.odd_answers import (
    Account,
    foreign,
    odd_broker,
    odd_mail,
    odd_web,
    receiver,
)

PROTOCOLS = ("http", "smtp", "mqtt")
TIMEOUT = 0.4  # of a delivery [s]
PAUSE = 0.001  # between attempts [s]
RECIPIENTS = ("a@example.org", "b@example.org")
TOKEN = "the-secret-token"


@dataclass(frozen=True, slots=True)
class FuzzOutcome:
    """Of one protocol."""

    protocol: str
    answers: int
    """Connections that were answered [-]."""
    delivered: int
    """Messages that the channel counts as delivered [-]."""
    refused: int
    """Messages set aside and reported as refused [-]."""
    silent: int
    """Messages, or recipients of one, counted as delivered without a confirmation [-]."""
    dead: int
    """1: the channel no longer delivers [-]."""
    foreign: int
    """Connections to a foreign host [-]."""


def fuzzed(protocol: str, answers: int, seed: int, folder: Path) -> FuzzOutcome:
    """Send messages until a receiver has given so many odd answers; then it is well again."""
    with ExitStack() as stack:
        stranger = stack.enter_context(receiver(foreign))
        serve = {
            "http": lambda: odd_web(seed, answers, stranger.port),
            "smtp": lambda: odd_mail(seed, answers),
            "mqtt": lambda: odd_broker(seed, answers),
        }[protocol]()
        account = stack.enter_context(receiver(serve))
        outbox = Outbox(folder)
        delivery = DeliveryThread(_channel(protocol, account.port), outbox, PAUSE)
        delivery.start()
        sent = _sent_until(answers, account, outbox, delivery)
        alive = delivery.is_alive() and _ends(outbox, delivery)
        state = delivery.state()
        delivery.stop(10.0)
        return FuzzOutcome(
            protocol,
            account.answers,
            state.delivered,
            state.refused,
            _silent(protocol, folder, sent, account),
            int(not alive),
            len(stranger.reached),
        )


def _channel(protocol: str, port: int) -> AlarmChannel:
    if protocol == "http":
        url = f"http://127.0.0.1:{port}/hook"
        return Webhook("webhook-1", WebhookSettings(url, "HOOK_TOKEN", TIMEOUT))
    if protocol == "mqtt":
        return Mqtt("mqtt-1", MqttSettings("127.0.0.1", port, timeout=TIMEOUT))
    return Mail(
        "mail-1",
        MailSettings("127.0.0.1", "p@example.org", RECIPIENTS, port, False, timeout=TIMEOUT),
    )


def _message(number: int) -> dict[str, Any]:
    return {
        **{"occasion": "raised", "id": number, "kind": "gap", "turbine": "t1", "host": "h"},
        **{"text": f"message-{number}", "cause": "c", "session": "/s", "count": 1},
        **{"first_ns": 1, "last_ns": 2, "acknowledged": False},
    }


def _sent_until(answers: int, account: Account, outbox: Outbox, delivery: DeliveryThread) -> int:
    """How many messages were put into the outbox, a few at a time."""
    sent, deadline = 0, time.monotonic() + 2.0 * answers * TIMEOUT + 60
    while account.answers < answers and time.monotonic() < deadline and delivery.is_alive():
        if len(outbox.waiting()) < 4:
            outbox.put(_message(sent))
            sent += 1
        delivery.wake()
        time.sleep(0.002)
    return sent


def _ends(outbox: Outbox, delivery: DeliveryThread) -> bool:
    """Whether everything goes out now that the receiver is well again."""
    deadline = time.monotonic() + 30 * MOST_REFUSALS * TIMEOUT
    while outbox.waiting() and time.monotonic() < deadline:
        delivery.wake()
        time.sleep(0.01)
    return not outbox.waiting()


def _silent(protocol: str, folder: Path, sent: int, account: Account) -> int:
    """Messages, or recipients, that nothing reports and the receiver never confirmed."""
    kept = [*folder.glob("*.json"), *(folder / REFUSED_DELIVERY).glob("*.json")]
    reported = {}
    for path in kept:
        waiting = decoded_waiting(path.read_bytes())
        reported[waiting.message["text"]] = waiting.recipients or RECIPIENTS
    silent = 0
    for number in range(sent):
        text = f"message-{number}"
        if protocol != "smtp":
            silent += text not in reported and not account.confirmed[text]
            continue
        for each in set(RECIPIENTS) - set(reported.get(text, ())):
            silent += not account.confirmed[f"{text} {each}"]
    return silent
