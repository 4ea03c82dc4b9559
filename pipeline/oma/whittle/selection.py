"""How many modes a narrow band holds: one more at a time, as long as the evidence rises.

Each fit begins with modes as the lines alone suggest them: the strongest place, what a fit leaves
unexplained, or what distinguishes several modes in the plane that they share.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.oma.whittle.fit import (
    COLOUR,
    WhittleFit,
    cost_of_background,
    every_parameter,
    prior_noise,
    whitened,
)
from pipeline.oma.whittle.fit import fitted as fitted_along
from pipeline.oma.whittle.narrow_band import NarrowBand
from pipeline.oma.whittle.spectral_model import CloseModes, expected_matrices
from sensors.arrays import ComplexArray, FloatArray

NEEDED_EVIDENCE = 3.0  # that a further mode must bring, ln of the Bayes factor [nats]

WORTH_A_TRY = 10.0  # rise of ln p that whitened lines promise before a mode more is fitted [nats]


FEWEST_BAND_LINES = 12  # of a band: fewer say nothing of a background
NEIGHBOUR_WIDTHS = 3.0  # half bandwidths that a band ends short of a neighbour,
NEIGHBOUR_LINES = 2.0  # and lines more


@dataclass(frozen=True, slots=True, eq=False)
class BandFit:
    """The modes that the evidence supports, and the band that they were fitted to."""

    fit: WhittleFit
    band: NarrowBand


@dataclass(frozen=True, slots=True)
class Needed:
    """The part of a band that may not be cut off."""

    low: float
    """Position [lines]."""
    high: float
    """Position [lines]."""

    def holds(self, position: float) -> bool:
        """Return whether a position [lines] lies in it."""
        return self.low <= position <= self.high


def best_fit(
    band: NarrowBand, needed: Needed, *, most_modes: int, half_width: float, one_colour: bool
) -> BandFit | None:
    """The fit of one mode, of two and so on, until a further one brings no evidence.

    Parameters
    ----------
    band : NarrowBand
        Lines to fit.
    needed : Needed
        The part of the band whose modes are asked for.
    most_modes : int
        Of a fit.
    half_width : float
        b = ζ f T to begin with [lines].
    one_colour : bool
        Of all modes of the band.

    Returns
    -------
    BandFit or None
        None where a flat background explains the lines as well.

    Notes
    -----
    What stands out beside the part that is needed shortens the band: that costs less than a mode
    more.
    """
    n_channels = len(band.scales)

    def fitted(start: CloseModes, band: NarrowBand) -> WhittleFit:
        along = every_parameter(start.n_modes, n_channels, one_colour=one_colour)
        return fitted_along(start, band, along)

    best = fitted(strongest(band, half_width), band)
    while not needed.holds(float(best.modes.positions[0])):
        shorter = _short_of(best.modes.positions[0], band, needed, half_width)
        if shorter is None:
            break
        band = shorter
        best = fitted(strongest(band, half_width), band)
    if best.bayes_cost(band.n_lines) > cost_of_background(band) - NEEDED_EVIDENCE:
        return None
    while True:
        place = left_unexplained(best.modes, band, half_width)[0]
        if place.gain < WORTH_A_TRY:
            break
        shorter = _short_of(float(band.numbers[place.index]), band, needed, half_width)
        if shorter is not None:
            band = shorter
            best = fitted(best.modes, band)
            continue
        if best.modes.n_modes >= min(most_modes, n_channels):
            break
        least = best.bayes_cost(band.n_lines) - NEEDED_EVIDENCE
        apart = told_apart_by_place(band, best.modes.n_modes + 1, half_width, best.modes.noise)
        further = fitted(apart, band) if apart is not None else best
        if further.bayes_cost(band.n_lines) > least:
            further = fitted(with_another(best.modes, band, half_width, place), band)
        if further.bayes_cost(band.n_lines) > least:
            break
        best = further
    return BandFit(best, band)


def _short_of(
    position: float, band: NarrowBand, needed: Needed, half_width: float
) -> NarrowBand | None:
    """The band as far as a neighbour leaves it alone; None where that cuts off nothing, or leaves
    too few lines: of what is needed a rotor's harmonics may have taken them.

    position   of the neighbour [lines]
    """
    if needed.holds(position):
        return None
    clear = NEIGHBOUR_WIDTHS * half_width + NEIGHBOUR_LINES
    if position < needed.low:
        chosen = band.numbers >= min(position + clear, needed.low)
    else:
        chosen = band.numbers <= max(position - clear, needed.high)
    return None if chosen.all() or chosen.sum() < FEWEST_BAND_LINES else band.only(chosen)


def strongest(band: NarrowBand, half_width: float) -> CloseModes:
    """One mode at the strongest place. half_width: b = ζ f T [lines]."""
    noise = 10 * prior_noise(band)
    root = np.sqrt(noise)
    (place,) = _places(band.matrices / np.outer(root, root), _reach(band, half_width))[:1]
    empty = CloseModes(
        np.empty(0),
        np.empty(0),
        np.empty((len(noise), 0)),
        np.empty((0, 0), complex),
        np.empty(0),
        np.diag(noise),
    )
    return _with_mode(empty, band, place.index, place.direction * root, half_width)


@dataclass(frozen=True, slots=True, eq=False)
class SpectralPlace:
    """Where something is left to explain."""

    index: int
    """Of the bin."""
    direction: FloatArray
    """(n_channels,), of unit length, in whitened channels."""
    gain: float
    """Rise of ln p if the power in this direction were fitted there [nats]."""


def left_unexplained(modes: CloseModes, band: NarrowBand, half_width: float) -> list[SpectralPlace]:
    """Where a fit leaves most unexplained, strongest first."""
    places = _places(whitened(modes, band), _reach(band, half_width))
    return sorted(places, key=lambda place: -place.gain)


def with_another(
    modes: CloseModes, band: NarrowBand, half_width: float, place: SpectralPlace
) -> CloseModes:
    """The modes and one more, where something is left unexplained."""
    numbers = band.numbers[place.index : place.index + 1]
    lower = np.linalg.cholesky(expected_matrices(modes, numbers))[0]
    return _with_mode(modes, band, place.index, (lower @ place.direction).real, half_width)


def told_apart_by_place(
    band: NarrowBand, n_modes: int, half_width: float, noise: FloatArray
) -> CloseModes | None:
    """Modes by what distinguishes them in a common subspace: the mean frequency of their power.

    Parameters
    ----------
    band : NarrowBand
        Lines to fit.
    n_modes : int
        How many modes are looked for.
    half_width : float
        b = ζ f T of each [lines].
    noise : ndarray, shape (n_channels, n_channels)
        N, the flat background to begin with.

    Returns
    -------
    CloseModes or None
        None where the lines have fewer than n_modes directions.

    Notes
    -----
    The lines' strongest n_modes directions are whitened; there the matrix of the power's first
    moment Σ (k − k̄) |y_k y_kᴴ| has the directions that differ most in mean frequency.

    References
    ----------
    Belouchrani et al. (1997), A blind source separation technique using second-order statistics,
    IEEE Trans. Signal Process. 45, whose lagged covariance is here a first moment.
    """
    values, vectors = np.linalg.eigh(band.matrices.sum(axis=0).real)
    if values[-n_modes] <= 1e-12 * values[-1]:
        return None
    basis = vectors[:, -n_modes:] * np.sqrt(values[-n_modes:])
    into = np.linalg.pinv(basis)
    inside = into @ band.matrices @ into.T
    numbers = np.arange(len(inside)) - (len(inside) - 1) / 2
    _, turn = np.linalg.eigh(np.einsum("k,kij->ij", numbers, inside).real)
    powers = np.einsum("ij,kil,lj->kj", turn, inside, turn).real
    shapes = basis @ turn
    modes = CloseModes(
        np.empty(0),
        np.empty(0),
        np.empty((len(basis), 0)),
        np.empty((0, 0), complex),
        np.empty(0),
        noise,
    )
    window = np.ones(2 * _reach(band, half_width) + 1)
    for power, shape in zip(powers.T, shapes.T, strict=True):
        at = int(np.argmax(np.convolve(power, window, mode="same")))
        modes = _with_mode(modes, band, at, shape, half_width)
    return modes


def _reach(band: NarrowBand, half_width: float) -> int:
    """Bins to either side that a mode fills."""
    return max(1, round(half_width / float(np.median(band.n_together))))


def _places(white: ComplexArray, reach: int) -> list[SpectralPlace]:
    """Where whitened matrices have most power in one real direction, strongest first, apart from
    each other by what a mode fills.

    Of n lines with power s in a direction where 1 is expected, n (s − 1 − ln s) is the gain.
    """
    real = np.concatenate([np.zeros((1, *white.shape[1:])), np.cumsum(white.real, axis=0)])
    centres = np.arange(len(white))
    low, high = np.maximum(0, centres - reach), np.minimum(len(white), centres + reach + 1)
    values, vectors = np.linalg.eigh(real[high] - real[low])
    count = high - low
    power = values[:, -1] / count
    gain = np.where(power > 1, count * (power - 1 - np.log(np.maximum(power, 1))), 0.0)
    chosen: list[SpectralPlace] = []
    for centre in np.argsort(-(power - 1) * count, kind="stable").tolist():
        if all(abs(centre - other.index) > 2 * reach for other in chosen):
            chosen.append(SpectralPlace(centre, vectors[centre, :, -1], float(gain[centre])))
    return chosen


def _with_mode(
    modes: CloseModes, band: NarrowBand, place: int, direction: FloatArray, half_width: float
) -> CloseModes:
    """One mode more, of the power that the lines there have along its shape.

    place   index of the bin
    """
    shape = direction / direction[np.argmax(np.abs(direction))]
    reach = _reach(band, half_width)
    part = band.matrices[max(0, place - reach) : place + reach + 1].mean(axis=0)
    power = float((shape @ part @ shape).real) / float(shape @ shape) ** 2
    m = modes.n_modes
    forces = np.zeros((m + 1, m + 1), dtype=complex)
    forces[:m, :m] = modes.forces
    forces[m, m] = np.sqrt(power) * 2 * np.pi * half_width
    return CloseModes(
        np.append(modes.positions, band.numbers[place]),
        np.append(modes.half_widths, half_width),
        np.column_stack([modes.shapes, shape]),
        forces,
        np.append(modes.colours, COLOUR),
        modes.noise,
    )
