"""The incremental estimate is the batch estimate."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from pipeline.messages import Mode
from pipeline.oma.identification import identify
from pipeline.oma.preprocessing import decimated
from pipeline.oma.settings import OmaSettings
from pipeline.oma.streaming import StreamingDecimator, StreamingIdentifier, largest_piece
from tests.pipeline.oma.conftest import KnownStructure

RATE = 40.0  # [Hz]


@pytest.fixture(scope="module")
def record(cantilever: KnownStructure) -> np.ndarray:
    """Ten minutes with an offset, as a tilted accelerometer has."""
    y = cantilever.ambient_response(sampling_rate=RATE, duration=600.0, seed=21)
    return y + np.array([0.0, 5.0, -9.81, 0.1, 2.0])


@pytest.mark.parametrize("high_passed", [False, True])
@pytest.mark.parametrize("decimation", [1, 4, 8])
def test_decimation_by_pieces_is_decimation_at_once(decimation: int, high_passed: bool) -> None:
    y = np.random.default_rng(1).standard_normal((5000, 2))
    decimator = StreamingDecimator(decimation, high_passed=high_passed)
    pieces = [decimator.push(piece) for piece in np.array_split(y, [7, 40, 41, 500, 1311, 4000])]
    whole = decimated(y, decimation, high_passed=high_passed)
    np.testing.assert_allclose(np.concatenate(pieces), whole, atol=1e-13)


def is_same(ours: Mode, theirs: Mode) -> bool:
    """To rounding; the std's rests on singular vectors that are near noise."""
    return (
        ours.frequency == pytest.approx(theirs.frequency, rel=1e-8)
        and ours.damping_ratio == pytest.approx(theirs.damping_ratio, rel=1e-8)
        and np.allclose(ours.shape, theirs.shape, rtol=0, atol=1e-8)
        and ours.frequency_std == pytest.approx(theirs.frequency_std, rel=2e-3)
    )


@pytest.mark.parametrize(("hop", "references"), [(30.0, None), (150.0, ("channel 5", "channel 2"))])
def test_a_sliding_window_gives_what_its_own_samples_give(
    record: np.ndarray, hop: float, references: tuple[str, ...] | None
) -> None:
    settings = OmaSettings(
        window_duration=300.0, hop=hop, reference_channels=references, n_blocks=20
    )
    streaming = StreamingIdentifier(RATE, 5, settings)
    assert streaming._rings, "windows share nothing: each would be compared with itself"
    window, step = round(300 * RATE), round(hop * RATE)
    streaming.push(record[:window])
    others: list[tuple[Mode, Mode]] = []
    for k in range(3):
        own = record[k * step : k * step + window]
        if k:
            streaming.push(record[window + (k - 1) * step : window + k * step])
        ours, theirs = streaming.identify(k, own).modes, identify(own, RATE, settings).modes
        assert len(ours) == len(theirs) >= 3
        others += [pair for pair in zip(ours, theirs, strict=True) if not is_same(*pair)]
    # rounding may move which order's pole represents a mode
    assert len(others) <= 1
    for mode, other in others:
        assert abs(mode.frequency - other.frequency) < 0.5 * other.frequency_std


def test_a_hop_of_no_whole_number_of_blocks_is_identified_from_its_samples(
    record: np.ndarray,
) -> None:
    settings = OmaSettings(window_duration=300.0, hop=299.0)
    streaming = StreamingIdentifier(RATE, 5, settings)
    assert not streaming._rings
    streaming.push(record[:12000])
    ours = streaming.identify(0, record[:12000]).modes
    theirs = identify(record[:12000], RATE, settings).modes
    assert [m.frequency for m in ours] == [m.frequency for m in theirs]


def test_windows_that_do_not_overlap_keep_no_covariances(record: np.ndarray) -> None:
    streaming = StreamingIdentifier(RATE, 5, OmaSettings(window_duration=300.0, hop=300.0))
    tracemalloc.start()
    streaming.push(record[:12000])
    held, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert held < 1e4


def test_a_stream_goes_on_without_references_that_it_lacks(record: np.ndarray) -> None:
    window = record[:12000]
    settings = OmaSettings(
        window_duration=300.0,
        hop=150.0,
        reference_channels=("channel 2", "of a silent unit"),
        n_blocks=20,
    )
    streaming = StreamingIdentifier(RATE, 5, settings)
    assert streaming._rings
    streaming.push(window)
    ours = streaming.identify(0, window).modes
    present = replace(settings, reference_channels=("channel 2",))
    theirs = min(identify(window, RATE, present).modes, key=lambda m: abs(m.frequency - 0.32))
    mode = min(ours, key=lambda m: abs(m.frequency - 0.32))
    assert abs(mode.frequency - theirs.frequency) < theirs.frequency_std


@pytest.mark.parametrize(
    ("length", "most", "expected"),
    [(12, 5.0, 4), (12, 4.0, 4), (12, 6.9, 6), (7, 6.0, 1), (9, 0.2, 1)],
)
def test_a_piece_is_the_largest_that_divides_the_whole(length, most, expected) -> None:
    assert largest_piece(length, most) == expected
