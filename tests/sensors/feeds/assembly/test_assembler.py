"""Channels of one unit, put together by the time that their stamps tell."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock, BlockStatus
from sensors.feeds.assembly.assembler import Assembler
from sensors.feeds.assembly.block_builder import SessionNames
from sensors.feeds.protocol import ChannelSamples, FeedCounts
from sensors.files.layout_file import LayoutFile, MappedChannel

RATE = 40.0
START = 1_700_000_000 * NANOSECONDS
X, Y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
LAYOUT = LayoutFile((MappedChannel("ax", 100.0, X), MappedChannel("ay", 100.0, Y)), "t1", "top")


def value(name: str, index: int) -> float:
    """What a channel measures in the sample of that number: told apart from all others."""
    return index + (0.25 if name == "ax" else 0.5)


def piece(
    first: int,
    n: int = 40,
    names: tuple[str, ...] = ("ax", "ay"),
    *,
    at: float | None = None,
    rate: float | None = RATE,
    **said: object,
) -> ChannelSamples:
    """Samples from one number on; stamped `at` another one [samples]."""
    start_ns = START + round((first if at is None else at) / RATE * NANOSECONDS)
    samples = np.array([[value(name, first + i) for name in names] for i in range(n)])
    stream = str(said.pop("stream", ",".join(names)))
    return ChannelSamples(stream, names, samples, start_ns, rate, **said)  # type: ignore[arg-type]


def assembled(
    pieces: Iterable[ChannelSamples], counts: FeedCounts | None = None, **options: float
) -> list[AccelerationBlock]:
    assembler = Assembler(LAYOUT, counts or FeedCounts(), **options)
    blocks = [block for each in pieces for block in assembler.push(each)]
    return blocks + list(assembler.finish())


def joined(blocks: Iterable[AccelerationBlock]) -> dict[int, np.ndarray]:
    """Samples by number since the session's start."""
    return {block.first_sample + i: row for block in blocks for i, row in enumerate(block.samples)}


def expected(first: int, end: int) -> np.ndarray:
    return np.array([[value("ax", i), value("ay", i)] for i in range(first, end)], np.float32)


def test_messages_of_any_length_become_blocks_of_a_second() -> None:
    blocks = assembled(piece(first, 17) for first in range(0, 340, 17))
    assert [len(block.samples) for block in blocks] == [40] * 8 + [20]
    assert [block.sequence for block in blocks] == list(range(9))
    assert [block.first_sample for block in blocks] == list(range(0, 360, 40))
    assert [block.start_ns - START for block in blocks] == [i * NANOSECONDS for i in range(9)]
    assert {block.session for block in blocks} == {"20231114T221320Z"}
    np.testing.assert_array_equal(np.concatenate([b.samples for b in blocks]), expected(0, 340))


def test_channels_that_come_on_topics_of_their_own_are_put_together_by_time() -> None:
    def interleaved() -> Iterator[ChannelSamples]:
        for first in range(0, 400, 40):
            yield piece(first, 40, ("ay",))
            if first >= 40:  # half a second later, in other lengths
                yield piece(first - 40, 20, ("ax",))
                yield piece(first - 20, 20, ("ax",))

    blocks = assembled(interleaved())
    np.testing.assert_array_equal(
        np.concatenate([b.samples for b in blocks])[:360], expected(0, 360)
    )


def test_a_channel_that_begins_earlier_than_the_first_message_loses_nothing() -> None:
    blocks = assembled([piece(40, 40, ("ay",)), piece(0, 120, ("ax",)), piece(80, 40, ("ay",))])
    samples = np.concatenate([block.samples for block in blocks])
    assert len(samples) == 120
    np.testing.assert_array_equal(samples[40:], expected(40, 120))
    np.testing.assert_array_equal(samples[:40, 0], expected(0, 40)[:, 0])
    assert np.isnan(samples[:40, 1]).all()


@settings(max_examples=8)
@given(seed=st.integers(0, 10**6), drift=st.floats(-1e-4, 1e-4))
def test_stamps_that_jitter_by_less_than_half_a_sample_on_a_clock_that_drifts_move_nothing(
    seed: int, drift: float
) -> None:
    jitter = np.random.default_rng(seed).uniform(-0.45, 0.45, 300)
    counts = FeedCounts()
    pieces = [piece(i, 1, at=i * (1 + drift) + each) for i, each in enumerate(jitter)]
    samples = joined(assembled(pieces, counts))
    assert sorted(samples) == list(range(300))
    np.testing.assert_array_equal(np.array([samples[i] for i in range(300)]), expected(0, 300))
    assert (counts.late, counts.duplicate, counts.malformed) == (0, 0, 0)


