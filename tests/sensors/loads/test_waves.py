"""The sea against its formulas, Morison's force against the closed form of a cylinder."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sensors.loads import LoadError, Sea, SeaState, wave_load, wave_number
from sensors.loads.spectra import horizontal_motion, wave_numbers
from sensors.loads.synthesis import OVERLAP
from sensors.loads.waves import WaveLoad, directional_covariance, elevation_spectrum
from sensors.structure.assembly import assemble
from sensors.structure.description import load_turbine
from sensors.structure.structural_model import PLANE_COLUMNS, StructuralModel

STATE = SeaState(significant_wave_height=3.5, peak_period=8.0, level=0.0, direction=0.0)
RATE = 10.0  # [Hz]: ample for what ends at 0.6 Hz
DEPTH, DIAMETER, DENSITY = 30.0, 10.0, 1025.0


@pytest.fixture(scope="module")
def tower() -> StructuralModel:
    return assemble(load_turbine("iea15mw_monopile"), tube_refinement=2)


def load(
    tower: StructuralModel, sea: Sea, state: Callable[[float], SeaState] = lambda time: STATE
) -> WaveLoad:
    return wave_load(tower, sea, state, highest_level=0.0, largest_height=3.5, sampling_rate=RATE)


def drawn(segments: Iterator[np.ndarray], n: int) -> np.ndarray:
    return np.concatenate([next(segments) for _ in range(n)])


@given(frequency=st.floats(0.02, 1.0), depth=st.floats(5.0, 200.0))
def test_many_wave_numbers_at_once_are_those_found_one_by_one(
    frequency: float, depth: float
) -> None:
    many = wave_numbers(np.array([frequency, 0.3]), depth)
    assert many[0] == pytest.approx(wave_number(frequency, depth), rel=1e-9)


def test_water_moves_in_deep_water_circles_at_the_surface_and_evenly_in_the_shallows() -> None:
    heights = np.array([0.0, 1.0])
    deep = horizontal_motion(np.array([0.5]), heights, depth=200.0)[:, 0]
    assert deep == pytest.approx([0.0, np.pi], abs=1e-9)  # ω at the surface
    shallow = horizontal_motion(np.array([0.002]), heights, depth=5.0)[:, 0]
    assert shallow == pytest.approx(np.sqrt(9.81 / 5.0), rel=1e-3)  # η √(g/d) everywhere


def test_the_surface_has_its_significant_height_and_its_spectrum(tower: StructuralModel) -> None:
    """Twelve hours, seed 5. The variance's own scatter is √(∫S² df / T)."""
    sea = Sea(surface="mean")
    surface = drawn(load(tower, sea).surface(seed=5), 72)
    f = np.linspace(1e-3, 0.6, 3000)
    density = elevation_spectrum(sea, STATE, f)
    assert 4 * np.sqrt(np.trapezoid(density, f)) == pytest.approx(3.5, rel=1e-3)
    duration = len(surface) / RATE
    scatter = np.sqrt(np.trapezoid(density**2, f) / duration) / np.var(surface)
    assert 4 * surface.std() == pytest.approx(3.5, rel=4 * scatter / 2)
    lines = np.abs(np.fft.rfft(surface)) ** 2 * 2 / RATE / len(surface)
    for low, high in ((0.09, 0.11), (0.115, 0.135), (0.15, 0.25), (0.3, 0.55)):
        first, last = (round(edge * duration) for edge in (low, high))
        part = (f > low) & (f <= high)
        expected = np.trapezoid(density[part], f[part]) / (high - low)
        assert lines[first:last].mean() == pytest.approx(expected, rel=4 / np.sqrt(last - first))


def test_the_linear_wave_force_is_that_of_a_cylinder_in_closed_form(
    tower: StructuralModel,
) -> None:
    """Inertia alone, up to the still water: per unit elevation ρ C_M π D²/4 ω² / k in total."""
    wave = load(tower, Sea(surface="mean", drag_coefficient=0.0))
    f = np.array([0.08, 0.125, 0.2, 0.4, 0.6])
    amplitude = np.abs(wave._linear_force(f, STATE)[0])  # the constant pattern is the total
    k = wave_numbers(f, DEPTH)
    closed = DENSITY * 2.0 * np.pi * DIAMETER**2 / 4 * (2 * np.pi * f) ** 2 / k
    np.testing.assert_allclose(amplitude, closed, rtol=2e-3)


def test_the_forces_variance_is_that_of_its_spectrum(tower: StructuralModel) -> None:
    """Six hours, seed 5: the total of the linear force, against ∫ S |F/η|² df."""
    sea = Sea(surface="mean", drag_coefficient=0.0)
    wave = load(tower, sea)
    total = drawn(wave.series(seed=5, chunk=6000), 36)[:, 0]
    f = np.linspace(1e-3, 0.6, 3000)
    density = elevation_spectrum(sea, STATE, f) * np.abs(wave._linear_force(f, STATE)[0]) ** 2
    variance = np.trapezoid(density, f)
    scatter = np.sqrt(np.trapezoid(density**2, f) / (len(total) / RATE)) / variance
    assert np.var(total) == pytest.approx(variance, rel=4 * scatter)


