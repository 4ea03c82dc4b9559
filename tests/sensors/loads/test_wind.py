"""Wind against its formulas on long records, its drag against closed forms, its damping."""

import numpy as np
import pytest
from scipy.integrate import quad

from sensors.acquisition.layout import biaxial_layout
from sensors.dynamics.damped_modes import damped_system
from sensors.dynamics.simulated_modes import ModalDamping, observed_modes, structure_modes
from sensors.loads import LoadError, Wind, aerodynamic_damping, wind_load
from sensors.loads.spectra import iec_coherence, kaimal
from sensors.loads.wind import WindLoad, mean_speeds
from sensors.structure.assembly import assemble
from sensors.structure.description import load_turbine
from sensors.structure.structural_model import StructuralModel

SPEED, RATE = 12.0, 5.0  # [m/s], [Hz]
LAYOUT = biaxial_layout("four", turbine="t", unit="u", elevations=(41.0, 80.0, 106.0, 145.0))


@pytest.fixture(scope="module")
def tower() -> StructuralModel:
    return assemble(load_turbine("iea15mw_monopile"))


@pytest.fixture(scope="module")
def blowing(tower: StructuralModel) -> WindLoad:
    wind = Wind(highest_frequency=2.0, tower_points=4, blade_points=2)
    return wind_load(tower, wind, lambda time: SPEED, sampling_rate=RATE)


@pytest.fixture(scope="module")
def turbulence(blowing: WindLoad) -> tuple[np.ndarray, np.ndarray]:
    """Twenty hours, seed 4: u and v, (n_points, n)."""
    segments = blowing.turbulence(seed=4)
    drawn = [next(segments) for _ in range(120)]
    return tuple(np.concatenate(part, axis=1) for part in zip(*drawn, strict=True))


def test_kaimals_spectrum_holds_the_components_variance() -> None:
    variance = quad(
        lambda log_f: (
            np.exp(log_f)
            * kaimal(np.exp([log_f]), wind_speed=SPEED, deviation=1.3, length=340.0)[0]
        ),
        *np.log([1e-9, 1e9]),
    )[0]
    assert variance == pytest.approx(1.3**2, rel=1e-4)


def test_long_records_have_the_spectrum_of_the_formula(
    blowing: WindLoad, turbulence: tuple[np.ndarray, np.ndarray]
) -> None:
    for series, formula in zip(
        turbulence, (blowing.along_spectrum, blowing.across_spectrum), strict=True
    ):
        n = series.shape[1]
        lines = np.abs(np.fft.rfft(series, axis=1)) ** 2 * 2 / RATE / n
        f = np.fft.rfftfreq(n, 1 / RATE)
        for low, high in ((0.004, 0.008), (0.02, 0.04), (0.1, 0.2), (0.5, 1.0)):
            part = (f > low) & (f <= high)
            ratio = (lines[:, part] / formula(f[part], SPEED)).mean()
            independent = part.sum()  # of one point alone: points are coherent at worst
            assert ratio == pytest.approx(1.0, abs=4 / np.sqrt(independent))


def test_long_records_have_the_coherence_of_the_formula(
    blowing: WindLoad, turbulence: tuple[np.ndarray, np.ndarray]
) -> None:
    """Real part of the cross-spectrum over the spectra, bands of 200 lines and more: its own
    scatter is below .05."""
    along, across = turbulence
    n = along.shape[1]
    f = np.fft.rfftfreq(n, 1 / RATE)
    lines, sideways = np.fft.rfft(along, axis=1), np.fft.rfft(across, axis=1)
    apart = np.linalg.norm(blowing.points.positions[0] - blowing.points.positions[1])
    for low, high in ((0.003, 0.006), (0.01, 0.02), (0.04, 0.06)):
        part = (f > low) & (f <= high)

        def measured(z: np.ndarray, part: np.ndarray = part) -> float:
            cross = (z[0, part] * z[1, part].conj()).mean().real
            return float(cross / np.sqrt(np.prod((np.abs(z[:2, part]) ** 2).mean(axis=1))))

        formula = iec_coherence(f[part], np.array(apart), wind_speed=SPEED, length=340.2).mean()
        assert measured(lines) == pytest.approx(formula, abs=4 / np.sqrt(2 * part.sum()))
        assert measured(sideways) == pytest.approx(0.0, abs=4 / np.sqrt(2 * part.sum()))