def test_the_blocks_stamps_follow_a_clock_that_drifts() -> None:
    drift = 100e-6
    blocks = assembled(piece(first, at=first * (1 + drift)) for first in range(0, 40 * 600, 40))
    error = [
        (block.start_ns - START) * 1e-9 - block.first_sample / RATE * (1 + drift)
        for block in blocks
    ]
    assert len(blocks) == 600
    assert max(abs(each) for each in error) < 0.15 / RATE


@pytest.mark.parametrize("step", [16.0, -16.0, 6.0, 3.0])
@pytest.mark.parametrize("length", [40, 1])
def test_a_clock_that_is_set_by_less_than_a_session_is_a_step_of_the_blocks_stamps(
    step: float, length: int
) -> None:
    """Of up to .4 s; it was a ramp of 25 s, and windows' frequencies off by up to 0.1 %."""
    rng = np.random.default_rng(1)

    def pieces() -> Iterator[ChannelSamples]:
        for first in range(0, 40 * 200, length):
            stepped = step if first >= 40 * 100 else 0.0
            at = first + stepped + rng.uniform(-0.3, 0.3)
            yield piece(first, length, at=at, follows=first > 0)

    blocks = assembled(pieces())
    assert {block.session for block in blocks} == {blocks[0].session}
    off = np.array([b.start_ns - START for b in blocks]) / NANOSECONDS * RATE
    off -= [block.first_sample for block in blocks]
    assert abs(off[:100]).max() < 0.5
    assert abs(off[105:] - step).max() < 0.5
    between = off[100:105]
    assert all(min(abs(each), abs(each - step)) < 0.5 for each in between)  # a step is no ramp


@given(st.integers(0, 2**32), st.sampled_from([0.3, 3.0, 12.0]), st.booleans())
@settings(max_examples=20, deadline=None)
def test_stamps_that_scatter_or_are_late_for_a_while_are_no_step(
    seed: int, jitter: float, stalls: bool
) -> None:
    """A link that holds messages back for a second stamps them late where it stamps at all."""
    rng = np.random.default_rng(seed)

    def pieces() -> Iterator[ChannelSamples]:
        for first in range(0, 40 * 300, 40):
            held = 15.0 if stalls and first // 40 % 60 in (50, 51) else 0.0
            yield piece(first, at=first + held + rng.uniform(0, jitter), follows=first > 0)

    off = np.array([block.start_ns - START for block in assembled(pieces())]) / NANOSECONDS * RATE
    off -= 40 * np.arange(300)
    assert abs(np.diff(off[20:])).max() < max(1.0, 0.15 * jitter)


def test_the_rate_of_single_samples_is_found_from_their_stamps() -> None:
    rng = np.random.default_rng(5)
    pieces = [piece(i, 1, at=i + rng.uniform(-0.2, 0.2), rate=None) for i in range(200)]
    blocks = assembled(pieces)
    assert {block.sampling_rate for block in blocks} == {40.0}
    assert sorted(joined(blocks)) == list(range(200))


def test_a_message_that_never_comes_is_a_gap_of_its_length() -> None:
    blocks = assembled(piece(first) for first in range(0, 400, 40) if first != 120)
    assert [block.sequence for block in blocks] == [0, 1, 2, 4, 5, 6, 7, 8, 9]
    assert [block.first_sample for block in blocks] == [0, 40, 80, 160, 200, 240, 280, 320, 360]
    np.testing.assert_array_equal(blocks[3].samples, expected(160, 200))
    assert blocks[3].start_ns == START + 4 * NANOSECONDS


def test_what_one_channel_lacks_is_no_number_and_no_gap() -> None:
    def one_pauses() -> Iterator[ChannelSamples]:
        for first in range(0, 400, 40):
            yield piece(first, 40, ("ax",))
            if not 120 <= first < 200:
                yield piece(first, 40, ("ay",))

    blocks = assembled(one_pauses())
    samples = np.concatenate([block.samples for block in blocks])
    assert [block.sequence for block in blocks] == list(range(10))
    np.testing.assert_array_equal(samples[:, 0], expected(0, 400)[:, 0])
    assert np.isnan(samples[120:200, 1]).all()
    assert not np.isnan(np.delete(samples[:, 1], range(120, 200))).any()


