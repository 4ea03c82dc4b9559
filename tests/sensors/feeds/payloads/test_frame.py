"""A block of samples as bytes: what goes in comes out, and nothing else gets in."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sensors.acquisition.blocks import BlockStatus
from sensors.feeds.payloads.frame import Frame, FrameError, decoded, encoded
from sensors.feeds.payloads.frame_reader import FrameReader
from sensors.feeds.protocol import FeedCounts

KEY = b"of the tower"
SAMPLES = np.arange(12.0).reshape(6, 2)


def frame(sequence: int = 0, **said: object) -> Frame:
    return Frame(sequence, said.pop("session", 1), 10**18, 40.0, SAMPLES, ("ax", "ay"), **said)  # type: ignore[arg-type]


@settings(max_examples=50)
@given(
    n_samples=st.integers(1, 50),
    names=st.lists(st.text("abzäX_-/.", min_size=1), min_size=1, max_size=5, unique=True),
    numbers=st.tuples(*[st.integers(0, 4 * 10**18 - 1)] * 3),
    key=st.binary(max_size=40),
    rate=st.floats(1e-3, 1e6),
)
def test_a_frame_is_read_as_it_was_written(
    n_samples: int, names: list[str], numbers: tuple[int, int, int], key: bytes, rate: float
) -> None:
    samples = np.random.default_rng(1).normal(size=(n_samples, len(names))).astype(np.float32)
    sent = Frame(*numbers, rate, samples.astype(float), tuple(names), BlockStatus.CLIPPED)
    read = decoded(encoded(sent, key), key)
    np.testing.assert_array_equal(read.samples, sent.samples)
    for field in ("sequence", "session", "start_ns", "sampling_rate", "names", "status"):
        assert getattr(read, field) == getattr(sent, field)


@settings(max_examples=200)
@given(payload=st.binary(max_size=200) | st.binary(max_size=100).map(lambda b: b"PWB1" + b))
def test_bytes_that_are_no_frame_are_told_in_one_sentence(payload: bytes) -> None:
    with pytest.raises(FrameError, match=r"^[^\n]+$"):
        decoded(payload)


@pytest.mark.parametrize("cut", [1, 4, 40])
def test_a_frame_that_was_cut_off_is_none(cut: int) -> None:
    with pytest.raises(FrameError, match="its header tells of"):
        decoded(encoded(frame())[:-cut])


@pytest.mark.parametrize("shape", [(0, 2), (6, 0)])
def test_a_frame_without_a_sample_is_refused(shape: tuple[int, int]) -> None:
    empty = Frame(0, 1, 10**18, 40.0, np.zeros(shape), ())
    with pytest.raises(FrameError, match=f"{shape[0]} samples of {shape[1]} channels"):
        decoded(encoded(empty))


def test_no_bit_of_a_signed_frame_can_be_changed() -> None:
    payload = encoded(frame(), KEY)
    for position in range(len(payload)):
        forged = bytearray(payload)
        forged[position] ^= 1
        with pytest.raises(FrameError):
            decoded(bytes(forged), KEY)


def test_a_frame_without_a_signature_is_refused_as_one_and_a_wrong_signature_as_another() -> None:
    with pytest.raises(FrameError, match="without a signature"):
        decoded(encoded(frame()), KEY)
    with pytest.raises(FrameError, match="not of the shared key"):
        decoded(encoded(frame(), b"guessed"), KEY)


def test_a_frame_of_whoever_has_not_the_key_is_counted_as_forged() -> None:
    counts = FeedCounts()
    reader = FrameReader(("ax", "ay"), counts, KEY)
    assert reader.read(encoded(frame()), "") is None
    assert reader.read(encoded(frame(), b"guessed"), "") is None
    assert reader.read(encoded(frame(), KEY), "") is not None
    assert (counts.received, counts.forged, counts.malformed) == (3, 2, 0)


def test_a_signed_frame_that_is_sent_again_is_not_taken_again() -> None:
    counts = FeedCounts()
    reader = FrameReader(("ax", "ay"), counts, KEY)
    recorded = [encoded(frame(number, session=1), KEY) for number in range(3)]
    for payload in recorded:
        assert reader.read(payload, "") is not None
    assert reader.read(encoded(frame(0, session=2), KEY), "") is not None
    assert [reader.read(payload, "") for payload in recorded] == [None] * 3
    assert counts.late == 3


def test_each_frame_that_nothing_takes_in_is_one_lost_message() -> None:
    counts = FeedCounts()
    reader = FrameReader(("ax", "ay"), counts)
    for number in range(3):
        assert reader.read(encoded(frame(number)), "") is not None
        reader.drop()
    assert (counts.received, counts.lost) == (3, 3)


def test_a_frame_without_names_has_all_channels_of_the_layout() -> None:
    counts = FeedCounts()
    reader = FrameReader(("a", "b"), counts)
    read = reader.read(encoded(Frame(0, 1, 10**18, 40.0, SAMPLES)), "")
    assert read is not None
    assert read.names == ("a", "b")
    assert reader.read(encoded(Frame(1, 1, 10**18, 40.0, SAMPLES[:, :1])), "") is None
    assert "1 channels without names; the layout has 2" in counts.refusal


@pytest.mark.parametrize("rate", [0.0, -40.0, 1e-9, 1e12, float("inf"), float("nan")])
def test_a_frame_that_no_instrument_samples_at_is_refused_with_its_rate(rate: float) -> None:
    payload = encoded(Frame(0, 1, 10**18, rate, SAMPLES, ("ax", "ay")))
    with pytest.raises(FrameError, match="sampling_rate is"):
        decoded(payload)
