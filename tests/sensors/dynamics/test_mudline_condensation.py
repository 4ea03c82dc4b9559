"""Modes from the two by two equation of the mudline, against plain eigenvalue solutions."""

import numpy as np
import pytest
from scipy.linalg import block_diag, eigh, null_space

from sensors.dynamics.mudline_condensation import (
    MudlineCondensation,
    SpringEigenproblem,
    spring_modes_solver,
)

REFERENCE = np.array([[1.0, 0.4], [0.4, 0.5]])


def random_structure(n: int, *, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Λ, (n,), and Y, (2, n), of a structure on springs, its frequencies spread over decades."""
    generator = np.random.default_rng(seed)
    free = np.diag(np.concatenate([[0.0, 0.0], np.geomspace(0.5, 500.0, n - 2)]))
    mudline = generator.normal(size=(2, n)) * np.geomspace(1.0, 0.3, n)
    squares, vectors = np.linalg.eigh(free + mudline.T @ REFERENCE @ mudline)
    return squares, mudline @ vectors


def random_springs(count: int, *, seed: int) -> np.ndarray:
    """(count, 2, 2) positive definite springs from a tenth to ten times the reference."""
    generator = np.random.default_rng(seed)
    scale = 10 ** generator.uniform(-0.5, 0.5, (count, 2))
    coupling = generator.uniform(-0.95, 0.95, count) * np.sqrt(scale.prod(axis=1))
    springs = np.empty((count, 2, 2))
    springs[:, 0, 0], springs[:, 1, 1] = scale.T
    springs[:, 0, 1] = springs[:, 1, 0] = coupling
    return springs


@pytest.mark.parametrize("seed", range(4))
def test_the_condensed_modes_are_those_of_the_eigenvalue_problem(seed: int) -> None:
    squares, mudline = random_structure(20, seed=seed)
    springs = random_springs(50, seed=seed + 100)
    condensed = MudlineCondensation(squares, mudline, REFERENCE)
    found = condensed.modes(springs)
    plain = SpringEigenproblem(squares, mudline[None], REFERENCE).modes(springs)
    n = condensed.n_modes
    assert found.squares == pytest.approx(plain.squares[:, :n], rel=1e-6)
    vectors = found.coordinates @ condensed.basis.T
    overlap = np.abs(np.einsum("nki,nki->nk", vectors, plain.coordinates[:, :n]))
    assert overlap == pytest.approx(1.0, abs=1e-6)


def test_the_modes_are_mass_normalised_and_orthogonal() -> None:
    condensed = MudlineCondensation(*random_structure(16, seed=7), REFERENCE)
    found = condensed.modes(random_springs(20, seed=8))
    vectors = found.coordinates @ condensed.basis.T
    products = vectors @ vectors.swapaxes(1, 2)  # the basis is mass-normalised
    assert np.allclose(products, np.eye(condensed.n_modes), atol=1e-5)


def test_a_mode_that_hardly_moves_the_mudline_is_found_beside_its_pole() -> None:
    squares, mudline = random_structure(20, seed=11)
    for strength in 10.0 ** -np.arange(3, 14):
        weak = mudline.copy()
        weak[:, 9] *= strength
        springs = random_springs(20, seed=12)
        condensed = MudlineCondensation(squares, weak, REFERENCE)
        plain = SpringEigenproblem(squares, weak[None], REFERENCE).modes(springs)
        found = condensed.modes(springs)
        assert np.allclose(found.squares, plain.squares[:, : condensed.n_modes], rtol=1e-6)


def test_a_mode_of_one_bar_at_a_pole_of_another_is_mass_normalised_too() -> None:
    """Two bars that share no mudline coordinate. There G is as good as infinite across the mode,
    and what is left of the mode's own mass in G' is rounding."""
    generator = np.random.default_rng(16)
    bars = [np.array([0.0, 0.8, 5.0, 40.0]), np.array([0.0, 1.3, 9.0, 70.0])]  # free, λ
    rows = generator.normal(size=(2, 4))
    mudline = block_diag(rows[:1], rows[1:])
    free = np.diag(np.concatenate(bars))
    squares, vectors = np.linalg.eigh(free + mudline.T @ REFERENCE @ mudline)
    condensed = MudlineCondensation(squares, mudline @ vectors, REFERENCE)
    clamped = null_space(rows[1:])
    poles = np.linalg.eigvalsh(clamped.T @ np.diag(bars[1]) @ clamped)
    for pole in poles:
        wanted = pole * (1 + np.outer([-1, 1], np.geomspace(1e-11, 1e-3, 40)).ravel())
        # the first bar has a mode of that λ on a spring of −1 / (Y (Λ − λ)⁻¹ Yᵀ)
        flexibilities = (rows[0] ** 2 / (bars[0] - wanted[:, None])).sum(axis=1)
        springs = np.array([np.diag([-1 / each, 0.7]) for each in flexibilities if each < 0])
        found = condensed.modes(springs) if len(springs) else None
        if found is not None:
            vectors_found = found.coordinates @ condensed.basis.T
            assert np.linalg.norm(vectors_found, axis=2) == pytest.approx(1.0, abs=1e-6)


def test_a_mode_that_does_not_move_the_mudline_stays_whatever_the_springs() -> None:
    squares, mudline = random_structure(20, seed=13)
    mudline[:, 7] = 0.0
    condensed = MudlineCondensation(squares, mudline, REFERENCE)
    found = condensed.modes(random_springs(50, seed=14))
    vectors = found.coordinates @ condensed.basis.T
    mine = np.abs(vectors[:, :, 7]).argmax(axis=1)
    rows = np.arange(50)
    assert found.squares[rows, mine] == pytest.approx(squares[7], rel=1e-9)
    assert np.abs(vectors[rows, mine, 7]) == pytest.approx(1.0)
    assert np.abs(vectors[rows, mine][:, np.arange(20) != 7]).max() < 1e-6


def test_very_soft_and_very_stiff_springs_are_solved_too() -> None:
    squares, mudline = random_structure(12, seed=15)
    springs = np.array([1e-6, 1e-3, 1e3, 1e6])[:, None, None] * REFERENCE
    condensed = MudlineCondensation(squares, mudline, REFERENCE)
    found = condensed.modes(springs)
    for one, spring in zip(found.squares, springs, strict=True):
        stiffness = np.diag(squares) + mudline.T @ (spring - REFERENCE) @ mudline
        expected = eigh(stiffness, eigvals_only=True)[: len(one)]
        assert one == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_batches_are_solved_as_one_by_one() -> None:
    condensed = MudlineCondensation(*random_structure(14, seed=16), REFERENCE)
    springs = random_springs(30, seed=17)
    together = condensed.modes(springs)
    for i, spring in enumerate(springs):
        alone = condensed.modes(spring[None])
        assert alone.squares[0] == pytest.approx(together.squares[i], rel=1e-9)


def test_two_coupled_planes_fall_back_on_the_eigenvalue_problem() -> None:
    squares, mudline = random_structure(10, seed=18)
    both = np.concatenate([squares, squares * 1.1])
    planes = block_diag(mudline, mudline).reshape(2, 2, 20)
    solver = spring_modes_solver(both, planes, REFERENCE, n_modes=5)
    assert isinstance(solver, SpringEigenproblem)
    assert solver.modes(REFERENCE[None]).squares[0] == pytest.approx(np.sort(both))


def test_equal_clamped_modes_fall_back_on_the_eigenvalue_problem() -> None:
    squares, mudline = random_structure(10, seed=19)
    double = np.concatenate([squares, [300.0, 300.0]])
    planes = np.concatenate([mudline, np.zeros((2, 2))], axis=1)[None]
    assert isinstance(spring_modes_solver(double, planes, REFERENCE, n_modes=5), SpringEigenproblem)


def test_a_basis_too_small_for_the_wanted_modes_falls_back_too() -> None:
    squares, mudline = random_structure(6, seed=20)
    planes = mudline[None]
    few = spring_modes_solver(squares, planes, REFERENCE, n_modes=4)
    many = spring_modes_solver(squares, planes, REFERENCE, n_modes=5)
    assert isinstance(few, MudlineCondensation)
    assert isinstance(many, SpringEigenproblem)