def test_a_channel_that_never_speaks_holds_the_others_up_for_the_wait_only() -> None:
    assembler = Assembler(LAYOUT, FeedCounts(), wait=2.0)
    given_after = [
        len(list(assembler.push(piece(first, 40, ("ax",))))) for first in range(0, 400, 40)
    ]
    assert given_after == [0, 0, 1, 1, 1, 1, 1, 1, 1, 1]


def test_messages_in_disorder_are_put_in_order() -> None:
    order = [0, 1, 3, 2, 4, 6, 5, 7]
    blocks = assembled(piece(40 * i) for i in order)
    np.testing.assert_array_equal(np.concatenate([b.samples for b in blocks]), expected(0, 320))


def test_a_message_that_came_twice_counts_once_and_one_too_late_is_counted() -> None:
    counts = FeedCounts()
    blocks = assembled(
        (piece(40 * i) for i in (0, 1, 2, 2, 3, 4, 5, 6, 0, 7)),
        counts,
    )
    np.testing.assert_array_equal(np.concatenate([b.samples for b in blocks]), expected(0, 320))
    assert counts.duplicate + counts.late == 2


def test_one_wild_stamp_costs_its_own_message_and_nothing_else() -> None:
    counts = FeedCounts()
    wild = [piece(40, at=40 + 40 * 300), piece(120, at=-40 * 86_400)]
    order = [piece(0), wild[0], piece(80), wild[1], piece(160), piece(200)]
    blocks = assembled(order, counts)
    assert [block.first_sample for block in blocks] == [0, 80, 160, 200]
    assert {block.session for block in blocks} == {"20231114T221320Z"}
    assert counts.malformed + counts.late == 2


@pytest.mark.parametrize("wild", [40 * 3600, -40 * 86_400])
def test_samples_behind_a_numbered_message_that_was_dropped_keep_their_places(wild: int) -> None:
    """Their numbers go on; a place that follows from the number would be the dropped one's."""
    counts = FeedCounts()
    first, *others = (piece(10 * n, n=10, follows=n > 0) for n in range(40))
    others[4] = piece(50, n=10, at=50 + wild, follows=True)
    samples = joined(assembled([first, *others], counts))
    missing = set(range(400)) - {i for i, row in samples.items() if not np.isnan(row).any()}
    assert missing == set(range(50, 60))
    assert all(row[0] == value("ax", i) for i, row in samples.items() if i not in missing)
    assert counts.malformed + counts.late == 1


def test_samples_behind_a_numbered_message_of_another_rate_keep_their_places() -> None:
    first, *others = (piece(10 * n, n=10, follows=n > 0) for n in range(40))
    others[4] = piece(50, n=10, rate=2 * RATE, follows=True)
    samples = joined(assembled([first, *others], sampling_rate=RATE))
    assert all(row[0] == value("ax", i) for i, row in samples.items() if not 50 <= i < 60)
    assert {i for i, row in samples.items() if not np.isnan(row).any()} == {
        *range(50),
        *range(60, 400),
    }


def test_a_link_that_was_away_for_a_minute_leaves_a_gap_in_the_same_session() -> None:
    counts = FeedCounts()
    away = [piece(first) for first in [*range(0, 200, 40), *range(2600, 2800, 40)]]
    blocks = assembled(away, counts)
    assert [block.sequence for block in blocks] == [0, 1, 2, 3, 4, 65, 66, 67, 68, 69]
    assert [block.first_sample for block in blocks][5:] == list(range(2600, 2800, 40))
    assert len({block.session for block in blocks}) == 1
    assert counts.malformed == counts.late == 0


def test_two_topics_that_were_away_come_back_together() -> None:
    def both() -> Iterator[ChannelSamples]:
        for first in [*range(0, 200, 40), *range(2600, 2800, 40)]:
            yield piece(first, 40, ("ax",))
            yield piece(first, 40, ("ay",))

    blocks = assembled(both())
    samples = joined(blocks)
    assert sorted(samples) == [*range(200), *range(2600, 2800)]
    assert not any(np.isnan(row).any() for row in samples.values())


