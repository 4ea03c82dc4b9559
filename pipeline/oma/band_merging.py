"""The modes of all bands as one list, each mode once, and what looked like a mode and is not
reported, each with its reason."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from pipeline.messages import Mode, RefusedMode
from pipeline.modal_assurance import mac
from pipeline.oma.settings import OmaSettings
from pipeline.oma.ssi.band_identification import BandIdentification
from pipeline.oma.ssi.bands import Band
from pipeline.oma.ssi.stabilization import unexplained_spread
from sensors.arrays import FloatArray

LONGER_LAGS = 1.5  # of a band that resolves what another one mixes, over the other's [-]
OFF_PLANE = 0.2  # share of a mixture's shape that is not in the plane of its two modes [-]
DIAGRAM_COLUMN = (
    0.005  # poles within so much of each other look like one column of the diagram, relative
)
FEWEST_ORDERS = 0.3  # share of a band's orders from which a column catches the eye [-]
COVERED = 0.01  # a column so near to a mode or a refused one belongs to it, relative
ONE_SHAPE = 0.95  # MAC of two reported modes that may be one [-],
TOO_NEAR_LINES, TOO_NEAR_STDS = 1.5, 2.0  # which are nearer than so many lines 1/T, or std of their
# difference


@dataclass(frozen=True, slots=True, eq=False)
class MergedMode:
    """A mode, and whether a second band confirms it."""

    mode: Mode
    alone: bool
    """One band reports it in most orders, although another one reaches it."""
    n_bands: int
    """That report it."""
    steady: bool
    """In most orders of a band, or at two rates."""
    between: tuple[Mode, ...]
    """The two modes of longer lags that it is a mixture of."""


def merged(by_band: Sequence[Sequence[Mode]], bands: Sequence[Band]) -> tuple[MergedMode, ...]:
    """The modes of all bands, each once, lowest frequency first.

    Parameters
    ----------
    by_band : sequence of sequences of Mode
        Modes of each band.
    bands : sequence of Band
        In the order of `by_band`.

    Returns
    -------
    tuple of MergedMode
        Sorted by frequency.

    Notes
    -----
    Two estimates are one mode when their frequencies agree within three joint std or half a
    percent and their MAC is 0.8 or more. The sharpest of those that most orders of a band agree
    upon stays, whichever band it comes from. What these differ by, beyond their std, is added to
    the covariance of the one that stays.

    Preference for slower bands, whose frequency a faster one had to halve the std of, was measured
    against this: of 48 blind windows (seeds 8100 to 8107) the modes that several bands see were
    found as often or more, with rms errors of .190 and .169 % instead of .238 and .230 %, and the
    95 % intervals held as often.
    """
    ranked = sorted(
        (
            (not _is_steady(mode), mode.frequency_std, place, mode)
            for place, modes in enumerate(by_band)
            for mode in modes
        ),
        key=lambda entry: entry[:3],
    )
    kept: list[list[Mode]] = []  # the one that stays, then the others of the same mode
    seen_in: list[list[Band]] = []
    for _, _, place, mode in ranked:
        at = next((i for i, group in enumerate(kept) if _same(mode, group[0])), len(kept))
        if at == len(kept):
            kept.append([])
            seen_in.append([])
        kept[at].append(mode)
        seen_in[at].append(bands[place])
    seen = [(modes[0], in_bands) for modes, in_bands in zip(kept, seen_in, strict=True)]
    joined = [
        MergedMode(
            _with_spread_over_bands(
                first, [e for e in others if _is_steady(e) or not _is_steady(first)]
            ),
            alone=_n_steady([first, *others]) < 2 <= _n_reaching(first, bands),
            n_bands=1 + len(others),
            steady=_n_steady([first, *others]) > 0
            or len({band.sampling_rate for band in in_bands}) > 1,
            between=_mixture_of(first, in_bands, seen, bands),
        )
        for (first, *others), in_bands in zip(kept, seen_in, strict=True)
    ]
    return tuple(sorted(joined, key=lambda each: each.mode.frequency))


def _mixture_of(
    mode: Mode,
    in_bands: Sequence[Band],
    seen: Sequence[tuple[Mode, Sequence[Band]]],
    bands: Sequence[Band],
) -> tuple[Mode, ...]:
    """The nearest modes to either side, where a mode is their mixture; none where it is not.

    The lags of its bands are too short to resolve the two; bands of longer lags, which reach its
    frequency, know both better and do not report it; its shape lies in their plane.

    in_bands   that report the mode
    seen       every mode with the bands that report it
    """
    longest = max(map(_longest_lag, in_bands))
    better = [
        band
        for band in bands
        if _longest_lag(band) >= LONGER_LAGS * longest
        and band.lowest <= mode.frequency <= band.highest
    ]
    resolved = [
        other
        for other, others_bands in seen
        if any(band in others_bands for band in better)
        and abs(other.frequency - mode.frequency) * longest < 1
        and other.frequency_std < mode.frequency_std
    ]
    below = [other for other in resolved if other.frequency < mode.frequency]
    above = [other for other in resolved if other.frequency > mode.frequency]
    two = min(product(below, above), key=lambda pair: _share_off_plane(mode, pair), default=(mode,))
    return two if len(two) == 2 and _share_off_plane(mode, two) <= OFF_PLANE else ()


def _longest_lag(band: Band) -> float:
    """Of its Hankel matrix [s]."""
    return 2 * band.block_rows / band.sampling_rate


def _share_off_plane(mode: Mode, two: Sequence[Mode]) -> float:
    """Of a shape, what the plane of two others leaves, and the direction that each of them is
    known only vaguely in [-]."""
    directions = [other.shape for other in two]
    for other in two:
        moved, std, _ = np.linalg.svd(other.covariance_factor[2:], full_matrices=False)
        if std[0] > OFF_PLANE:
            directions.append(moved[:, 0])
    plane = np.linalg.qr(np.column_stack(directions))[0]
    off = mode.shape - plane @ (plane.T @ mode.shape)
    return float(np.linalg.norm(off) / np.linalg.norm(mode.shape))


def _is_steady(mode: Mode) -> bool:
    return mode.presence >= OmaSettings.minimum_presence


def _n_steady(modes: Sequence[Mode]) -> int:
    return sum(map(_is_steady, modes))


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
    return mode.with_factor(np.hstack([mode.covariance_factor, column]))


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
    return mac(mode.shape, other.shape) >= 0.8


@dataclass(frozen=True, slots=True, eq=False)
class ToldApart:
    """Modes that a window tells apart, and those that it cannot tell from one of them."""

    modes: tuple[Mode, ...]
    """Lowest frequency first."""
    refused: tuple[RefusedMode, ...]


def told_apart(modes: Sequence[Mode], duration: float) -> ToldApart:
    """The modes, of two of one shape that are too near to be told apart the better known one.

    Its std covers what the other one says. duration: T of the window [s]
    """
    kept: list[Mode] = []
    refused: list[RefusedMode] = []
    for mode in sorted(modes, key=lambda each: each.frequency_std):
        at = next((i for i, other in enumerate(kept) if _too_near(mode, other, duration)), None)
        if at is None:
            kept.append(mode)
            continue
        refused.append(_repeated(mode, kept[at]))
        kept[at] = _covering(kept[at], mode)
    names = [mode.pair_id for mode in kept]
    lone = [
        replace(mode, pair_id="") if mode.pair_id and names.count(mode.pair_id) < 2 else mode
        for mode in kept
    ]
    return ToldApart(tuple(sorted(lone, key=lambda each: each.frequency)), tuple(refused))


def _too_near(mode: Mode, other: Mode, duration: float) -> bool:
    distance = abs(mode.frequency - other.frequency)
    std = float(np.hypot(mode.frequency_std, other.frequency_std))
    if distance > max(TOO_NEAR_LINES / duration, TOO_NEAR_STDS * std):
        return False
    return mac(mode.shape, other.shape) > ONE_SHAPE


def _repeated(mode: Mode, other: Mode) -> RefusedMode:
    return mode.refused(
        "explained",
        f"has the shape of the mode at {other.frequency:.4g} Hz and is too near it to be told "
        "apart from it",
    )


def _covering(mode: Mode, other: Mode) -> Mode:
    """The mode with half its distance from another one added to its std."""
    return mode.with_frequency_spread((other.frequency - mode.frequency) / 2)


def harmonic(mode: Mode) -> RefusedMode:
    """What keeps its amplitude as a machine's harmonic does."""
    return mode.refused(
        "harmonic",
        "keeps its amplitude as a machine's harmonic does, not as a mode under random loads",
    )


