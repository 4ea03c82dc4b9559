"""Coupled springs and the two signs of their coupling."""

import numpy as np
import pytest

from sensors.structure.foundation import (
    FoundationSprings,
    TurbineError,
    positive_definite,
    spring_matrix,
)

NOMINAL = np.array([0.098e11, 8.238e11, 0.678e11])  # [foundation-updating] Eq. 12


def test_published_springs_are_a_spring_above_the_mudline_and_a_rotational_one() -> None:
    k11, k22, k12 = NOMINAL
    height = k12 / k11
    reach = np.array([1.0, height])  # displacement at that height from (v, ψ)
    equivalent = k11 * np.outer(reach, reach) + np.diag([0.0, k22 - k12**2 / k11])
    assert height == pytest.approx(6.92, abs=0.01)
    assert spring_matrix(NOMINAL, "published") == pytest.approx(equivalent)


def test_the_embedded_pile_is_the_published_one_upside_down() -> None:
    turn = np.diag([1.0, -1.0])
    published = spring_matrix(NOMINAL, "published")
    assert spring_matrix(NOMINAL, "embedded-pile") == pytest.approx(turn @ published @ turn)


def test_many_springs_at_once_are_those_one_by_one() -> None:
    theta = NOMINAL * np.random.default_rng(1).uniform(0.25, 4, (5, 3))
    together = spring_matrix(theta, "published")
    assert together == pytest.approx(np.stack([spring_matrix(one, "published") for one in theta]))


def test_positive_definite_agrees_with_eigenvalues_over_the_prior_box() -> None:
    theta = NOMINAL * np.random.default_rng(2).uniform(0.25, 4, (4000, 3))
    scale = np.array([1.0, 0.1])  # rad · 0.1 m⁻¹, so that the eigenvalues are of one size
    scaled = spring_matrix(theta, "published") * np.outer(scale, scale)
    held = positive_definite(theta)
    assert np.array_equal(held, np.linalg.eigvalsh(scaled)[:, 0] > 0)
    assert held.mean() == pytest.approx(0.61, abs=0.02)


@pytest.mark.parametrize("bad", [[-1, 1, 0], [1, -1, 0], [1, 1, 1], [np.nan, 1, 0], [np.inf, 1, 0]])
def test_springs_that_hold_nothing_are_not_positive_definite(bad: list[float]) -> None:
    assert not positive_definite(bad)


def test_an_impossible_foundation_is_one_line_with_what_is_possible() -> None:
    with pytest.raises(TurbineError, match=r"k12 < sqrt\(k11·k22\) = 8.98512e\+10 N/rad"):
        FoundationSprings(k11=0.098e11, k22=8.238e11, k12=0.95e11)


def test_a_coupling_given_with_its_sign_is_refused() -> None:
    with pytest.raises(TurbineError, match=r"k12 is -6.78e\+10 N/rad; its magnitude is needed"):
        FoundationSprings(k11=0.098e11, k22=8.238e11, k12=-0.678e11)


def test_a_sign_word_that_is_none_is_named() -> None:
    with pytest.raises(TurbineError, match="'pile' is neither 'published' nor 'embedded-pile'"):
        FoundationSprings(*NOMINAL, sign="pile")  # type: ignore[arg-type]
