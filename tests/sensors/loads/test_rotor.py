"""A turning rotor: harmonics where they belong, gusts averaged over the disc, damping by thrust."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sensors.loads import LoadError, Rotor, Wind, rotor_damping, rotor_load, thrust_slope
from sensors.loads.operating_states import steady_state
from sensors.loads.rotor import RotorLoad, averaging
from sensors.structure.assembly import assemble
from sensors.structure.description import load_turbine
from sensors.structure.structural_model import StructuralModel

SPEED, RATE = 9.0, 10.0  # [m/s], [Hz]
RUNNING = steady_state(SPEED, 1.0)
TURNS = RUNNING.rotor_speed / 60.0  # [Hz]


@pytest.fixture(scope="module")
def tower() -> StructuralModel:
    return assemble(load_turbine("iea15mw_monopile"))


def turning(
    tower: StructuralModel, rotor: Rotor, turbulence: float, share: float = 1.0
) -> RotorLoad:
    """A rotor in a steady mean wind of 9 m/s."""
    return rotor_load(
        tower,
        rotor,
        Wind(speed=SPEED, turbulence_intensity=turbulence),
        steady_at=lambda time: steady_state(SPEED, share, idling=True),
        speed_at=lambda time: SPEED,
        sampling_rate=RATE,
    )


def amplitude(series: np.ndarray, frequency: float) -> float:
    """Of the harmonic at a frequency [Hz] in a series at RATE."""
    window = np.hanning(len(series))
    phase = np.exp(-2j * np.pi * frequency * np.arange(len(series)) / RATE)
    return float(2 * np.abs((series * window) @ phase) / window.sum())


def test_a_turning_rotor_pushes_at_once_three_and_six_times_its_speed(
    tower: StructuralModel,
) -> None:
    rotor = Rotor(idling_imbalance=0.0)
    forces = next(turning(tower, rotor, turbulence=0.0).series(1, 6000))
    along, across = (forces - forces.mean(axis=0)).T
    shares = {1: rotor.first_harmonic, 3: rotor.third_harmonic, 6: rotor.sixth_harmonic}
    for order, share in shares.items():
        push = share * RUNNING.thrust
        assert amplitude(along, order * TURNS) == pytest.approx(push, rel=1e-3)
        assert amplitude(across, order * TURNS) == pytest.approx(rotor.side_share * push, rel=1e-3)
    for order in (2, 4, 5):
        assert amplitude(along, order * TURNS) < 1e-4 * RUNNING.thrust


def test_without_turbulence_the_mean_force_is_the_thrust(tower: StructuralModel) -> None:
    forces = next(turning(tower, Rotor(), turbulence=0.0).series(1, 6000))
    assert forces[:, 0].mean() == pytest.approx(RUNNING.thrust, rel=1e-3)
    assert forces[:, 1].mean() == pytest.approx(0.0, abs=1e-3 * RUNNING.thrust)


def test_an_idling_rotor_pushes_by_its_imbalance_alone(tower: StructuralModel) -> None:
    rotor = Rotor(idling_imbalance=2e3)
    forces = next(turning(tower, rotor, turbulence=0.1, share=0.0).series(1, 6000))
    idling = steady_state(SPEED, 0.0, idling=True).rotor_speed / 60.0
    assert np.std(forces[:, 0]) == pytest.approx(2e3 / np.sqrt(2), rel=0.02)
    assert amplitude(forces[:, 0], idling) == pytest.approx(2e3, rel=0.01)


def test_gusts_over_the_disc_have_the_spectrum_of_the_formula(tower: StructuralModel) -> None:
    """Ten hours, seed 8: each band within four standard deviations of its lines' mean, which
    the window against leakage of a red spectrum widens by √1.94."""
    quiet = Rotor(0.0, 0.0, 0.0, idling_imbalance=0.0)
    load = turning(tower, quiet, turbulence=0.1)
    thrust = next(load.series(8, 360_000))[:, 0]
    window = np.hanning(len(thrust))
    lines = np.abs(np.fft.rfft((thrust - thrust.mean()) * window)) ** 2
    lines *= 2 / RATE / (window**2).sum()
    f = np.fft.rfftfreq(len(thrust), 1 / RATE)
    for low, high in pairwise((0.005, 0.02, 0.1, 0.5, 1.9)):
        part = (f > low) & (f <= high)
        expected = load.response_spectrum(f[part], np.ones((part.sum(), 1, 2)))[:, 0]
        scatter = np.sqrt(1.94 / part.sum())
        assert (lines[part] / expected).mean() == pytest.approx(1.0, abs=4 * scatter)


def test_a_disc_feels_slow_gusts_whole_and_fast_ones_hardly() -> None:
    share = averaging(np.array([0.0, 0.01, 0.1, 1.0]), SPEED)
    assert share[0] == 1.0
    assert np.all(np.diff(share) < 0)
    assert share[-1] < 1e-3


def test_thrust_damps_the_apex_along_the_wind_only(tower: StructuralModel) -> None:
    slope = thrust_slope(Rotor(), RUNNING, SPEED)
    assert slope == pytest.approx(RUNNING.thrust / SPEED)  # half of 2 T / V
    damping = rotor_damping(tower, slope)
    moving = np.zeros(tower.n_dofs)
    moving[tower.tower_dofs[-1, 0]] = 1.0  # fore-aft of the tower's top
    aside = np.zeros(tower.n_dofs)
    aside[tower.tower_dofs[-1, 2]] = 1.0  # side-side
    assert moving @ damping @ moving == pytest.approx(slope)
    assert aside @ damping @ aside == 0.0
    assert np.linalg.matrix_rank(damping) == 1


@pytest.mark.parametrize("chunk", [700, 6000, 17_000])
def test_a_rotors_force_does_not_depend_on_the_chunks(tower: StructuralModel, chunk: int) -> None:
    load = turning(tower, Rotor(), turbulence=0.1)
    whole = next(load.series(3, 17_000))
    series = load.series(3, chunk)
    segments = np.concatenate([next(series) for _ in range(-(-17_000 // chunk))])
    np.testing.assert_array_equal(segments[:17_000], whole)


def test_a_rotor_with_a_negative_share_is_refused() -> None:
    with pytest.raises(LoadError, match=r"rotor third_harmonic is -0\.1"):
        Rotor(third_harmonic=-0.1)


@given(st.floats(0.0, 30.0), st.floats(0.0, 1.0), st.booleans())
def test_a_steady_rotor_is_between_feathered_and_in_operation(
    wind: float, share: float, idling: bool
) -> None:
    """What is on the way is a straight line between both ends; power goes with the wind cubed."""
    rest, full = (steady_state(wind, each, idling=idling) for each in (0.0, 1.0))
    found = steady_state(wind, share, idling=idling)
    for name in ("rotor_speed", "pitch", "power", "thrust"):
        ends = getattr(rest, name), getattr(full, name)
        expected = ends[0] + share * (ends[1] - ends[0])
        assert getattr(found, name) == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert (rest.pitch, rest.power, rest.thrust) == (90.0, 0.0, 0.0)
    assert rest.rotor_speed == pytest.approx(0.05 * wind if idling else 0.0)
    seen = min(max(wind, 3.0), 25.0)  # cut-in and cut-out
    assert full.power == pytest.approx(15e6 * min(1.0, (seen / 10.59) ** 3))
    assert 5.0 - 1e-9 <= full.rotor_speed <= 7.56 + 1e-9
    assert full.pitch == 0.0 or seen > 10.59