def between(mode: Mode, two: Sequence[Mode]) -> RefusedMode:
    """What a band of short lags takes for one mode and one of longer lags resolves as two."""
    below, above = two
    return mode.refused(
        "explained",
        f"explains nothing that the modes at {below.frequency:.4g} and {above.frequency:.4g} Hz do "
        "not, which longer lags resolve",
    )


def unsteady(mode: Mode, least: float) -> RefusedMode:
    """What too few model orders of its only band agree upon."""
    return mode.refused(
        "unstable",
        f"stable in {100 * mode.presence:.0f} % of the model orders of one rate only, "
        f"{100 * least:.0f} % are the least",
    )


def unstable(
    by_band: Sequence[BandIdentification],
    modes: Sequence[Mode],
    refused: Sequence[RefusedMode],
) -> list[RefusedMode]:
    """Columns of poles in the stabilisation diagram that belong to nothing that is named.

    Each once, of the band that has most of its orders there.
    """
    named = [*(mode.frequency for mode in modes), *(each.frequency for each in refused)]
    found = [each for band in by_band for each in _columns(band, np.array(named))]
    kept: list[tuple[float, RefusedMode]] = []
    for presence, each in sorted(found, key=lambda entry: (-entry[0], entry[1].frequency)):
        if all(abs(each.frequency / other.frequency - 1) > COVERED for _, other in kept):
            kept.append((presence, each))
    return sorted((each for _, each in kept), key=lambda each: each.frequency)


