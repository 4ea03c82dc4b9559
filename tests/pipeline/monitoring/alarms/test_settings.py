"""A notices file: what is taken at a limit and refused beyond it, and what stands where nothing is
stated."""

from dataclasses import replace
from typing import Any

import pytest

from pipeline.monitoring.alarms.settings import (
    KINDS,
    AlarmError,
    AlarmLogSettings,
    AlarmSettings,
    HeartbeatSettings,
    MailSettings,
    MqttSettings,
    WebhookSettings,
)

LOG = AlarmLogSettings()
HOOK, BEAT = WebhookSettings("http://a/b"), HeartbeatSettings("http://a/b")
QUEUE = MqttSettings("broker")
MAIL = MailSettings(host="mail", sender="a@b", recipients=("c@d",))
HOUR, DAY = 3600.0, 86400.0  # [s]


@pytest.mark.parametrize(
    ("settings", "key", "taken", "refused"),
    [
        *((LOG, key, 0.0, -0.001) for key in ("reminder", "settle", "shortest_gap", "undelivered")),
        (LOG, "windows_without_posterior", 1, 0),
        *((each, "timeout", HOUR, HOUR + 0.001) for each in (HOOK, BEAT, QUEUE, MAIL)),
        *((each, "timeout", 0.001, 0.0) for each in (HOOK, BEAT, QUEUE, MAIL)),
        *((each, "port", 65535, 65536) for each in (QUEUE, MAIL)),
        *((each, "port", 1, 0) for each in (QUEUE, MAIL)),
        (BEAT, "period", DAY, DAY + 0.001),
        (BEAT, "period", 1.0, 0.999),
    ],
)
def test_a_limit_is_taken_and_what_lies_beyond_is_refused(
    settings: Any, key: str, taken: float, refused: float
) -> None:
    replace(settings, **{key: taken})
    with pytest.raises(AlarmError, match=str(refused)):
        replace(settings, **{key: refused})


def test_a_file_that_states_nothing_reminds_daily_and_sends_nowhere() -> None:
    assert AlarmSettings() == AlarmSettings(AlarmLogSettings(KINDS, DAY, 900.0, 60.0, 6, 300.0))
    assert (HOOK.timeout, BEAT.timeout, BEAT.period) == (10.0, 10.0, 300.0)
    assert (QUEUE.port, QUEUE.timeout) == (1883, 10.0)  # of MQTT without TLS
    assert (MAIL.port, MAIL.timeout) == (587, 30.0)  # of submission
