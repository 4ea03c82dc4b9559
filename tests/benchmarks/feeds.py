"""Live instruments: `python -m tests.benchmarks feeds [--part NAME] [--seconds S]`.

mqtt       500 frames a second, eight topics, through mosquitto: what arrives, what it costs;
           also with the journal of a feed that remembers
cut        the broker killed for five seconds and back, with a sender that keeps what it cannot send
           (QoS 1) and one that does not (0); then a broker that is restarted and keeps what it has
           for a feed with a name
kill       twenty kills while the feed catches up, every other one while it receives what the broker
           has kept; with and without numbers in the messages, with and without a spool
udp        one datagram in a hundred never comes: counted exactly?
seedlink   a data logger whose link is cut three times: gone on with where it was cut

Each by `pilewatch feed` as a process of its own, heard over Zenoh; every sample is compared with
the one that was sent.
"""

import argparse
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

from tests.benchmarks._feed_kills import KillOutcome, killed_feed
from tests.benchmarks._feed_trials import (
    CHANNELS,
    FeedOutcome,
    mqtt_cut,
    mqtt_load,
    seedlink_cut,
    udp_drops,
)
from tests.sensors.feeds.broker import mosquitto

PARTS = ("mqtt", "cut", "kill", "udp", "seedlink")


def main(arguments: Sequence[str]) -> None:
    """Run the parts that are asked for and print a table."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks feeds")
    parser.add_argument("--part", choices=PARTS)
    parser.add_argument("--seconds", type=float, default=60.0, help="of measurements, each part")
    chosen = parser.parse_args(arguments)
    print(
        f"{'part':28}{'sent':>8}{'received':>9}{'lost':>6}{'late':>6}{'twice':>6}"
        f"{'samples':>9}{'heard':>8}{'wrong':>6}{'gaps':>5}{'cut':>4}{'CPU s':>7}{'exit':>5}"
    )
    for part in PARTS if chosen.part is None else (chosen.part,):
        for name, run in trials(part, chosen.seconds):
            with tempfile.TemporaryDirectory() as folder:
                print(row(name, run(Path(folder))), flush=True)
    print(f"samples: of each of {CHANNELS} channels (SeedLink: 2); heard: with every channel")


def trials(
    part: str, seconds: float
) -> Iterator[tuple[str, Callable[[Path], FeedOutcome | KillOutcome]]]:
    """Names and trials of one part."""
    if part in ("mqtt", "cut", "kill") and mosquitto() is None:
        print(f"{part}: mosquitto is not installed")
        return
    match part:
        case "mqtt":
            yield (
                "MQTT, 500 frames/s, QoS 1",
                lambda folder: mqtt_load(folder, per_second=500, seconds=seconds),
            )
            yield (
                "…, with its journal",
                lambda folder: mqtt_load(folder, per_second=500, seconds=seconds, remembers=True),
            )
            yield (
                "MQTT, 500 frames/s, QoS 0",
                lambda folder: mqtt_load(folder, per_second=500, seconds=seconds, qos=0),
            )
        case "cut":
            yield (
                "broker away 5 s, QoS 1",
                lambda folder: mqtt_cut(folder, per_second=500, seconds=30, away=5, qos=1),
            )
            yield (
                "broker away 5 s, QoS 0",
                lambda folder: mqtt_cut(folder, per_second=500, seconds=30, away=5, qos=0),
            )
            yield (
                "restarted, QoS 1, client=",
                lambda folder: mqtt_cut(
                    folder, per_second=500, seconds=30, away=5, qos=1, client="tower-1"
                ),
            )
        case "kill":
            for name, spooled, numbered in (
                ("killed", True, True),
                ("killed, without numbers", True, False),
                ("killed, without a spool", False, True),
            ):
                yield (
                    name,
                    partial(
                        killed_feed,
                        kills=20,
                        seconds=60 * seconds,
                        spooled=spooled,
                        numbered=numbered,
                    ),
                )
        case "udp":
            yield (
                "UDP, 1 % dropped",
                lambda folder: udp_drops(folder, per_second=500, seconds=seconds, share=0.01),
            )
        case "seedlink":
            yield (
                "SeedLink, cut three times",
                lambda folder: seedlink_cut(folder, seconds=10 * seconds, cuts=3),
            )


def row(name: str, outcome: FeedOutcome | KillOutcome) -> str:
    """One line of the table."""
    if isinstance(outcome, KillOutcome):
        return (
            f"{name:28}{outcome.kills} kills, {outcome.while_catching_up} of them while catching "
            f"up: {outcome.sent} samples, {outcome.lost} lost, {outcome.twice} twice, "
            f"{outcome.wrong} wrong"
        )
    return (
        f"{name:28}{outcome.sent:8}{outcome.received:9}{outcome.told_lost:6}{outcome.late:6}"
        f"{outcome.duplicate:6}{outcome.samples_sent:9}{outcome.samples_heard:8}"
        f"{outcome.samples_wrong:6}{outcome.gaps:5}{outcome.connections_lost:4}"
        f"{outcome.cpu:7.1f}{outcome.exit_code:5}"
    )
