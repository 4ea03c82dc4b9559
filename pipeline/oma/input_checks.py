"""Is a window fit to be identified? Pure functions from samples to named findings.

Each finding has a stable code, one sentence with the quantity, and what follows from it:
"reject" (the window is not identified), "mend" (it was corrected, and this says how) or "warn"
(it is identified as it is).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import Warning  # noqa: A004  # the field's word

FloatArray = NDArray[np.float64]
Action = Literal["warn", "mend", "reject"]

DUPLICATE_CORRELATION = 1 - 1e-9  # two real sensors never agree to nine digits
CLIPPED_RUN = 3  # so many equal samples in a row at a channel's extreme are a converter's limit
UNEVEN_STEP = 0.01  # a step this far from the nominal one, relative to it, is uneven
GAP_STEPS = 1.5  # a step longer than this many nominal ones is a gap


@dataclass(frozen=True, slots=True)
class Finding:
    """One doubt about a window's samples."""

    code: str
    text: str
    action: Action

    @property
    def warning(self) -> Warning:
        return Warning(self.code, self.text)


def check_samples(
    samples: NDArray[np.floating], sampling_rate: float, channel_names: Sequence[str]
) -> tuple[Finding, ...]:
    """What the samples alone reveal: NaN, dead, doubled and clipped channels.

    samples   (n, n_channels)
    """
    not_a_number = check_finite(samples, sampling_rate, channel_names)
    if not_a_number:
        return not_a_number
    constant = check_constant(samples, channel_names)
    if constant:
        return constant
    return check_duplicates(samples, channel_names) + check_clipping(samples, channel_names)


def check_finite(
    samples: NDArray[np.floating], sampling_rate: float, channel_names: Sequence[str]
) -> tuple[Finding, ...]:
    """Samples that are no number: rejected, with the first one's place."""
    bad = ~np.isfinite(samples)
    if not bad.any():
        return ()
    row, column = np.argwhere(bad)[0]
    text = (
        f"{int(bad.sum())} of {bad.size} samples are not finite, the first in "
        f"{channel_names[column]} at {row / sampling_rate:.3f} s"
    )
    return (Finding("nan", text, "reject"),)


def check_constant(
    samples: NDArray[np.floating], channel_names: Sequence[str]
) -> tuple[Finding, ...]:
    """Channels that never move: a dead sensor or a broken cable."""
    dead = [
        name for name, span in zip(channel_names, np.ptp(samples, axis=0), strict=True) if not span
    ]
    if not dead:
        return ()
    verb = "is" if len(dead) == 1 else "are"
    return (Finding("constant", f"{', '.join(dead)} {verb} constant over the window", "reject"),)


def check_duplicates(
    samples: NDArray[np.floating], channel_names: Sequence[str]
) -> tuple[Finding, ...]:
    """Channels that carry the same signal, perhaps scaled: one sensor wired twice."""
    if samples.shape[1] < 2:
        return ()
    correlation = np.corrcoef(np.asarray(samples, dtype=np.float64), rowvar=False)
    pairs = np.argwhere(np.triu(np.abs(correlation) > DUPLICATE_CORRELATION, k=1))
    return tuple(
        Finding(
            "duplicate-channel",
            f"{channel_names[i]} and {channel_names[j]} carry the same signal: "
            "shapes hold one sensor twice",
            "warn",
        )
        for i, j in pairs
    )


def check_clipping(
    samples: NDArray[np.floating], channel_names: Sequence[str]
) -> tuple[Finding, ...]:
    """Channels that stay at their extreme value for several samples: the converter's limit."""
    findings = []
    for name, channel in zip(channel_names, samples.T, strict=True):
        at_limit = (channel == channel.max()) | (channel == channel.min())
        in_runs = _samples_in_runs(at_limit, CLIPPED_RUN)
        if in_runs:
            text = (
                f"{name} stays at its largest or smallest value for {in_runs} samples in runs of "
                f"{CLIPPED_RUN} or more: clipped"
            )
            findings.append(Finding("clipped", text, "warn"))
    return tuple(findings)


def _samples_in_runs(flags: NDArray[np.bool_], shortest: int) -> int:
    """How many flagged samples stand in unbroken runs of at least `shortest`."""
    edges = np.diff(np.concatenate([[0], flags.astype(np.int8), [0]]))
    lengths = np.flatnonzero(edges == -1) - np.flatnonzero(edges == 1)
    return int(lengths[lengths >= shortest].sum())


def check_timestamps(times: FloatArray, sampling_rate: float) -> tuple[Finding, ...]:
    """Gaps, an uneven time base, or a rate that the stamps contradict. times: (n,) [s]."""
    steps = np.diff(times) * sampling_rate  # in nominal steps
    if not np.isfinite(steps).all() or (steps <= 0).any():
        at = int(np.argmax(~(steps > 0)))
        text = f"the time stamps do not increase after sample {at} ({times[at]:.6g} s)"
        return (Finding("uneven-clock", text, "reject"),)
    if (steps > GAP_STEPS).any():
        at = int(np.argmax(steps > GAP_STEPS))
        text = (
            f"gap of {steps[at] / sampling_rate:.3g} s at {times[at] - times[0]:.3f} s "
            f"({int((steps > GAP_STEPS).sum())} in all)"
        )
        return (Finding("gap", text, "reject"),)
    return _check_evenness(steps, sampling_rate)


def _check_evenness(steps: FloatArray, sampling_rate: float) -> tuple[Finding, ...]:
    largest = float(np.abs(steps - np.mean(steps)).max())
    if largest <= UNEVEN_STEP:
        return ()
    text = (
        f"the time stamps' steps differ by up to {100 * largest:.2g} % of the nominal "
        f"{1 / sampling_rate:.6g} s: the clock is uneven"
    )
    return (Finding("uneven-clock", text, "warn"),)
