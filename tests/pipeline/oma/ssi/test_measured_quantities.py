"""Channels that measure accelerations, velocities and displacements of one structure."""

import functools
from pathlib import Path

import numpy as np
import pytest

from pipeline.messages import Mode
from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.offline.identify_file import identify_file
from pipeline.oma.data_quality.guessed_quantities import guessed_quantities
from pipeline.oma.identification import identify
from pipeline.oma.ssi.stabilization import integrations_of, to_acceleration
from sensors.files.table import Quantity
from tests.benchmarks.records import oscillator

FREQUENCIES, DAMPING = (1.1, 3.3), 0.01
SHAPES = np.array([[0.4, 0.8, 1.0], [1.0, 0.3, -0.9]])
RATE = 25.0


@functools.cache
def _response(quantities: tuple[Quantity, ...]) -> np.ndarray:
    """Of two modes under white forces, seed 12, 600 s, 1 % noise."""
    generator = np.random.default_rng(12)
    n = round(600 * RATE)
    forces = generator.standard_normal((2, n))
    columns = []
    for place, quantity in enumerate(quantities):
        seen = sum(
            shape[place] * f * oscillator(f, DAMPING, RATE, force, quantity)
            for shape, f, force in zip(SHAPES, FREQUENCIES, forces, strict=True)
        )
        columns.append(seen + 0.01 * np.std(seen) * generator.standard_normal(n))
    return np.column_stack(columns)


def response(quantities: tuple[Quantity, ...]) -> np.ndarray:
    return _response(quantities).copy()


@functools.cache
def modes_of_accelerations() -> tuple[Mode, ...]:
    return identify(response(("acceleration",) * 3), RATE).modes


def test_a_mode_moves_faster_by_its_pole_for_each_derivative() -> None:
    pole, dt = -0.1 + 7.0j, 0.02
    factors = to_acceleration(np.exp([pole * dt]), dt, np.array([0, 1, 2]))
    np.testing.assert_allclose(factors, [[1.0, pole, pole**2]])


def test_channels_of_one_quantity_need_no_conversion() -> None:
    assert not integrations_of(("velocity", "velocity"), 2).any()
    assert not integrations_of(None, 2).any()
    assert list(integrations_of(("acceleration", "displacement", "velocity"), 3)) == [0, 2, 1]


MIXED: tuple[Quantity, ...] = ("displacement", "velocity", "acceleration")


@pytest.mark.parametrize(
    "quantities", [MIXED, MIXED[::-1], ("acceleration", "acceleration", "velocity")]
)
def test_mixed_quantities_show_the_same_modes_as_accelerations(
    quantities: tuple[Quantity, ...],
) -> None:
    expected = modes_of_accelerations()
    found = identify(response(quantities), RATE, quantities=quantities).modes
    assert len(found) == len(expected) == 2
    for mode, same in zip(found, expected, strict=True):
        joint = np.hypot(mode.frequency_std, same.frequency_std)
        assert abs(mode.frequency - same.frequency) < 3 * joint
        assert modal_assurance_criterion(mode.shape[None], same.shape[None])[0, 0] > 0.999
        error = np.abs(mode.shape - same.shape)
        assert np.all(error <= 4 * np.hypot(mode.shape_std, same.shape_std) + 0.01)


@pytest.mark.parametrize(
    ("quantities", "expected"),
    [
        (("acceleration",) * 3, None),
        (
            ("acceleration", "velocity", "acceleration"),
            ("acceleration", "velocity", "acceleration"),
        ),
        (("displacement", "displacement", "velocity"), ("velocity", "velocity", "acceleration")),
    ],
)
def test_phases_tell_a_derivative_where_nothing_else_does(
    quantities: tuple[Quantity, ...], expected: tuple[Quantity, ...] | None
) -> None:
    """What is known is the order of the two: a displacement is to a velocity as that to an
    acceleration."""
    assert guessed_quantities(response(quantities), RATE) == expected


def test_phases_are_read_beside_mains_hum_and_around_missing_samples() -> None:
    expected: tuple[Quantity, ...] = ("acceleration", "velocity", "acceleration")
    samples = response(expected)
    hum = np.sin(2 * np.pi * 0.31 * np.arange(len(samples)))
    assert guessed_quantities(samples + 0.5 * samples.std(axis=0) * hum[:, None], RATE) == expected
    samples[100:110, 1] = np.nan
    samples[[3000, 9000], [0, 2]] += 20 * samples[:, 0].std()
    assert guessed_quantities(samples, RATE) == expected
    samples[: len(samples) // 2, 1] = np.nan
    assert guessed_quantities(samples, RATE) is None


def test_phases_say_nothing_of_noise_or_of_a_dead_channel() -> None:
    noise = np.random.default_rng(3).standard_normal((4000, 3))
    assert guessed_quantities(noise, RATE) is None
    noise[:, 1] = 0.5
    assert guessed_quantities(noise, RATE) is None
    assert guessed_quantities(noise[:, :1], RATE) is None


def test_a_file_without_units_says_what_its_phases_told(tmp_path: Path) -> None:
    samples = response(("acceleration", "velocity", "acceleration"))
    file = tmp_path / "mixed.csv"
    np.savetxt(file, samples, delimiter=",", header="top,middle,foot", comments="")
    found = identify_file(file, sampling_rate=RATE)
    assert [w.text[:16] for w in found.warnings if w.code == "quantities-guessed"] == [
        "middle lags the "
    ]
    assert len(found.estimates[0].modes) == 2


@pytest.mark.parametrize("second", ["acceleration", "velocity"])
def test_a_velocity_that_the_file_calls_an_acceleration_is_told_of(
    tmp_path: Path, second: Quantity
) -> None:
    samples = response(("acceleration", second, "acceleration"))
    file = tmp_path / "declared.csv"
    header = "top [m/s2],middle [m/s2],foot [m/s2]"
    np.savetxt(file, samples, delimiter=",", header=header, comments="")
    found = identify_file(file, sampling_rate=RATE)
    told = [w.text[:14] for w in found.warnings if w.code == "quantities-doubtful"]
    assert told == (["middle differs"] if second == "velocity" else [])
