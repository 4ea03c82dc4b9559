"""Alarms that are open when a session ends have their end in the next one."""

import json
from collections.abc import Mapping
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pipeline.messages import Message, ModalEstimate, QualityWarning, WindowRejected
from pipeline.monitoring.alarms.alarm_node import AlarmNode
from pipeline.monitoring.alarms.channels import DeliveryFailed, Mail, Webhook, idempotency_key
from pipeline.monitoring.alarms.settings import AlarmLogSettings, MailSettings, WebhookSettings
from sensors.acquisition.blocks import NANOSECONDS
from tests.pipeline.archive.test_layout_periods import unchanged
from tests.pipeline.example_messages import LAYOUT, block, rejection, status
from tests.pipeline.monitoring.alarms.outside import web_server
from tests.pipeline.monitoring.alarms.test_alarm_node import Clock, wait_for
from tests.pipeline.monitoring.alarms.test_alarm_rules import EVENT, with_k22
from tests.pipeline.state.test_posterior_json import POSTERIOR

RECORDER = status("recorder")
POSTERIORS = replace(POSTERIOR, turbine="t1")
WITHOUT_LIMITS = AlarmLogSettings(k22_below=1.5, windows_without_posterior=3)
STOPPED = replace(RECORDER, warnings=(QualityWarning("recording-stopped", "the disk is full"),))
OFF = replace(RECORDER, warnings=(QualityWarning("clock-off", "unit u is a day behind"),))


def spiked(turbine: str, *names: str) -> ModalEstimate:
    warnings = tuple(QualityWarning("spikes", f"spikes in {name}") for name in names)
    return replace(unchanged(0), turbine=turbine, warnings=warnings)


def refused(number: int, code: str = "few-pairs") -> WindowRejected:
    return replace(rejection(number), turbine="t1", code=code)


# key, messages and pauses [s] that raise it, those that end it
ENDED_AFTER_A_START: list[tuple[str, list[Message | int], list[Message | int]]] = [
    ("t1/sensor/spikes/z41-fa", [LAYOUT, spiked("t1", "z41-fa")], [LAYOUT, spiked("t1")]),
    ("t1/clock/clock-drift", [refused(0, "clock-drift")], [refused(1), spiked("t1")]),
    ("t1/clock", [OFF], [RECORDER]),
    ("t1/recorder", [STOPPED], [RECORDER]),
    ("t1/untrusted", [replace(POSTERIORS, trusted=False)], [POSTERIORS]),
    ("t1/refused", [refused(0)], [POSTERIORS]),
    ("t1/threshold/k22", [POSTERIORS], [replace(with_k22(1.6), turbine="t1")]),
    ("t1/no-posterior", [POSTERIORS, *map(refused, range(3))], [refused(3), POSTERIORS]),
    ("t1/books", [block(0), *map(block, range(5, 11)), refused(0), refused(1)], [refused(2)]),
    ("t1/silence/tower", [block(0), 60, RECORDER], [block(9)]),
    ("t1/node/viewer", [status("viewer"), 90, block(0)], [status("viewer")]),
]


@pytest.mark.parametrize(
    ("key", "wrong", "well"), ENDED_AFTER_A_START, ids=[each[0] for each in ENDED_AFTER_A_START]
)
def test_an_alarm_ends_after_a_restart_by_the_same_message_as_before_it(
    tmp_path: Path, key: str, wrong: list[Message | int], well: list[Message | int]
) -> None:
    clock = Clock()

    def session(*messages: Message | int) -> set[str]:
        """Open alarms after the messages and pauses [s] of a session."""
        with closing(AlarmNode(tmp_path, WITHOUT_LIMITS, [], clock)) as node:
            for each in messages:
                if isinstance(each, int):
                    clock.now_ns += each * NANOSECONDS
                else:
                    node.handle(each)
            listed = json.loads(node.answer())["notices"]
        return {each["key"] for each in listed if not each["over_ns"]}

    assert key in session(*wrong)
    clock.now_ns += NANOSECONDS
    *before, last = well
    assert key in session(*before)
    clock.now_ns += NANOSECONDS
    assert key not in session(*before, last)