@pytest.mark.parametrize("leap", [-30.0, 3600.0])
def test_a_clock_that_is_set_parts_the_stream(leap: float) -> None:
    before = [piece(first) for first in range(0, 200, 40)]
    after = [piece(first, at=first + leap * RATE) for first in range(200, 400, 40)]
    blocks = assembled(before + after)
    assert len(blocks) == 10
    assert len({block.session for block in blocks[:5]}) == 1
    assert {block.sequence for block in blocks[5:]} == set(range(5))
    assert blocks[5].session != blocks[0].session
    assert blocks[5].start_ns == START + round((5 + leap) * NANOSECONDS)


def test_numbers_that_go_on_while_the_clock_leaps_by_a_second_part_the_stream() -> None:
    before = [piece(first, follows=first > 0) for first in range(0, 200, 40)]
    after = [piece(first, at=first + RATE, follows=True) for first in range(200, 400, 40)]
    blocks = assembled(before + after)
    assert [block.sequence for block in blocks] == [0, 1, 2, 3, 4, 0, 1, 2, 3, 4]


def test_numbers_that_go_on_straighten_stamps_that_are_late_by_many_samples() -> None:
    rng = np.random.default_rng(11)
    blocks = assembled(
        piece(40 * i, at=40 * i + rng.uniform(0, 15), follows=i > 0) for i in range(30)
    )
    assert sorted(joined(blocks)) == list(range(1200))


def test_the_layouts_unit_and_sensitivity_turn_samples_into_accelerations() -> None:
    volts = LayoutFile(
        (MappedChannel("ax", 100.0, (2.0, 0.0, 0.0), unit="g", sensitivity=0.1),), "t1", "top"
    )
    assembler = Assembler(volts, FeedCounts())
    blocks = [*assembler.push(piece(0, 40, ("ax",))), *assembler.finish()]
    np.testing.assert_allclose(
        blocks[0].samples[:, 0], expected(0, 40)[:, 0] / 0.1 * 9.80665, rtol=1e-6
    )


def test_a_message_in_another_unit_than_an_acceleration_needs_a_layout_that_says_so() -> None:
    counts = FeedCounts()
    assert assembled([piece(0, unit="mm/s")], counts) == []
    assert "channel 'ax' comes in 'mm/s', which is no acceleration" in counts.refusal
    (block, *_) = assembled([piece(0, unit="g")])
    np.testing.assert_allclose(block.samples, expected(0, 40) * 9.80665, rtol=1e-6)


def test_what_is_no_number_that_a_block_can_hold_is_missing() -> None:
    wild = piece(0)
    wild.samples[[3, 5, 7], 0] = np.inf, 1e39, -np.inf
    (block, *_) = assembled([wild])
    assert list(np.flatnonzero(np.isnan(block.samples[:, 0]))) == [3, 5, 7]
    assert not np.isnan(block.samples[:, 1]).any()


def test_a_message_too_long_to_be_waited_for_is_refused() -> None:
    counts = FeedCounts()
    assembled([piece(0), piece(40, 5000)], counts)
    assert counts.refusal == "ax,ay: a message of 5000 samples; at most 4800"


def test_what_the_instrument_says_of_its_samples_stands_in_their_block() -> None:
    clipped = BlockStatus.CLIPPED
    blocks = assembled(
        piece(first, status=clipped if first == 80 else BlockStatus.OK)
        for first in range(0, 200, 40)
    )
    assert [block.status for block in blocks] == [0, 0, clipped, 0, 0]


def test_channels_that_no_layout_lists_are_left_out_and_named() -> None:
    counts = FeedCounts()
    blocks = assembled([piece(0, names=("ax", "ay", "temp")), piece(40, names=("wind",))], counts)
    assert [block.samples.shape for block in blocks] == [(40, 2)]
    assert set(counts.unknown) == {"temp", "wind"}


def test_a_channel_of_another_rate_is_refused() -> None:
    counts = FeedCounts()
    assembled([piece(0), piece(0, names=("ax",), rate=50.0)], counts)
    assert counts.malformed == 1
    assert "ax is sampled at 50 Hz, the unit at 40 Hz" in counts.refusal


def at_50_hz(second: int) -> ChannelSamples:
    return piece(40 * second, 50, at=40 * second, rate=50.0)


