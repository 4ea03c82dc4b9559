"""The true stiffness of a simulated turbine: published beside the stream, never for updating."""

import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.messages import FoundationTruth, Message
from pipeline.recording.reader import read_messages
from pipeline.recording.writer import Metadata
from pipeline.sources.recorded_stream import SensorMessage, recordings_in
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock

if TYPE_CHECKING:
    from sensors.simulation.tower import SimulatedTower

TRUTH_PERIOD = 600.0  # [s]: how often a truth that changes is published again


def recorded_truths(path: Path) -> Iterator[FoundationTruth]:
    """Return the true stiffness in a recording, in order of time."""
    found = {
        (message.turbine, message.time_ns): message
        for file in recordings_in(path)
        for message in read_messages(file, (FoundationTruth,))
        if isinstance(message, FoundationTruth)
    }
    return iter(sorted(found.values(), key=lambda truth: truth.time_ns))


def simulated_truths(tower: "SimulatedTower") -> Iterator[FoundationTruth]:
    """Yield the true stiffness of a simulated turbine.

    At the beginning, at the instant of each event, and where it has changed in TRUTH_PERIOD.
    """
    before: FoundationTruth | None = None
    settings = tower.settings
    looks = {n * TRUTH_PERIOD for n in range(math.ceil(settings.duration / TRUTH_PERIOD))}
    events = {event.at for event in tower.schedule.foundation.events}
    for since in sorted(looks | {at for at in events if 0 < at < settings.duration}):
        springs = tower.truth_at(since)
        truth = FoundationTruth(
            tower.layout.turbine,
            settings.start_ns + round(since * NANOSECONDS),
            k11=springs.k11,
            k22=springs.k22,
            k12=springs.k12,
        )
        if before is None or _springs(truth) != _springs(before):
            yield truth
            before = truth


def _springs(truth: FoundationTruth) -> tuple[float, float, float]:
    return truth.k11, truth.k22, truth.k12


def later_truths(
    truths: Iterator[FoundationTruth], first: FoundationTruth | None
) -> Iterator[FoundationTruth]:
    """Return the truths without the one that is published already."""
    return (truth for truth in truths if truth != first)


def with_truths(
    messages: Iterable[SensorMessage], truths: Iterator[FoundationTruth]
) -> Iterator[Message]:
    """Yield the truths among the messages, each before the first block that lies behind it."""
    waiting = next(truths, None)
    for message in messages:
        if isinstance(message, AccelerationBlock):
            while waiting is not None and waiting.time_ns < message.end_ns:
                yield waiting
                waiting = next(truths, None)
        yield message


def stored_truth(metadata: Metadata, turbine: str) -> FoundationTruth | None:
    """Return the truth in a recording's metadata; None where it is not known."""
    truth = metadata.get("truth")
    if not truth:
        return None
    return FoundationTruth(
        turbine,
        int(truth["time_ns"]),
        k11=float(truth["k11"]),
        k22=float(truth["k22"]),
        k12=float(truth["k12"]),
    )