def not_listed(
    refused: Sequence[RefusedMode], listed: Sequence[Mode | RefusedMode]
) -> list[RefusedMode]:
    """Those of the refused ones that stand in no column of what is listed, and each place once."""
    found: list[RefusedMode] = []
    for each in refused:
        if not _any_within(DIAGRAM_COLUMN, each, listed) and not _any_within(COVERED, each, found):
            found.append(each)
    return found


def _any_within(apart: float, refused: RefusedMode, others: Sequence[Mode | RefusedMode]) -> bool:
    return any(abs(other.frequency / refused.frequency - 1) <= apart for other in others)


def _columns(band: BandIdentification, named: FloatArray) -> list[tuple[float, RefusedMode]]:
    """Share of the orders, and what stands there."""
    poles = band.poles
    free = np.ones(len(poles), dtype=bool)
    if len(named):
        apart = np.abs(poles.frequencies[:, None] / named[None, :] - 1)
        free = apart.min(axis=1, initial=np.inf) > COVERED
    n_orders = len(band.band.orders)
    found: list[tuple[float, RefusedMode]] = []
    while free.any():
        near = np.abs(poles.frequencies[:, None] / poles.frequencies[None, :] - 1) <= DIAGRAM_COLUMN
        counts = np.where(free, (near & free).sum(axis=1), 0)
        members = near[int(np.argmax(counts))] & free
        free &= ~members
        orders = len(np.unique(poles.orders[members]))
        if orders < FEWEST_ORDERS * n_orders:
            continue
        frequency = float(np.median(poles.frequencies[members]))
        damping = float(np.median(poles.damping_ratios[members]))
        scatter = float(poles.frequencies[members].std() / frequency)
        text = (
            f"poles in {orders} of {n_orders} model orders, scattered by {100 * scatter:.2g} % or "
            "unlike in shape: no mode that most orders agree upon"
        )
        found.append((orders / n_orders, RefusedMode(frequency, damping, "unstable", text)))
    return found
