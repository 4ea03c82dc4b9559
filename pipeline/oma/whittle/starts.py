"""Where the fit of a narrow band begins: modes as the lines alone suggest them."""

from dataclasses import dataclass

import numpy as np

from pipeline.oma.whittle.fit import COLOUR, prior_noise, whitened
from pipeline.oma.whittle.narrow_band import NarrowBand
from pipeline.oma.whittle.spectral_model import CloseModes, expected_matrices
from sensors.arrays import ComplexArray, FloatArray


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

    The lines' strongest n_modes directions are whitened; there the matrix of the power's first
    moment Σ (k − k̄) |y_k y_kᴴ| has the directions that differ most in mean frequency.
    Source: Belouchrani et al. (1997), A blind source separation technique using second-order
    statistics, IEEE Trans. Signal Process. 45, whose lagged covariance is here a first moment.
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
