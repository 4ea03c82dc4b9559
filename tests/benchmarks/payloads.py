"""Vendors' payloads by their presets: `python -m tests.benchmarks payloads`.

Each of ten shapes is a stream of known samples; counted: samples that a preset gives at their time
with their value, of those that were sent, and whether sniffing names the preset.
"""

from collections.abc import Sequence

from sensors.feeds.payloads.mapped_reader import MappedReader
from sensors.feeds.payloads.mapping import mapping_named
from sensors.feeds.payloads.sniff import sniffed
from sensors.feeds.protocol import FeedCounts
from tests.benchmarks._results import keep
from tests.sensors.feeds.payloads.shapes import RATE, SAMPLES, SHAPES, Shape, time_ms

NEAR = 1000  # of a time that is written in seconds with decimals [ns]


def right(shape: Shape) -> int:
    """Samples that come with their time and value."""
    reader, found = MappedReader(mapping_named(shape.preset), shape.names, FeedCounts()), 0
    for topic, payload in shape.messages():
        for piece in reader.read(payload, topic):
            for row, values in enumerate(piece.samples.tolist()):
                time_ns = piece.start_ns + row * 1_000_000_000 // RATE
                index = round((time_ns / 1e6 - time_ms(0)) * RATE / 1000)
                for name, value in zip(piece.names, values, strict=True):
                    if name in shape.names and abs(time_ns - time_ms(index) * 1_000_000) < NEAR:
                        found += value == SAMPLES[index, shape.names.index(name)]
    return found


def main(arguments: Sequence[str]) -> None:
    """Count, print a table, write the results."""
    del arguments
    rows = [
        {
            "preset": shape.preset,
            "sent": SAMPLES.size,
            "right": int(right(shape)),
            "sniffed_as": sniffed(shape.messages()).mapping,
        }
        for shape in SHAPES
    ]
    for row in rows:
        print(row)
    keep(
        "payloads",
        {"shapes": rows},
        command="python -m tests.benchmarks payloads",
        depends=["sensors/feeds/payloads"],
    )
