"""Live instruments by `pilewatch feed` as a process, in short; the long form, with links that are
cut, is `python -m tests.benchmarks feeds`."""

from pathlib import Path

import pytest

from tests.benchmarks._feed_kills import killed_feed
from tests.benchmarks._feed_trials import mqtt_load, udp_drops
from tests.sensors.feeds.broker import mosquitto


@pytest.mark.skipif(mosquitto() is None, reason="mosquitto is not installed")
def test_five_hundred_frames_a_second_arrive_whole(tmp_path: Path) -> None:
    outcome = mqtt_load(tmp_path, per_second=500, seconds=2)
    assert outcome.received == outcome.sent == 1000
    assert outcome.samples_heard == outcome.samples_sent == 2000
    assert (outcome.told_lost, outcome.samples_wrong, outcome.gaps) == (0, 0, 0)
    assert outcome.exit_code == 0


def test_datagrams_that_never_come_are_counted_exactly(tmp_path: Path) -> None:
    outcome = udp_drops(tmp_path, per_second=500, seconds=2, share=0.05)
    assert outcome.told_lost > 0
    assert outcome.received == outcome.sent
    assert outcome.sent + outcome.told_lost == 1000
    assert (outcome.samples_wrong, outcome.exit_code) == (0, 0)


@pytest.mark.skipif(mosquitto() is None, reason="mosquitto is not installed")
def test_a_feed_that_is_killed_while_it_catches_up_loses_nothing_and_publishes_nothing_twice(
    tmp_path: Path,
) -> None:
    outcome = killed_feed(tmp_path, kills=2, seconds=1000.0)
    assert outcome.while_catching_up > 0
    assert (outcome.lost, outcome.twice, outcome.wrong) == (0, 0, 0)
