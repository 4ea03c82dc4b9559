"""Windows end after they begin, whatever a unit's clock does.

samples   |0 ——— window 0 ——— |24 000 ——— window 1 ——— |48 000
clock      T                                           T + 26 s
"""

from dataclasses import replace

from pipeline.oma.windows.windowing import BlockOrder, MissingSamples, WindowCutter
from sensors.acquisition.blocks import NANOSECONDS
from tests.pipeline.example_messages import SAMPLING_RATE, START_NS, block


def test_no_window_ends_before_it_began_where_the_clock_was_set_back() -> None:
    first = block(0)
    later_ns = START_NS + 26 * NANOSECONDS
    later = replace(block(1), first_sample=round(1200 * SAMPLING_RATE), start_ns=later_ns)
    between = later.first_sample - len(first.samples)
    gap = MissingSamples(len(first.samples), between, 1, 0, first.end_ns, later_ns)
    cutter = WindowCutter(window_duration=600.0, hop=600.0)
    windows = [window for piece in (first, gap, later) for window in cutter.push(piece)]
    windows += cutter.finish()
    assert [window.index for window in windows] == [0, 1, 2]
    assert all(window.start_ns <= window.end_ns for window in windows)
    assert [window.end_ns - window.start_ns for window in windows[:2]] == [600 * NANOSECONDS] * 2


def test_a_block_that_is_late_by_less_than_the_lateness_is_waited_for() -> None:
    order = BlockOrder(lateness=5.0)
    given = [each for number in (0, 2, 3, 1, 4) for each in order.push(block(number))]
    assert [each.first_sample for each in given] == [40 * number for number in range(5)]
    assert not any(isinstance(each, MissingSamples) for each in given)
    assert order.late == 0


def test_a_gap_has_as_many_blocks_as_are_missing() -> None:
    order = BlockOrder(lateness=5.0)
    given = [each for number in (0, 4, *range(5, 12)) for each in order.push(block(number))]
    (gap,) = (each for each in given if isinstance(each, MissingSamples))
    assert (gap.first_sequence, gap.n_blocks, gap.n_samples) == (1, 3, 120)
