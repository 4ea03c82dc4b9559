"""Properties of comparing and normalising mode shapes, for any shapes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.modal_assurance import (
    complex_normalised,
    mac,
    modal_assurance_criterion,
    normalised_to,
    renormalised_factor,
)

SEEDS = st.integers(0, 2**32 - 1)
SIZES = st.integers(2, 7)


def shapes_of(seed: int, n: int, n_channels: int) -> np.ndarray:
    """Complex shapes, (n, n_channels)."""
    parts = np.random.default_rng(seed).normal(size=(2, n, n_channels))
    return parts[0] + 1j * parts[1]


@given(SEEDS, SIZES, st.floats(-9, 9), st.floats(0, 7))
def test_mac_is_the_squared_cosine_and_knows_neither_scale_nor_phase(
    seed: int, n_channels: int, log_scale: float, phase: float
) -> None:
    first, second = shapes_of(seed, 3, n_channels), shapes_of(seed + 1, 4, n_channels)
    found = modal_assurance_criterion(first, second)
    one, other = first[1], second[2]
    lengths = np.linalg.norm(one) * np.linalg.norm(other)
    assert found[1, 2] == pytest.approx((abs(np.vdot(one, other)) / lengths) ** 2)
    assert mac(one, other) == pytest.approx(found[1, 2])
    assert ((found >= 0) & (found <= 1 + 1e-12)).all()
    turned = 10**log_scale * np.exp(1j * phase) * second
    assert modal_assurance_criterion(first, turned) == pytest.approx(found)
    assert modal_assurance_criterion(second, first) == pytest.approx(found.T)
    assert np.diag(modal_assurance_criterion(first, first)) == pytest.approx(1.0)


def test_mac_of_no_shape_is_zero_and_of_perpendicular_ones_too() -> None:
    shapes = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 3.0]])
    assert modal_assurance_criterion(shapes, shapes) == pytest.approx(np.diag([0.0, 1.0, 1.0]))


@given(SEEDS, SIZES)
def test_a_real_shape_of_any_phase_is_found_with_its_largest_component_one(
    seed: int, n_channels: int
) -> None:
    real = shapes_of(seed, 1, n_channels)[0].real
    largest = np.argmax(abs(real))
    found = complex_normalised((2.0 - 3.0j) * real)
    assert found[largest] == pytest.approx(1.0, abs=1e-15)
    assert found == pytest.approx(real / real[largest])


@given(SEEDS, SIZES, st.data())
def test_a_shape_and_its_covariance_are_normalised_to_any_component(
    seed: int, n_channels: int, data: st.DataObject
) -> None:
    """The factor by finite differences of the shape along each of its columns."""
    component = data.draw(st.integers(0, n_channels - 1))
    rng = np.random.default_rng(seed)
    shape = rng.uniform(0.3, 1.0, n_channels) * rng.choice([-1.0, 1.0], n_channels)
    factor = rng.normal(size=(n_channels, 3))
    found = normalised_to(shape, component)
    assert found[component] == 1.0
    assert found * shape[component] == pytest.approx(shape)
    step = 1e-6
    moved = [
        normalised_to(shape + step * column, component)
        - normalised_to(shape - step * column, component)
        for column in factor.T
    ]
    expected = np.transpose(moved) / (2 * step)
    assert renormalised_factor(shape, factor, component) == pytest.approx(expected, abs=1e-6)
    assert not renormalised_factor(shape, factor, component)[component].any()
    assert normalised_to(np.stack([shape, 2 * shape]), component) == pytest.approx(
        np.stack([found, found])
    )
