"""A recording as one table."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.offline.measured_file import recorded_channels
from pipeline.recording.writer import Recorder
from tests.pipeline.example_messages import LAYOUT, block


def test_the_samples_of_one_unit_are_those_that_were_recorded(tmp_path: Path) -> None:
    """Nothing is resampled where nothing is joined, though stamps scatter by some ms."""
    recorder = Recorder(tmp_path / "a.mcap", metadata={}, clock=None)
    blocks = [
        replace(block(n), start_ns=block(n).start_ns + 4_000_000 * (n % 2)) for n in range(40)
    ]
    for message in (LAYOUT, *blocks):
        recorder.handle(message)
    recorder.close()
    table = recorded_channels(tmp_path / "a.mcap")
    assert table.names == LAYOUT.channel_names
    np.testing.assert_array_equal(table.samples, np.concatenate([b.samples for b in blocks]))
