"""After a gap the windows lie where they would have lain without it."""

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.messages import ModalEstimate, WindowRejected
from pipeline.nodes.identification import IdentificationNode
from pipeline.oma import window_identification
from pipeline.oma.identification import Identification, identify
from pipeline.oma.settings import OmaSettings
from pipeline.oma.windows.block_admission import LimitSettings
from sensors.acquisition.blocks import AccelerationBlock
from sensors.arrays import FloatArray
from tests.pipeline.nodes.test_identification import LAYOUT, RATE, cut
from tests.pipeline.oma.conftest import structure

WINDOW = 64.0  # [s]: 40 time blocks of whole samples in every band, shared by the windows
SETTINGS = OmaSettings(window_duration=WINDOW, hop=WINDOW)
OVERLAPPING = OmaSettings(window_duration=WINDOW, hop=WINDOW / 2)
LENGTH = round(WINDOW * RATE)  # [samples]


@pytest.fixture(scope="module")
def samples() -> FloatArray:
    """Three windows of two channels, as they are sent."""
    known = structure([1.0, 3.0], 0.01, np.array([[1.0, 0.4], [0.4, -1.0]]))
    made = known.ambient_response(sampling_rate=RATE, duration=3 * WINDOW, seed=2)
    return made.astype(np.float32).astype(float)


@pytest.mark.usefixtures("identified_before")  # what lies before a gap is the same in several
@pytest.mark.parametrize(
    ("settings", "lost"),
    [
        *[(SETTINGS, lost) for lost in (range(0), range(5, 7), range(62, 64), range(76, 78))],
        (OVERLAPPING, range(0)),
        (OVERLAPPING, range(76, 78)),  # what is shared begins again with the next hop
    ],
)
def test_a_window_after_a_gap_is_identified_from_its_own_samples_alone(
    samples: FloatArray, settings: OmaSettings, lost: range
) -> None:
    """
    |—— 0 ——|—▒ 1 ——|—— 2 ——|     the last window as if it were all there is
    """
    node = IdentificationNode(settings)
    said = list(node.handle(LAYOUT))
    for block in cut(samples):
        if block.sequence not in lost:
            said += node.handle(block)
    estimate = [each for each in said if isinstance(each, ModalEstimate)][-1]
    assert estimate.window == 2 * WINDOW / settings.hop
    alone = identify(
        samples[2 * LENGTH :], RATE, settings, channel_names=LAYOUT.channel_names
    ).modes
    assert [m.frequency for m in estimate.modes] == pytest.approx(
        [m.frequency for m in alone], rel=1e-6
    )
    for ours, expected in zip(estimate.modes, alone, strict=True):
        assert ours.shape == pytest.approx(expected.shape, abs=1e-5)
        assert ours.frequency_std == pytest.approx(expected.frequency_std, rel=1e-4)


@pytest.mark.usefixtures("identified_before")
def test_a_block_longer_than_its_windows_gives_the_estimates_of_short_ones(
    samples: FloatArray,
) -> None:
    """An hour in one block ended the identification: a window's blocks had gone when it came."""
    long = np.vstack([samples, samples[::-1], 0.9 * samples])
    short = cut(long)
    whole = replace(short[0], samples=long.astype(np.float32))

    def frequencies(blocks: Sequence[AccelerationBlock]) -> list[float]:
        node = IdentificationNode(SETTINGS)
        said = [*node.handle(LAYOUT)]
        said += [answer for block in blocks for answer in node.handle(block)]
        return [m.modes[0].frequency for m in said if isinstance(m, ModalEstimate)]

    assert frequencies([whole])[:8] == pytest.approx(frequencies(short)[:8], rel=1e-9)
    assert len(frequencies([whole])) >= 8


class Cost:
    """A clock on which every reading takes `seconds` more."""

    def __init__(self) -> None:
        self.now = self.seconds = 0.0

    def __call__(self) -> float:
        self.now += self.seconds
        return self.now


@pytest.mark.parametrize("settings", [SETTINGS, OVERLAPPING])
def test_a_turbine_that_costs_too_much_is_rejected_and_the_other_is_as_alone(
    samples: FloatArray, settings: OmaSettings
) -> None:
    clock = Cost()
    node = IdentificationNode(settings, limits=LimitSettings(cpu_seconds=100.0), clock=clock)
    alone = IdentificationNode(settings)
    layouts = (LAYOUT, replace(LAYOUT, turbine="costly"))
    said = [answer for layout in layouts for answer in node.handle(layout)]
    expected = list(alone.handle(LAYOUT))
    n_costly = round(1.5 * WINDOW)  # blocks
    for block in cut(samples):
        clock.seconds = 0.0
        said += node.handle(block)
        expected += alone.handle(block)
        clock.seconds = 20.0 if block.sequence < n_costly else 0.0  # from checkpoint to checkpoint
        said += node.handle(replace(block, turbine="costly"))
    windows = [each for each in said if isinstance(each, ModalEstimate | WindowRejected)]
    costly = [each for each in windows if each.turbine == "costly"]
    assert isinstance(costly[0], WindowRejected)
    assert costly[0].code == "too-much-work"
    assert "more than 100 s of CPU time" in costly[0].reason
    assert isinstance(costly[-1], ModalEstimate)  # the next cheap window is answered
    assert [each.window for each in costly] == list(range(len(costly)))  # each has one answer
    honest = [each for each in windows if each.turbine == LAYOUT.turbine]
    answered = [each for each in expected if isinstance(each, ModalEstimate)]
    assert [[m.frequency for m in each.modes] for each in honest] == [
        [m.frequency for m in each.modes] for each in answered
    ]


def test_a_window_whose_identification_fails_is_rejected_and_the_next_is_identified(
    samples: FloatArray, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """An error ended the node, and did so again at every start with the same window."""
    calls: list[int] = []

    def failing_once(*args: Any, **named: Any) -> Identification:
        calls.append(1)
        if len(calls) == 1:
            raise KeyError("a fault")
        return identify(*args, **named)

    monkeypatch.setattr(window_identification, "identify", failing_once)
    node = IdentificationNode(SETTINGS)
    said = [*node.handle(LAYOUT), *(each for block in cut(samples) for each in node.handle(block))]
    first, *others = [each for each in said if isinstance(each, ModalEstimate | WindowRejected)]
    assert isinstance(first, WindowRejected)
    assert first.code == "failed"
    assert "KeyError('a fault')" in first.reason
    assert "KeyError" in caplog.text  # with its traceback
    assert others
    assert all(isinstance(each, ModalEstimate) for each in others)


def test_the_limit_ends_what_takes_real_time(samples: FloatArray) -> None:
    limits = LimitSettings(cpu_seconds=0.005)
    node = IdentificationNode(SETTINGS, limits=limits, clock=time.thread_time)
    said = list(node.handle(LAYOUT))
    for block in cut(samples):
        said += node.handle(block)
    codes = {each.code for each in said if isinstance(each, WindowRejected)}
    assert codes == {"too-much-work"}
    assert not any(isinstance(each, ModalEstimate) for each in said)