def test_an_instrument_that_is_set_to_another_rate_begins_a_session_at_it(
    caplog: pytest.LogCaptureFixture,
) -> None:
    counts = FeedCounts()
    blocks = assembled(
        [piece(0), piece(40), *(at_50_hz(second) for second in range(2, 20))], counts
    )
    assert [block.sampling_rate for block in blocks] == [40.0] * 2 + [50.0] * 9
    assert len({block.session for block in blocks}) == 2
    assert counts.malformed == 9  # the tenth message in a row is believed
    assert caplog.messages == [
        "'ax,ay' is sampled at 50 Hz from now on, not at 40 Hz: a session begins"
    ]


def test_one_message_of_another_rate_at_the_start_does_not_keep_the_instrument_out() -> None:
    wild = piece(0, 5, ("ax",), rate=1e-3, stream="wild")
    blocks = assembled([wild, *(piece(first) for first in range(0, 800, 40))])
    assert [block.sampling_rate for block in blocks][-11:] == [40.0] * 11


def test_another_instrument_of_another_rate_never_takes_the_unit_over() -> None:
    counts = FeedCounts()
    other = [piece(0, 5, ("ax",), rate=1.0, stream="other") for _ in range(30)]
    blocks = assembled([*(piece(first) for first in range(0, 800, 40)), *other, piece(800)], counts)
    assert {block.sampling_rate for block in blocks} == {40.0}
    assert (len(blocks), counts.malformed) == (21, 30)


@pytest.mark.parametrize("apart", [0, 13, 20, 40_000])
def test_two_instruments_of_one_name_are_never_mixed(apart: int) -> None:
    counts = FeedCounts()
    pieces = []
    for first in range(0, 800, 40):
        other = piece(first + apart, stream="farm/t2", at=first + apart)
        pieces += [piece(first, stream="farm/t1"), replace(other, samples=-other.samples)]
    blocks = assembled(pieces, counts)
    np.testing.assert_array_equal(
        np.concatenate([block.samples for block in blocks]), expected(0, 800)
    )
    assert counts.malformed == 20
    assert counts.refusal == (
        "farm/t2 gives 'ay' while farm/t1 does: a feed is one unit, so its address must name one "
        "of them"
    )


def test_an_instrument_that_has_another_topic_from_now_on_is_followed() -> None:
    counts = FeedCounts()
    before = [piece(first, stream="old") for first in range(0, 400, 40)]
    after = [piece(first, stream="new") for first in range(400, 4000, 40)]
    samples = joined(assembled(before + after, counts))
    assert counts.malformed == 30  # half a minute until it is believed
    assert sorted(samples) == [*range(400), *range(1600, 4000)]
    np.testing.assert_array_equal(samples[3999], expected(3999, 4000)[0])


def test_samples_whose_rate_nobody_tells_are_counted_and_the_option_is_named() -> None:
    counts = FeedCounts()
    assert assembled([piece(i, 1, rate=None) for i in range(20)], counts) == []
    assert counts.refusal == (
        "ax,ay: 20 samples and no rate; 64 of a channel show it, or the option rate= says it"
    )


def test_sessions_of_a_clock_that_is_set_back_again_and_again_have_names_of_their_own() -> None:
    names = SessionNames()
    given = [names.next(START + seconds * NANOSECONDS) for seconds in (0, 5, 0, 5, 5, 9, 0)]
    assert given == [
        "20231114T221320Z",
        "20231114T221325Z",
        "20231114T221320Z-3",
        "20231114T221325Z-4",
        "20231114T221325Z-5",
        "20231114T221329Z",
        "20231114T221320Z-7",
    ]


def test_wild_stamps_that_agree_with_nothing_begin_no_session() -> None:
    """Three on end that leap to one place are a clock that was set; to three places, nothing."""
    day = 86_400 * RATE
    wild = [piece(200 + 40 * k, at=at) for k, at in enumerate((3 * day, -40 * day, 500 * day))]
    counts = FeedCounts()
    blocks = assembled(
        [*map(piece, range(0, 200, 40)), *wild, *map(piece, range(320, 520, 40))], counts
    )
    assert [block.first_sample for block in blocks] == [*range(0, 200, 40), *range(320, 520, 40)]
    assert len({block.session for block in blocks}) == 1
    assert counts.malformed + counts.late == 3
