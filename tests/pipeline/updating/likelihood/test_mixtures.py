"""Shares of alike neighbours: against dense covariances, and by what they make of a fit."""

import functools
from dataclasses import dataclass, replace

import numpy as np
import pytest

from pipeline.messages import ModalEstimate
from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.likelihood.mixtures import _columns, _neighbours, with_mixtures
from pipeline.updating.likelihood.mode_errors import ModeErrors, mode_errors
from pipeline.updating.settings import UpdatingSettings
from pipeline.updating.structural.alternatives import JointInference
from pipeline.updating.structural.inference import joint_inference
from pipeline.updating.structural.joint_fit import JointFit
from pipeline.updating.structural.refresh import joint_refresh
from pipeline.updating.structural.settings import UNCERTAIN
from sensors.arrays import FloatArray
from sensors.structure.description import load_turbine
from tests.outside.modal_data import LAYOUT, Truth, estimates, visible_modes
from tests.outside.model import NOMINAL, converged

BROADENING = 2.0  # of a resonance that is two
TRUTH = Truth(NOMINAL * np.array([1.05, 0.95, 1.0]), description=converged())


@pytest.fixture(scope="module")
def inference() -> JointInference:
    """Tubes that only bend and an empty monopile, as is true; the blades as they may be."""
    known = replace(UNCERTAIN, stds=(("flooding", 0.0), ("tube_shear", 0.0)))
    turbine = load_turbine("iea15mw_monopile")
    found = joint_inference(turbine, LAYOUT, UpdatingSettings(structure=known), seed=1)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def fit(inference: JointInference) -> JointFit:
    _, found = inference.fits[0]
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Neighbours:
    """A mode of the true structure and one beside it of nearly its shape."""

    name: str
    """As the drawn estimates call it."""
    other: str
    """The one beside it."""
    distance: float
    """ln of the other's frequency over its own [-]"""
    shape: FloatArray
    """(n_channels,) of the other, largest component 1 [-]"""

    def mixed(self, estimate: ModalEstimate, share: float) -> ModalEstimate:
        """The estimate with a share of the neighbour in the mode, the neighbour left out."""
        modes = []
        for mode in estimate.modes:
            if mode.name == self.name:
                unit = int(np.argmax(np.abs(mode.shape)))
                along = float(mode.shape @ self.shape / (mode.shape @ mode.shape))
                shape = mode.shape + share * (self.shape - self.shape[unit] * mode.shape)
                frequency = mode.frequency * float(np.exp(share * along * self.distance))
                broad = BROADENING * mode.damping_ratio
                mode = replace(mode, frequency=frequency, shape=shape, damping_ratio=broad)
            if mode.name != self.other:
                modes.append(mode)
        return replace(estimate, modes=tuple(modes))


def neighbours() -> Neighbours:
    """The clearest mode with one of nearly its shape 1.2 to 3.5 % away."""
    seen = visible_modes(TRUTH.modes(), LAYOUT)
    logs, shapes = np.log(seen.frequencies), seen.shapes
    products, norms = (shapes @ shapes.T) ** 2, (shapes**2).sum(axis=1)
    apart = np.abs(logs[:, None] - logs)
    near = (apart > 0.012) & (apart < 0.035) & (products > 0.8 * np.outer(norms, norms))
    clear = np.where(near, seen.dominance[:, None], 0.0)
    one, other = np.unravel_index(int(np.argmax(clear)), clear.shape)
    names = [f"m{number + 1}" for number in seen.numbers]
    return Neighbours(names[one], names[other], float(logs[other] - logs[one]), shapes[other])


def evidence_of(windows: list[ModalEstimate]) -> ModalEvidence:
    evidence = ModalEvidence(channels=LAYOUT.channel_names)
    for window in windows:
        evidence = evidence.with_estimate(window)
    return evidence


@functools.cache
def drawn_windows() -> list[ModalEstimate]:
    return estimates(TRUTH, 4, np.random.default_rng(3), reported_levels=[0.0] * 4)


@functools.cache
def drawn_evidence() -> ModalEvidence:
    return evidence_of(drawn_windows())


def plain_errors(fit: JointFit, u: FloatArray, like: ModeErrors) -> ModeErrors:
    """Errors at another point with the pairing as it is."""
    modes = fit.linearised(u)
    assert modes is not None
    return mode_errors(drawn_evidence(), like.pairing, like.used, modes, fit.likelihood)


