"""Have two channels changed place? A cable plugged in wrongly shows in the shapes alone."""

from itertools import combinations

import numpy as np

from pipeline.messages import ModalEstimate, Mode
from pipeline.modal_assurance import modal_assurance_criterion
from sensors.arrays import FloatArray

SAME_MODE = 0.01  # relative distance of frequencies of one mode in two windows [-]
CLEAR_SHAPE = 0.05  # largest std of a component that can show a swap [-]
FEWEST_SWAPPED_MODES = 3  # whose shapes a swap changes
CHANGED_MAC = 0.05  # of a MAC by the exchange of two channels [-]
BAD, GOOD = 0.9, 0.95  # mean MAC of those modes below which a swap is sought, and with it [-]


class ChannelSwapMonitor:
    """Remembers the shapes of a turbine's last good window.

    reference   that window; None: there was none yet
    """

    def __init__(self, reference: ModalEstimate | None = None) -> None:
        self.reference = reference

    def swap_in(self, estimate: ModalEstimate) -> str | None:
        """Which two channels have changed place since the last good window, in words, or None.

        A pair is named where exchanging it brings the shapes of the modes found again, at their
        frequencies, back to what they were.
        """
        reference = self.reference
        if reference is None or reference.channels != estimate.channels:
            self.reference = estimate
            return None
        now, before = _shapes_of_same_modes(estimate, reference)
        if len(now) < FEWEST_SWAPPED_MODES:
            return None
        as_it_is = _mac(now, before)
        found = []
        for i, j in combinations(range(now.shape[1]), 2):
            exchanged = _mac(_exchanged(now, i, j), before)
            changed = np.abs(exchanged - as_it_is) > CHANGED_MAC
            if changed.sum() >= FEWEST_SWAPPED_MODES:
                gain = float((exchanged - as_it_is).mean())
                before_it, with_it = as_it_is[changed].mean(), exchanged[changed].mean()
                found.append((gain, int(changed.sum()), before_it, with_it, (i, j)))
        _, count, bad, good, pair = max(found, default=(0.0, 0, 1.0, 0.0, (0, 0)))
        if bad > BAD or good < GOOD:
            self.reference = estimate
            return None
        first, second = (estimate.channels[index] for index in pair)
        return (
            f"{first} and {second} have changed place: exchanging them raises the mean MAC of "
            f"{count} modes with the last good window from {bad:.2f} to {good:.2f}"
        )


def _shapes_of_same_modes(
    estimate: ModalEstimate, reference: ModalEstimate
) -> tuple[FloatArray, FloatArray]:
    """Shapes of the modes that both windows see clearly at one frequency, (n, n_channels) each."""
    pairs = []
    clear = list(filter(_is_clear, reference.modes))
    for mode in filter(_is_clear, estimate.modes):
        near = [other for other in clear if abs(mode.frequency / other.frequency - 1.0) < SAME_MODE]
        if len(near) == 1:
            pairs.append((mode.shape, near[0].shape))
    shapes = np.array(pairs).reshape(len(pairs), 2, len(estimate.channels))
    return shapes[:, 0], shapes[:, 1]


def _is_clear(mode: Mode) -> bool:
    return not mode.pair_id and float(mode.shape_std.max()) < CLEAR_SHAPE


def _exchanged(shapes: FloatArray, i: int, j: int) -> FloatArray:
    order = np.arange(shapes.shape[1])
    order[[i, j]] = order[[j, i]]
    return shapes[:, order]


def _mac(ones: FloatArray, others: FloatArray) -> FloatArray:
    """Of each shape with the one in the same row, (n,)."""
    return modal_assurance_criterion(ones[:, None], others[:, None])[:, 0, 0]
