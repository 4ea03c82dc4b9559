"""Errors of the paired modes at one point of a model, and how they depend on its coordinates."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.likelihood.likelihood import LikelihoodSettings, ModeComparison
from pipeline.updating.likelihood.pairing import Pairing
from sensors.arrays import FloatArray, IndexArray
from sensors.dynamics.figure_modes import Linearisation

STUDENT_DEGREES = 4.0  # ν of Student's t, of each mode's frequency and each shape
ARRAYS_REMEMBERED = 8  # of evidences: a fit compares one or two, hundreds of times


class SharesOut(Protocol):
    """Shares of neighbours in the errors, to be taken out beside any discrepancy."""

    def taken_out(self, sigma: float) -> tuple["ModeErrors", float]:
        """The errors less the likeliest shares, and by how much shares raise ln |D(σ)|."""


@dataclass(frozen=True, slots=True, eq=False)
class ModeErrors:
    """The paired modes at one point: errors, their variances, and how they depend on u.

    First the rows of all frequencies, those of the shapes, then shares of neighbours (`mixtures`).
    """

    pairing: Pairing
    used: tuple[ModeComparison, ...]
    errors: FloatArray
    """η, (p,) model minus identified: ln f and components of φ [-]"""
    variances: FloatArray
    """(p,) of the combined windows: S"""
    floors: FloatArray
    """(p,) systematic: F"""
    reference: FloatArray
    """(p,) diagonal of R, which σ² multiplies: 1 for ln f, ‖φ̄‖² for shapes"""
    jacobian: FloatArray
    """∂η/∂u, (p, n_dim)"""
    groups: IndexArray
    """(p,) number of the observation of each component"""
    is_frequency: NDArray[np.bool_]
    """(p,)"""
    tracks: IndexArray
    """(p,) of the identified mode"""
    rows: IndexArray
    """(p,) 0 for f, 1 + channel for a component of φ, negative for a neighbour's share"""
    units: IndexArray
    """(p,) channel whose component is 1 in the shape; 0 for f"""
    damping_ratios: FloatArray
    """ζ of each identified mode that is compared, (n,), NaN where unknown [-]"""
    linearisation: Linearisation
    shares: "SharesOut | None" = None
    """Of neighbours that were taken out of the errors; None for none"""

    @property
    def unlike_shapes(self) -> int:
        """Of modes alone at their frequency whose partner's shape is another one: not compared."""
        return sum(each.shape_unlike for each in self.used)

    @property
    def unlike_share(self) -> float:
        """Of the shapes that could be compared [-]"""
        n = self.unlike_shapes
        return n / max(n + sum(each.shape_used for each in self.used), 1)

    def at_discrepancy(self, sigma: float) -> tuple["ModeErrors", float]:
        """The errors with the shares of neighbours that are likeliest beside a discrepancy σ, and
        by how much they raise ln |D(σ)|: where modes err by more, shapes tell less of a share."""
        return (self, 0.0) if self.shares is None else self.shares.taken_out(sigma)

    def squares(self, variances: FloatArray) -> tuple[FloatArray, IndexArray, FloatArray]:
        """χ² of each frequency and each shape, (g,), which of them every component belongs to,
        (p,), and how many components each has, (g,)."""
        members = 2 * self.groups + ~self.is_frequency
        _, members = np.unique(members, return_inverse=True)
        squares = np.bincount(members, self.errors**2 / variances)
        return np.asarray(squares, dtype=float), members, np.bincount(members).astype(float)

    @property
    def keys(self) -> tuple[tuple[int, int, int], ...]:
        """(p,) track of the identified mode, row of (f, φ) and unit component of each."""
        return tuple(
            zip(self.tracks.tolist(), self.rows.tolist(), self.units.tolist(), strict=True)
        )

    def robust_weights(self, variances: FloatArray) -> FloatArray:
        """(p,) (ν + n) / (ν + χ²) of Student's t: what the identification got wrong by ten
        standard deviations must not drag the stiffness by many of its own."""
        squares, members, counts = self.squares(variances)
        return student_weights(squares, counts)[members]


def student_weights(squares: FloatArray, counts: NDArray[Any]) -> FloatArray:
    """(g,) (ν + n) / (ν + χ²) of Student's t, at most 1.

    Parameters
    ----------
    squares : ndarray, shape (g,)
        χ² of each group of components [-].
    counts : ndarray, shape (g,)
        n of its components.
    """
    return np.minimum((STUDENT_DEGREES + counts) / (STUDENT_DEGREES + squares), 1.0)


