"""The deliveries' figures for Prometheus."""

from collections.abc import Sequence

from pipeline.monitoring.alarms.outbox import DeliveryState
from pipeline.monitoring.metrics import Families, counter, gauge
from sensors.acquisition.blocks import NANOSECONDS

CHANNEL = ("channel",)
OUTCOMES = ("delivered", "failed", "refused", "dropped")


def delivery_families(states: Sequence[DeliveryState]) -> Families:
    """What became of alarm messages, by channel."""
    yield counter(
        "alarm_deliveries",
        "Alarm messages by outcome; failed: attempts.",
        (*CHANNEL, "outcome"),
        (
            ((each.channel, outcome), float(getattr(each, outcome)))
            for each in states
            for outcome in OUTCOMES
        ),
    )
    yield gauge(
        "alarm_waiting",
        "Alarm messages that wait for delivery.",
        CHANNEL,
        (((each.channel,), float(each.waiting)) for each in states),
    )
    yield gauge(
        "alarm_age_seconds",
        "How long the oldest waiting alarm message has waited.",
        CHANNEL,
        (((each.channel,), each.age) for each in states),
    )
    yield gauge(
        "alarm_delivered_timestamp_seconds",
        "When an alarm message was last confirmed.",
        CHANNEL,
        (((each.channel,), each.last_ns / NANOSECONDS) for each in states if each.last_ns),
    )