def test_coherence_is_one_at_a_point_and_falls_with_distance_and_frequency() -> None:
    f = np.array([0.0, 0.01, 0.1])
    coherence = iec_coherence(f, np.array([0.0, 10.0, 50.0]), wind_speed=SPEED, length=340.2)
    assert coherence[:, 0] == pytest.approx(1.0)
    assert (np.diff(coherence, axis=1) < 0).all()
    assert (np.diff(coherence[:, 1:], axis=0) < 0).all()


def test_steady_wind_pushes_with_half_rho_cd_a_v_squared(tower: StructuralModel) -> None:
    wind = Wind(turbulence_intensity=0.0, shear_exponent=0.0, highest_frequency=0.4)
    load = wind_load(tower, wind, lambda time: SPEED, sampling_rate=1.0)
    force = next(load.series(seed=1, chunk=10))
    n = len(load.points.positions)
    blades = 0.02 * 3 * np.trapezoid(wind.blade_chords, np.linspace(0, 117, 11))
    mean_diameter = np.mean([t.diameter for t in tower.description.tubes if t.bottom > 0])
    area = 0.7 * 145.0 * mean_diameter + 1.2 * 100.0 + blades
    assert force[0, :n].sum() == pytest.approx(0.5 * 1.225 * area * SPEED**2, rel=0.05)
    assert np.ptp(force, axis=0).max() == 0.0
    assert not force[:, n:].any()


def test_shear_makes_the_wind_at_the_hub_the_one_that_is_stated(blowing: WindLoad) -> None:
    speeds = mean_speeds(blowing.points, blowing.wind, blowing.hub_height, SPEED)
    at_hub = np.interp(blowing.hub_height, *np.sort([blowing.points.positions[:5, 1], speeds[:5]]))
    assert at_hub == pytest.approx(SPEED, rel=0.01)
    assert (np.diff(speeds[:4]) > 0).all()


def test_damping_by_air_is_symmetric_never_negative_and_grows_with_the_wind(
    tower: StructuralModel,
) -> None:
    slow, fast = (aerodynamic_damping(tower, Wind(), speed) for speed in (2.0, 12.0))
    np.testing.assert_allclose(fast, fast.T, atol=1e-6)
    assert np.linalg.eigvalsh(fast).min() > -1e-6 * np.linalg.eigvalsh(fast).max()
    np.testing.assert_allclose(fast, 6 * slow, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("larger", [Wind(nacelle_area=300.0), Wind(blade_chords=(12.0, 10.0))])
def test_a_larger_nacelle_or_blade_is_damped_more_by_air(
    tower: StructuralModel, larger: Wind
) -> None:
    more, shipped = (aerodynamic_damping(tower, wind, 12.0) for wind in (larger, Wind()))
    assert np.trace(more) > 1.01 * np.trace(shipped)


def test_damping_is_the_slope_of_the_force_with_the_relative_wind(blowing: WindLoad) -> None:
    """A structure that moves downwind with v feels less force by c v."""
    wind, points = blowing.wind, blowing.points
    means = mean_speeds(points, wind, blowing.hub_height, SPEED)[:, None]
    step, still = 1e-4, np.zeros_like(means)
    n = len(means)
    slope = (blowing._forces(means + step, still) - blowing._forces(means, still))[0] / step
    expected = wind.air_density * points.along_area * means[:, 0]
    np.testing.assert_allclose(slope[:n], expected, rtol=1e-4)


def test_damping_by_air_makes_mode_shapes_complex(tower: StructuralModel) -> None:
    """Modal damping alone leaves them real; the air's does not, and so Eq. 11 matters."""
    modes = structure_modes(tower, ModalDamping(), highest_frequency=15.0)
    observed = observed_modes(tower, modes, LAYOUT, np.eye(tower.n_dofs)[:, :1])
    for dampers, turned in ((None, False), (aerodynamic_damping(tower, Wind(), 12.0), True)):
        system = damped_system(tower, modes, observed, dampers)
        shape = observed.displacement @ system.vectors[:, 0]
        collinear = np.abs((shape**2).sum()) / (np.abs(shape) ** 2).sum()
        assert (collinear < 1 - 1e-9) == turned


@pytest.mark.parametrize(
    ("wrong", "message"),
    [({"speed": 0.0}, "speed is 0 m/s"), ({"tower_points": 0}, "0 tower_points")],
)
def test_a_wind_that_cannot_be_is_refused(wrong: dict[str, float], message: str) -> None:
    with pytest.raises(LoadError, match=message):
        Wind(**wrong)