def mode_errors(
    evidence: ModalEvidence,
    pairing: Pairing,
    used: tuple[ModeComparison, ...],
    modes: Linearisation,
    settings: LikelihoodSettings,
) -> ModeErrors:
    """Compare the paired modes.

    Parameters
    ----------
    evidence : ModalEvidence
        With the identified modes.
    pairing : Pairing
        Of these with modes of the model.
    used : tuple of ModeComparison
        What of each paired mode is compared.
    modes : Linearisation
        Of the model at one point, with derivatives by its coordinates u.
    settings : LikelihoodSettings
        With the floors of the errors.
    """
    measured = _measured(evidence)
    frequencies = _frequency_rows(measured, used, modes, settings)
    shapes = _shape_rows(measured, used, modes, settings)
    columns = (np.concatenate(each) for each in zip(frequencies, shapes, strict=True))
    errors, variances, floors, reference, jacobian, groups, tracks, rows, units = columns
    return ModeErrors(
        pairing=pairing,
        used=used,
        errors=errors,
        variances=variances,
        floors=floors,
        reference=reference,
        jacobian=jacobian,
        groups=groups,
        is_frequency=rows == 0,
        tracks=tracks,
        rows=rows,
        units=units,
        damping_ratios=np.array([evidence.modes[each.identified].damping_ratio for each in used]),
        linearisation=modes,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Measured:
    """The identified modes as arrays, one row a mode."""

    frequencies: FloatArray
    """(n,) [Hz]"""
    log_variances: FloatArray
    """(n,) of ln f [-]"""
    shapes: FloatArray
    """(n, n_channels) [-], NaN where unknown"""
    shape_variances: FloatArray
    """(n, n_channels) [-]"""
    known: NDArray[np.bool_]
    """(n, n_channels) components about which there is information"""
    units: IndexArray
    """(n,) channel whose component is 1"""
    tracks: IndexArray
    """(n,)"""


@lru_cache(maxsize=ARRAYS_REMEMBERED)
def _measured(evidence: ModalEvidence) -> _Measured:
    means = np.array([mode.mean for mode in evidence.modes])
    variances = np.array([np.diag(mode.covariance) for mode in evidence.modes])
    return _Measured(
        frequencies=means[:, 0],
        log_variances=variances[:, 0] / means[:, 0] ** 2,
        shapes=means[:, 1:],
        shape_variances=variances[:, 1:],
        known=np.array([mode.known[1:] for mode in evidence.modes]),
        units=np.array([mode.unit_component for mode in evidence.modes]),
        tracks=np.array([mode.track for mode in evidence.modes]),
    )


def _frequency_rows(
    measured: _Measured,
    used: Sequence[ModeComparison],
    modes: Linearisation,
    settings: LikelihoodSettings,
) -> tuple[NDArray[Any], ...]:
    """Every used mode's ln f beside the model's; of two model modes their mean.

    Returns errors, variances, floors, reference, Jacobian, groups, tracks, rows and units.
    """
    places = np.array([each.identified for each in used])
    pairs = np.array([(each.model_modes[0], each.model_modes[-1]) for each in used])
    gaps = np.array([each.gap for each in used])
    f, both = measured.frequencies[places], modes.frequencies[pairs]
    shares = both / both.sum(axis=1, keepdims=True)  # d ln(mean f) = Σ f dln f / Σ f
    slopes = modes.log_frequency_slopes[pairs]
    zeros = np.zeros(len(used), dtype=int)
    return (
        np.log(both.mean(axis=1) / f),
        measured.log_variances[places],
        settings.frequency_floor**2 + (gaps / f) ** 2,
        np.ones(len(used)),
        shares[:, :1] * slopes[:, 0] + shares[:, 1:] * slopes[:, 1],
        np.arange(len(used)),
        measured.tracks[places],
        zeros,
        zeros,
    )


def _shape_rows(
    measured: _Measured,
    used: Sequence[ModeComparison],
    modes: Linearisation,
    settings: LikelihoodSettings,
) -> tuple[NDArray[Any], ...]:
    """Components of the shapes that are compared, normalised to the identified mode's unit; as
    `_frequency_rows`."""
    groups = np.array([n for n, each in enumerate(used) if each.shape_used], dtype=int)
    places = np.array([used[n].identified for n in groups], dtype=int)
    columns = np.array([used[n].model_modes[0] for n in groups], dtype=int)
    units, each = measured.units[places], np.arange(len(groups))
    read, turned = modes.readings[columns], modes.reading_slopes[columns]
    at_unit = read[each, units][:, None]
    shapes = read / at_unit
    slopes = (turned - shapes[..., None] * turned[each, units][:, None]) / at_unit[..., None]
    known = measured.known[places]
    mode, channel = np.nonzero(known)
    norms = np.nansum(measured.shapes[places] ** 2, axis=1)
    return (
        (np.real(shapes) - measured.shapes[places])[known],
        measured.shape_variances[places][known],
        np.full(len(mode), settings.shape_floor**2),
        norms[mode],
        np.real(slopes)[known],
        groups[mode],
        measured.tracks[places][mode],
        1 + channel,
        units[mode],
    )