def marginal_cost(found: ModeErrors, stds: FloatArray) -> float:
    """ηᵀ (D + E diag(s²) Eᵀ)⁻¹ η with a dense covariance. stds: s, (q,)"""
    columns, _ = _columns(found, _neighbours(found))
    covariance = np.diag(found.variances + found.floors) + (columns * stds**2) @ columns.T
    return float(found.errors @ np.linalg.solve(covariance, found.errors))


def compared(fit: JointFit) -> tuple[FloatArray, ModeErrors]:
    """A point near the nominal one and the errors there, before any share is taken out."""
    u = fit.coordinates.origin + 0.05
    evidence = drawn_evidence()
    found = fit.compared(evidence, fit.targets(evidence), u, 0.03)
    assert found is not None
    return u, plain_errors(fit, u, found)


def test_rows_of_shares_stand_for_a_covariance_that_is_not_diagonal(fit: JointFit) -> None:
    _, plain = compared(fit)
    found = with_mixtures(plain)
    assert len(found.errors) > len(plain.errors) + 5
    D = found.variances + found.floors
    near = _neighbours(plain)
    assert np.sum(found.errors**2 / D) == pytest.approx(marginal_cost(plain, near.stds), rel=1e-9)
    columns, slopes = _columns(plain, near)
    dense = np.diag(plain.variances + plain.floors) + (columns * near.stds**2) @ columns.T
    shares = found.errors[len(plain.errors) :]
    moved = plain.jacobian - np.einsum("pqu,q->pu", slopes, shares)
    np.testing.assert_allclose(
        (found.jacobian.T / D) @ found.jacobian,
        moved.T @ np.linalg.solve(dense, moved),
        rtol=1e-7,
        atol=1e-6 * np.abs(moved.T @ np.linalg.solve(dense, moved)).max(),
    )


@pytest.mark.parametrize("sigma", [0.0, 1e-3, 5e-3])
def test_beside_any_discrepancy_the_density_is_that_of_the_dense_covariance(
    fit: JointFit, sigma: float
) -> None:
    """Shares as likely at σ = 0, and no determinant, took most of σ for shares."""
    _, plain = compared(fit)
    found, wider = with_mixtures(plain).at_discrepancy(sigma)
    own = plain.variances + plain.floors + sigma**2 * plain.reference
    near = _neighbours(plain)
    columns, _ = _columns(plain, near)
    dense = np.diag(own) + (columns * near.stds**2) @ columns.T
    D = found.variances + found.floors + sigma**2 * found.reference
    expected = float(plain.errors @ np.linalg.solve(dense, plain.errors))
    assert np.sum(found.errors**2 / D) == pytest.approx(expected, rel=1e-9)
    rise = np.linalg.slogdet(dense)[1] - np.log(own).sum()
    assert wider == pytest.approx(rise, rel=1e-9)


def test_the_gradient_is_that_of_the_cost_with_the_shares_integrated_out(fit: JointFit) -> None:
    """By differences of the dense form, with the shares' standard deviations as they are."""
    u, plain = compared(fit)
    stds = _neighbours(plain).stds
    found = with_mixtures(plain)
    gradient = found.jacobian.T @ (found.errors / (found.variances + found.floors))
    for place in range(0, len(u), 8):
        step = np.zeros(len(u))
        step[place] = 1e-4
        rise = marginal_cost(plain_errors(fit, u + step, plain), stds)
        rise -= marginal_cost(plain_errors(fit, u - step, plain), stds)
        largest = 1e-4 * float(np.abs(gradient).max())
        assert rise / 4e-4 == pytest.approx(gradient[place], rel=1e-3, abs=largest)


def test_a_share_of_a_neighbour_is_found_and_explains_the_mode(inference: JointInference) -> None:
    near = neighbours()
    made = [near.mixed(window, 0.33) for window in drawn_windows()]
    found = joint_refresh(inference, evidence_of(made), (), np.random.default_rng(1))
    assert found is not None
    shares = found.best.peak.comparison
    assert np.abs(shares.errors[shares.rows < 0]).max() == pytest.approx(0.33, abs=0.08)
    assert found.checks.unpredicted_share == 0.0
    logs = np.log(found.draws[:, :3] * NOMINAL / TRUTH.theta)
    assert np.abs(logs.mean(axis=0) / logs.std(axis=0)).max() < 2.0