def test_a_constant_flow_of_force_reaches_the_structure_where_it_acts(
    tower: StructuralModel,
) -> None:
    """The patterns put a unit force at any height on the modes like the beam's own row."""
    wave = load(tower, Sea())
    fore_aft = wave.distribution[:, :8]
    for height in (-25.0, -12.0, 1.0):
        x = 2 * (height - wave.mudline) / (wave.top - wave.mudline) - 1
        carried = fore_aft @ np.polynomial.legendre.legvander(np.array([x]), 7)[0]
        row = tower.tower_displacement(height, (1.0, 0.0, 0.0))
        static = np.linalg.solve(tower.stiffness, np.stack([carried, row], axis=1))
        shaken = static[tower.tower_dofs[:, PLANE_COLUMNS["FA"].start]]
        largest = np.abs(shaken[:, 1]).max()
        np.testing.assert_allclose(shaken[:, 0], shaken[:, 1], atol=2e-3 * largest)


def test_drag_alone_follows_the_square_of_the_velocity(tower: StructuralModel) -> None:
    """A steady stream u over the whole depth: ½ ρ C_D D u|u| d."""
    wave = load(tower, Sea(surface="mean", inertia_coefficient=0.0, drag_coefficient=1.0))
    motion = np.zeros((2, 2, 12, 3))
    motion[0, 0] = [1.0, -2.0, 3.0]
    force = wave._forces(np.zeros(3), motion, np.full(3, DEPTH))[:, 0]
    expected = 0.5 * DENSITY * DIAMETER * DEPTH * np.array([1.0, -4.0, 9.0])
    np.testing.assert_allclose(force, expected, rtol=1e-9)


def test_the_instantaneous_surface_adds_force_beyond_the_seas_own_band(
    tower: StructuralModel,
) -> None:
    def beyond(surface: str) -> float:
        wave = load(tower, Sea(surface=surface, drag_coefficient=0.0))
        total = next(wave.series(seed=5, chunk=6000))[:, 0]
        lines = np.abs(np.fft.rfft(total * np.hanning(len(total))))
        frequencies = np.fft.rfftfreq(len(total), 1 / RATE)
        return float(lines[(frequencies > 0.65) & (frequencies < 1.0)].mean())

    assert beyond("instantaneous") > 20 * beyond("mean")


@given(spreading=st.floats(1.0, 100.0), direction=st.floats(-180.0, 180.0))
def test_a_spread_sea_has_the_variances_of_its_directions(
    spreading: float, direction: float
) -> None:
    """Against the integral of cos²ˢ(Δ/2) itself."""
    angle = np.linspace(-np.pi, np.pi, 4001)
    weight = np.cos(angle / 2) ** (2 * spreading)
    weight /= weight.sum()
    towards = angle + np.radians(direction)
    waves = np.stack([np.ones_like(towards), np.cos(towards), np.sin(towards)])
    np.testing.assert_allclose(
        directional_covariance(spreading, direction), (waves * weight) @ waves.T, atol=2e-3
    )


def test_a_long_crested_sea_along_the_wind_pushes_fore_aft_only(tower: StructuralModel) -> None:
    forces = next(load(tower, Sea()).series(seed=1, chunk=600))
    assert np.abs(forces[:, 8:]).max() < 1e-9 * np.abs(forces[:, :8]).max()
    turned = load(tower, Sea(), lambda time: replace(STATE, direction=90.0))
    forces = next(turned.series(seed=1, chunk=600))
    assert np.abs(forces[:, :8]).max() < 1e-6 * np.abs(forces[:, 8:]).max()


def test_a_higher_tide_lengthens_the_column_that_is_pushed(tower: StructuralModel) -> None:
    def total(level: float) -> float:
        state = replace(STATE, level=level)
        return float(np.std(next(load(tower, Sea(), lambda time: state).series(3, 6000))[:, 0]))

    assert total(1.5) != pytest.approx(total(0.0), rel=1e-4)
    assert total(1.5) == pytest.approx(total(0.0), rel=0.1)


@pytest.mark.parametrize("chunk", [100, 700, 6000])
def test_waves_do_not_depend_on_the_chunks_they_are_drawn_in(
    tower: StructuralModel, chunk: int
) -> None:
    whole = next(load(tower, Sea()).series(seed=2, chunk=8400))
    segments = drawn(load(tower, Sea()).series(seed=2, chunk=chunk), -(-8400 // chunk))
    np.testing.assert_array_equal(segments[:8400], whole)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"significant_wave_height": -1.0}, "significant_wave_height is -1 m"),
        ({"peak_period": 1.0}, "peak_period is 1 s; the spectrum ends at 0.6 Hz"),
        ({"spreading": 0.0}, "spreading is 0"),
    ],
)
def test_a_sea_that_cannot_be_is_refused(wrong: dict[str, float], message: str) -> None:
    with pytest.raises(LoadError, match=message):
        Sea(**wrong)


def test_the_column_that_is_pushed_follows_the_tide_from_segment_to_segment(
    tower: StructuralModel,
) -> None:
    """Once the water has risen, forces are those of a sea that was always so high."""
    high, n = replace(STATE, level=1.5), round(OVERLAP * RATE)
    always, risen = (
        drawn(load(tower, Sea(), state).series(3, n), 4)
        for state in (lambda _: high, lambda time: high if time > 1.0 else STATE)
    )
    assert not np.array_equal(risen[:n], always[:n])
    np.testing.assert_array_equal(risen[3 * n :], always[3 * n :])
