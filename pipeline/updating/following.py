"""Which mode each sighting continues: by frequency and shape, window after window."""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from pipeline.updating.forward_model import FloatArray
from pipeline.updating.mode_evidence import ModeEvidence
from pipeline.updating.sightings import Sighting

FOLLOWING_FREQUENCY_STD = 0.003  # relative scatter of one mode's f between windows [-]
WIDEST_FREQUENCY_STD = 0.01  # however uncertain both are [-]
FOLLOWING_MAC_SCALE = 0.15  # of 1 − MAC between windows [-]
FOLLOWING_REJECTION = 9.0  # three standard deviations: beyond, it is another mode

JUMP = 0.05  # largest relative change of f by which a mode may be the same after a jump [-]
JUMP_MAC = 0.9  # least MAC for that
ESTABLISHED = 3  # windows from which a mode can be missed


def jumped_from(
    modes: Sequence[ModeEvidence], seen: Sequence[Sighting], followed: Sequence[int]
) -> list[int]:
    """For each sighting that continues no mode, the one of which it may be the continuation after
    a jump of frequency, or −1.

    That is the nearest established mode of like shape that this window did not see. The two stay
    apart as evidence, since a mean over both would be neither's frequency, but share a track: on
    it a change is detected.
    """
    missed = [
        number
        for number, mode in enumerate(modes)
        if number not in followed and mode.n_windows >= ESTABLISHED
    ]
    found = [-1] * len(seen)
    waiting = [row for row, number in enumerate(followed) if number < 0]
    if not missed or not waiting:
        return found
    macs = _macs([seen[row] for row in waiting], [modes[number] for number in missed])
    distance = np.abs(
        np.subtract.outer(
            np.log([seen[row].frequency for row in waiting]),
            np.log([modes[number].frequency for number in missed]),
        )
    )
    alike = [
        [seen[row].close_pair == modes[number].close_pair for number in missed] for row in waiting
    ]
    cost = np.where((macs >= JUMP_MAC) & (distance <= JUMP) & alike, distance, 1.0)
    for row, column in zip(*linear_sum_assignment(cost), strict=True):
        if cost[row, column] < 1.0:
            found[waiting[row]] = missed[column]
    return found


def followed_by(modes: Sequence[ModeEvidence], seen: Sequence[Sighting]) -> list[int]:
    """For each sighting the mode it continues, or −1 where it opens a new one.

    Assignment on (Δ ln f / s)² + ((1 − MAC) / .15)², beyond 9 a new mode; s is .3 % and both
    standard deviations together, at most 1 %. Δ is to the mean of all windows or to the last that
    saw the mode, whichever is nearer: a tide moves some modes by 1 % and more. Names given by the
    identification are not asked: a swap of names would mix two modes for good.
    """
    if not modes or not seen:
        return [-1] * len(seen)
    cost = _nearest_squares(seen, modes) / _following_variance(seen, modes)
    cost += ((1 - _macs(seen, modes)) / FOLLOWING_MAC_SCALE) ** 2
    same_kind = np.equal.outer(
        [sighting.close_pair for sighting in seen], [mode.close_pair for mode in modes]
    )
    cost = np.where(same_kind, np.minimum(cost, FOLLOWING_REJECTION), FOLLOWING_REJECTION)
    followed = [-1] * len(seen)
    for row, column in zip(*linear_sum_assignment(cost), strict=True):
        if cost[row, column] < FOLLOWING_REJECTION:
            followed[row] = int(column)
    return followed


def _nearest_squares(seen: Sequence[Sighting], modes: Sequence[ModeEvidence]) -> FloatArray:
    """(n_seen, n_modes) squared distances of ln f."""
    logs = np.log([sighting.frequency for sighting in seen])
    means = np.log([mode.frequency for mode in modes])
    last = np.log([mode.last_frequency for mode in modes])
    return np.minimum((logs[:, None] - means) ** 2, (logs[:, None] - last) ** 2)


def _following_variance(seen: Sequence[Sighting], modes: Sequence[ModeEvidence]) -> FloatArray:
    """(n_seen, n_modes) variance of ln f between two windows of one mode."""
    own = [np.linalg.norm(sighting.factor[0]) / sighting.frequency for sighting in seen]
    known = [mode.frequency_std / mode.frequency for mode in modes]
    variance = np.add.outer(np.square(own), np.square(known)) + FOLLOWING_FREQUENCY_STD**2
    return np.minimum(variance, WIDEST_FREQUENCY_STD**2)


def _macs(seen: Sequence[Sighting], modes: Sequence[ModeEvidence]) -> FloatArray:
    """(n_seen, n_modes) MAC on the channels both have; 1 where there are none."""
    shapes = np.array([sighting.shape for sighting in seen])[:, None]
    known = np.array([mode.shape for mode in modes])[None]
    common = np.isfinite(shapes) & np.isfinite(known)
    shapes, known = np.where(common, shapes, 0.0), np.where(common, known, 0.0)
    products = (shapes * known).sum(axis=2) ** 2
    norms = (shapes**2).sum(axis=2) * (known**2).sum(axis=2)
    macs = np.divide(products, norms, out=np.zeros_like(products), where=norms > 0)
    return np.where(common.any(axis=2), macs, 1.0)
