"""The modes of all bands as one list, each mode once."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.messages import Mode
from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.oma.settings import OmaSettings
from pipeline.oma.ssi.bands import Band
from pipeline.oma.ssi.stabilization import unexplained_spread
from sensors.arrays import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class MergedMode:
    """A mode, and whether a second band confirms it."""

    mode: Mode
    alone: bool  # one band reports it in most orders, although another one reaches it
    n_bands: int  # that report it
    steady: bool  # in most orders of a band, or at two rates


def merged(by_band: Sequence[Sequence[Mode]], bands: Sequence[Band]) -> tuple[MergedMode, ...]:
    """The modes of all bands, each once, lowest frequency first.

    Two estimates are one mode when their frequencies agree within three joint std or half a
    percent and their MAC is 0.8 or more. The sharpest stays, whichever band it comes from. What the
    bands differ by, beyond their std, is added to the covariance of the one that stays.

    Preference for slower bands, whose frequency a faster one had to halve the std of, was measured
    against this: of 48 blind windows (seeds 8100 to 8107) the modes that several bands see were
    found as often or more, with rms errors of .190 and .169 % instead of .238 and .230 %, and the
    95 % intervals held as often.
    """
    ranked = sorted(
        (
            (mode.frequency_std, place, mode)
            for place, modes in enumerate(by_band)
            for mode in modes
        ),
        key=lambda entry: entry[:2],
    )
    kept: list[list[Mode]] = []  # the one that stays, then the others of the same mode
    rates: list[set[float]] = []
    for _, place, mode in ranked:
        at = next((i for i, group in enumerate(kept) if _same(mode, group[0])), len(kept))
        if at == len(kept):
            kept.append([])
            rates.append(set())
        kept[at].append(mode)
        rates[at].add(bands[place].sampling_rate)
    joined = [
        MergedMode(
            _with_spread_over_bands(first, others),
            alone=_n_steady([first, *others]) < 2 <= _n_reaching(first, bands),
            n_bands=1 + len(others),
            steady=_n_steady([first, *others]) > 0 or len(at_rates) > 1,
        )
        for (first, *others), at_rates in zip(kept, rates, strict=True)
    ]
    return tuple(sorted(joined, key=lambda each: each.mode.frequency))


def _n_steady(modes: Sequence[Mode]) -> int:
    return sum(mode.presence >= OmaSettings.minimum_presence for mode in modes)


def _n_reaching(mode: Mode, bands: Sequence[Band]) -> int:
    """How many bands report modes of such a frequency."""
    return sum(band.lowest <= mode.frequency <= band.highest for band in bands)


def _with_spread_over_bands(mode: Mode, others: Sequence[Mode]) -> Mode:
    """The mode with one more column of its factor for what the other bands' estimates say."""
    if not others:
        return mode
    weights = np.array([m.frequency_std**-2 for m in (mode, *others)])
    column = np.zeros((len(mode.covariance_factor), 2))
    for row, own in enumerate((mode.frequency, mode.damping_ratio)):
        theirs = [(m.frequency, m.damping_ratio)[row] for m in others]
        deviations = _differences_by_block(mode, others, row)
        column[row, row] = unexplained_spread(
            np.array([0.0, *theirs]) - np.array([0.0] + [own] * len(others)),
            np.vstack([np.zeros_like(deviations[:1]), deviations]),
            weights=weights,
        )
    factor = np.hstack([mode.covariance_factor, column])
    frequency_std, damping_std = np.linalg.norm(factor[:2], axis=1)
    return replace(
        mode,
        covariance_factor=factor,
        frequency_std=float(frequency_std),
        damping_ratio_std=float(damping_std),
    )


def _differences_by_block(mode: Mode, others: Sequence[Mode], row: int) -> FloatArray:
    """Deviations of f (row 0) or ζ (row 1) of other bands' estimates less the mode's own,
    (n_others, n_blocks).

    The bands' blocks cover the same times but for the filters' delay; a slower band may lack the
    last blocks.
    """
    everything = (mode, *others)
    padded = np.zeros((len(everything), max(m.n_block_columns for m in everything)))
    for place, each in enumerate(everything):
        padded[place, : each.n_block_columns] = each.covariance_factor[row, : each.n_block_columns]
    return np.asarray(padded[1:] - padded[0])


def _same(mode: Mode, other: Mode) -> bool:
    joint_std = float(np.hypot(mode.frequency_std, other.frequency_std))
    if abs(mode.frequency - other.frequency) > max(3 * joint_std, 0.005 * other.frequency):
        return False
    mac = modal_assurance_criterion(mode.shape[None], other.shape[None])[0, 0]
    return bool(mac >= 0.8)