def test_open_alarms_of_several_turbines_end_each_by_its_own_windows(tmp_path: Path) -> None:
    clock = Clock()
    with closing(AlarmNode(tmp_path, WITHOUT_LIMITS, [], clock)) as node:
        for message in (LAYOUT, spiked("t1", "z41-fa", "z80-fa"), spiked("t2", "z41-fa")):
            node.handle(message)
    clock.now_ns += 600 * NANOSECONDS
    with closing(AlarmNode(tmp_path, WITHOUT_LIMITS, [], clock)) as node:
        node.handle(LAYOUT)
        node.handle(spiked("t1", "z80-fa"))
        listed = json.loads(node.answer())["notices"]

    assert {each["key"] for each in listed if not each["over_ns"]} == {
        "t1/sensor/spikes/z80-fa",
        "t2/sensor/spikes",
    }


def test_what_a_session_no_longer_watches_is_over_at_its_start(tmp_path: Path) -> None:
    clock = Clock()
    first = AlarmLogSettings(k22_below=1.5, undelivered=0.0)
    with web_server() as server:
        url = server.url  # that nobody answers
    channel = Webhook("webhook-2", WebhookSettings(url))
    with closing(AlarmNode(tmp_path, first, [channel], clock)) as node:
        node.handle(EVENT)
        for message in (POSTERIORS, spiked("t1", "z41-fa")):
            node.handle(message)
        wait_for(lambda: bool(node.warnings))
        clock.now_ns += NANOSECONDS
        node.handle(spiked("t1", "z41-fa"))
        raised = {each["kind"] for each in json.loads(node.answer())["notices"]}
    assert raised == {"change", "threshold", "sensor", "delivery"}

    with web_server() as server:
        webhook = Webhook("webhook-1", WebhookSettings(server.url))
        second = AlarmLogSettings(kinds=("delivery", "threshold", "gap"))
        with closing(AlarmNode(tmp_path, second, [webhook], clock)) as node:
            for _ in range(3):
                clock.now_ns += 86_400 * NANOSECONDS
                node.handle(RECORDER)
            wait_for(lambda: len(server.received) >= 3)
            listed = json.loads(node.answer())["notices"]

    assert {each["kind"] for each in listed if not each["closed"]} == {"change"}  # until its ack
    assert sorted((each["occasion"], each["kind"]) for each in server.received) == [
        ("ended", "delivery"),
        ("ended", "sensor"),
        ("ended", "threshold"),
    ]


def test_every_message_of_an_alarm_has_a_key_of_its_own_over_restarts_and_each_attempt_the_same(
    tmp_path: Path,
) -> None:
    """Receivers drop a message whose key they have seen. This one takes each at its second attempt;
    the last message comes after the folder was lost, of an alarm with the first one's number."""
    clock = Clock()
    mail = Mail("mail-1", MailSettings("localhost", "p@example.org", ("a@example.org",)))
    spike = spiked("t1", "z41-fa")
    sent: list[tuple[str, str, str]] = []

    class Channel:
        name, place = "webhook-1", "nowhere"

        def send(self, message: Mapping[str, Any], recipients: tuple[str, ...] = ()) -> None:
            identity = str(mail._message(message)["Message-ID"])
            sent.append((message["occasion"], idempotency_key(message), identity))
            if len(sent) % 2:
                raise DeliveryFailed("busy", message_only=True)

    for folder, message in (
        ("first", spike),
        ("first", RECORDER),
        ("first", spiked("t1")),
        ("second", spike),
    ):
        clock.now_ns += 86_400 * NANOSECONDS
        attempts = len(sent)
        with closing(AlarmNode(tmp_path / folder, AlarmLogSettings(), [Channel()], clock)) as node:
            node.handle(message)
            clock.now_ns += 900 * NANOSECONDS
            node.handle(RECORDER)
            wait_for(lambda: len(sent) > attempts)  # noqa: B023  # waited for at once
        AlarmNode(tmp_path / folder, AlarmLogSettings(), [Channel()], clock).close()

    assert [each[0] for each in sent[::2]] == ["raised", "reminder", "ended", "raised"]
    assert sent[::2] == sent[1::2]  # the attempts of one message
    for identities in list(zip(*sent[::2], strict=True))[1:]:
        assert len(set(identities)) == 4
