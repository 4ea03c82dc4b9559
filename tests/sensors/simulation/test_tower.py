"""The simulated tower against theory, and the stream of its blocks."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.modal_assurance import modal_assurance_criterion
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout, biaxial_layout
from sensors.dynamics.modal_model import ModalModel, full_modes
from sensors.dynamics.responses.modal_response import AccelerationResponse
from sensors.dynamics.simulated_modes import ModalDamping, observed_modes, structure_modes
from sensors.loads import BroadbandLoad, WaveBandLoad, tower_pattern
from sensors.simulation.instruments import Instruments
from sensors.simulation.schedule import FoundationSchedule, StiffnessEvent
from sensors.simulation.tower import (
    SimulatedTower,
    SimulationError,
    SimulationSettings,
    resonance_grid,
    split_into_blocks,
    trim,
)
from sensors.structure.assembly import assemble
from sensors.structure.description import load_turbine
from sensors.structure.foundation import TurbineError
from tests.sensors.simulation.sensed_modes import sensed_modes

TURBINE = load_turbine("iea15mw_monopile")
SHORT = SimulationSettings(duration=20.0, transient=5.0)
QUIET = replace(SHORT, noise_share=0.0, quantisation_step=0.0)


def layout(**coupling: object) -> SensorLayout:
    return biaxial_layout(
        "biaxial-4", turbine="iea15mw", unit="tower", elevations=(41, 80, 106, 145), **coupling
    )


def tower(settings: SimulationSettings = SHORT) -> SimulatedTower:
    return SimulatedTower(TURBINE, layout(), settings)


def recorded(settings: SimulationSettings) -> NDArray[np.float64]:
    """All samples of a simulation, (n_samples, n_channels) [m/s²]."""
    blocks = [block.samples for block in tower(settings)]
    return np.concatenate(blocks).astype(np.float64)


@pytest.fixture(scope="module")
def short() -> NDArray[np.float64]:
    return not_written(recorded(SHORT))


@pytest.fixture(scope="module")
def quiet() -> NDArray[np.float64]:
    return not_written(recorded(QUIET))


def not_written(samples: NDArray[np.float64]) -> NDArray[np.float64]:
    samples.flags.writeable = False
    return samples


def test_band_by_band_the_response_is_within_the_statistical_band_of_theory() -> None:
    """Each channel's variance in seven bands. Seed 1, chosen before looking.

    An estimate of variance V of a series with spectrum S over T seconds is V χ²_ν / ν with
    ν = 2 V² / (1.94 ∫S² df / T), 1.94 for the Hann window; its cube root is nearly normal
    (Wilson and Hilferty).
    """
    duration, bands = 900.0, [0.05, 0.3, 0.8, 2.0, 4.0, 8.0, 13.0, 18.0]
    simulated = tower(replace(QUIET, duration=duration, transient=300.0))
    samples = np.concatenate(list(simulated.samples())).astype(np.float64)
    window = np.hanning(len(samples))[:, None]
    frequencies = np.fft.rfftfreq(len(samples), 1 / 40.0)
    measured = np.abs(np.fft.rfft(samples * window, axis=0)) ** 2 * 2 / 40.0 / (window**2).sum()
    grid = resonance_grid(simulated.modes, 20.0)
    theory = simulated.spectrum(grid)
    for low, high in pairwise(bands):
        inside = (frequencies > low) & (frequencies <= high)
        variance = measured[inside].sum(axis=0) * frequencies[1]
        part = (grid > low) & (grid <= high)
        expected = np.trapezoid(theory[part], grid[part], axis=0)
        scatter = 1.94 * np.trapezoid(theory[part] ** 2, grid[part], axis=0) / duration
        spread = 2 / (9 * 2 * expected**2 / scatter)
        deviate = ((variance / expected) ** (1 / 3) - (1 - spread)) / np.sqrt(spread)
        assert np.abs(deviate).max() < 4.0


def test_the_frequency_grid_integrates_the_lowest_resonances_to_three_parts_in_a_thousand() -> None:
    simulated = tower()
    fine = np.linspace(0.0, 1.4, 7001)
    grid = resonance_grid(simulated.modes, 1.4)
    coarse = np.trapezoid(simulated.spectrum(grid), grid, axis=0)
    exact = np.trapezoid(simulated.spectrum(fine), fine, axis=0)
    np.testing.assert_allclose(coarse, exact, rtol=3e-3)


def test_modal_response_equals_the_direct_solution_of_the_full_matrices() -> None:
    """(K + iωC − ω²M) u = f with C = MΦ diag(2ζω) ΦᵀM; read as u'' − gψ at the sensors."""
    model = assemble(TURBINE, tube_refinement=2)
    modes = structure_modes(model, ModalDamping(), highest_frequency=60.0)
    every = structure_modes(model, ModalDamping(), highest_frequency=1e6)
    force = np.zeros((model.n_dofs, 1))
    force[model.tower_dofs[25, 0]] = 1.0
    momentum = model.mass @ every.shapes
    damping = (momentum * (4 * np.pi * every.damping_ratios * every.frequencies)) @ momentum.T
    observed = observed_modes(model, modes, layout(), force)
    fore_aft = layout().channels[:4]
    for frequency in (0.12, 0.1586, 0.63, 2.6, 5.9):
        omega = 2 * np.pi * frequency
        dynamic = model.stiffness + 1j * omega * damping - omega**2 * model.mass
        u = np.linalg.solve(dynamic, force[:, 0])
        direct = [
            -(omega**2) * model.tower_displacement(axis.elevation, axis.direction) @ u
            - model.description.gravity * model.tower_slope(axis.elevation, axis.direction) @ u
            for axis in fore_aft
        ]
        poles = (2 * np.pi * modes.frequencies) ** 2 - omega**2
        q = observed.participation[:, 0] / (
            poles + 2j * modes.damping_ratios * omega * 2 * np.pi * modes.frequencies
        )
        modal = (-(omega**2) * observed.displacement - observed.gravity * observed.rotation) @ q
        np.testing.assert_allclose(modal[:4], direct, rtol=0.01, atol=0.002 * np.abs(direct).max())


def test_modes_beyond_60_hz_do_not_matter_to_what_is_read_below_18_hz() -> None:
    model = assemble(TURBINE, tube_refinement=2)
    force = tower_pattern(model, 50e3)
    frequencies = np.linspace(0.1, 18.0, 500)

    def density(highest_frequency: float) -> NDArray[np.float64]:
        modes = structure_modes(model, ModalDamping(), highest_frequency=highest_frequency)
        observed = observed_modes(model, modes, layout(), force)
        per_mode = AccelerationResponse(observed, 120.0).frequency_response(frequencies)
        return (np.abs(per_mode @ observed.participation) ** 2).sum(axis=2)

    kept, every = density(60.0), density(1e6)
    np.testing.assert_allclose(kept.sum(axis=0), every.sum(axis=0), rtol=5e-3)
    np.testing.assert_allclose(kept, every, rtol=0.1)  # .26 dB, in the deepest trough


def test_damping_runs_from_7_to_10_per_mille_with_the_blades_share() -> None:
    modes = tower().modes
    assert 0.007 < modes.damping_ratios.min() < 0.0075
    assert 0.0098 < modes.damping_ratios.max() <= 0.010
    np.testing.assert_allclose(
        modes.damping_ratios, 0.007 + 0.003 * modes.blade_energy_share, rtol=1e-12
    )
    assert modes.blade_energy_share[:2] == pytest.approx([0.17, 0.16], abs=0.06)


def test_the_first_modes_are_read_a_quarter_larger_at_41_m_and_a_ninth_at_145_m() -> None:
    """An accelerometer is an inclinometer too: (φ + g ψ/ω²) / φ of the first side-side mode."""
    model = assemble(TURBINE, tube_refinement=2)
    modes = structure_modes(model, ModalDamping(), highest_frequency=1.0)
    observed = observed_modes(model, modes, layout(), np.zeros((model.n_dofs, 1)))
    omega = 2 * np.pi * modes.frequencies[0]
    tilt = observed.gravity * observed.rotation[4:, 0] / omega**2 / observed.displacement[4:, 0]
    assert tilt[[0, 3]] == pytest.approx([0.25, 0.11], abs=0.01)


@pytest.mark.parametrize("coupling", [{}, {"coupling": "ac", "corner_frequency": 0.1}])
def test_at_resonance_the_simulator_reads_the_shapes_that_the_modal_model_gives(
    coupling: dict[str, object],
) -> None:
    """One measurement model, two routes: recursion and eigenvectors, of modes alone at 0.158,
    1.07 and 5.93 Hz. The slow first mode's damping turns the tilt's phase by 2ζ: hence 1e-3."""
    modal = full_modes(TURBINE, layout(**coupling), tube_refinement=2)
    response = SimulatedTower(TURBINE, layout(**coupling), SHORT).response()
    assert isinstance(response, AccelerationResponse)
    for frequency in (0.158614, 1.07, 5.93):
        mode = int(np.argmin(np.abs(modal.frequencies - frequency)))
        read = response.frequency_response(modal.frequencies[mode : mode + 1])[0, :, mode]
        shape = np.real(read / read[np.argmax(np.abs(read))])
        np.testing.assert_allclose(shape, modal.shapes[mode], atol=1e-3)


def test_the_same_seed_gives_the_same_samples_whatever_the_block_size(
    short: NDArray[np.float64],
) -> None:
    for block_duration in (0.025, 13.0):
        np.testing.assert_array_equal(
            recorded(replace(SHORT, block_duration=block_duration)), short
        )


def test_a_longer_simulation_begins_with_the_shorter_one(short: NDArray[np.float64]) -> None:
    longer = recorded(replace(SHORT, duration=70.0))
    np.testing.assert_array_equal(longer[:800], short)


def test_another_seed_gives_another_record(quiet: NDArray[np.float64]) -> None:
    assert not np.allclose(quiet, recorded(replace(QUIET, seed=2)))


def test_blocks_follow_each_other_without_a_gap() -> None:
    blocks = list(tower(replace(QUIET, duration=10.3, start_ns=5 * NANOSECONDS, session="night")))
    assert [block.sequence for block in blocks] == list(range(11))
    assert [len(block.samples) for block in blocks] == [40] * 10 + [12]
    assert blocks[0].start_ns == 5 * NANOSECONDS
    for before, after in pairwise(blocks):
        assert after.start_ns == before.end_ns
        assert after.first_sample == before.first_sample + len(before.samples)
    assert {block.session for block in blocks} == {"night"}
    first: AccelerationBlock = blocks[0]
    assert (first.turbine, first.unit, first.layout_id) == ("iea15mw", "tower", "biaxial-4")
    assert first.samples.dtype == np.float32
    assert first.samples.shape == (40, 8)


def test_a_day_is_simulated_as_it_is_asked_for() -> None:
    """The first block of 24 h comes without the rest: memory is flat in the duration."""
    blocks = iter(tower(replace(QUIET, duration=86_400.0)))
    assert next(blocks).sequence == 0


def test_noise_is_white_and_three_percent_of_each_channels_rms() -> None:
    settings = replace(SHORT, duration=100.0, quantisation_step=0.0)
    noise = recorded(settings) - recorded(replace(settings, noise_share=0.0))
    share = noise.std(axis=0) / tower().stationary_rms()
    assert share == pytest.approx(np.full(8, 0.03), rel=4 / np.sqrt(2 * 4000))
    lagged = np.mean(noise[1:] * noise[:-1], axis=0) / noise.var(axis=0)
    assert np.abs(lagged).max() < 4 / np.sqrt(4000)  # white, and the loads' draws are the same


def test_samples_are_counts_of_a_16_bit_converter_over_8_m_per_second_squared(
    short: NDArray[np.float64],
) -> None:
    counts = short / SHORT.quantisation_step
    np.testing.assert_array_equal(counts, np.round(counts))
    assert SHORT.quantisation_step * 2**16 == 16.0
    assert np.abs(counts).max() < 2**15
    quietest = tower().stationary_rms().min()
    assert SHORT.quantisation_step / np.sqrt(12) < 0.01 * 0.03 * quietest  # far below the noise


def test_the_truth_is_the_stiffness_that_was_asked_for() -> None:
    simulated = tower(replace(SHORT, stiffness_ratios=(0.9, 1.1, 1.05)))
    np.testing.assert_allclose(simulated.truth.stiffness, TURBINE.nominal * [0.9, 1.1, 1.05])
    nominal = tower().modes.frequencies
    assert not np.allclose(simulated.modes.frequencies[:10], nominal[:10], rtol=1e-4)


def test_the_transient_is_the_beginning_that_is_dropped(quiet: NDArray[np.float64]) -> None:
    started = recorded(replace(QUIET, transient=0.0))
    np.testing.assert_array_equal(started[200:], quiet[:600])


def test_a_load_in_one_direction_moves_the_tower_in_that_direction_only() -> None:
    along = replace(
        SHORT,
        broadband=BroadbandLoad(tower_rms=0.0, blade_rms=0.0),
        waves=WaveBandLoad(side_side_rms=0.0),
        quantisation_step=0.0,
    )
    rms = tower(along).stationary_rms()
    assert rms[4:].max() < 1e-7 * rms[:4].min()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"duration": 0.0}, "duration is 0"),
        ({"block_duration": 0.0}, r"block_duration is 0; it must be positive"),
        ({"noise_share": -0.1}, "noise_share is -0.1"),
        ({"seed": -1}, "seed is -1"),
    ],
)
def test_settings_that_cannot_be_are_refused_with_their_value(
    wrong: dict[str, float], message: str
) -> None:
    with pytest.raises(SimulationError, match=message):
        replace(SHORT, **wrong)


def test_a_truth_that_is_not_positive_definite_is_refused() -> None:
    with pytest.raises(SimulationError, match=r"0.3, 0.3, 2.*positive definite"):
        tower(replace(SHORT, stiffness_ratios=(0.3, 0.3, 2.0)))


def test_a_tower_without_any_load_is_refused() -> None:
    silent = replace(
        SHORT,
        broadband=BroadbandLoad(tower_rms=0.0, blade_rms=0.0),
        waves=WaveBandLoad(fore_aft_rms=0.0, side_side_rms=0.0),
    )
    with pytest.raises(SimulationError, match="every load is 0 N"):
        tower(silent)


def test_an_accelerometer_above_the_tower_is_refused() -> None:
    high = biaxial_layout("high", turbine="iea15mw", unit="tower", elevations=(150.0,))
    with pytest.raises(TurbineError, match="150 m"):
        SimulatedTower(TURBINE, high, SHORT)


def test_chunks_of_any_length_become_blocks_of_one_length() -> None:
    stream = np.arange(23, dtype=np.float32)[:, None]
    blocks = list(split_into_blocks(iter(np.split(stream, [1, 2, 9, 9, 20])), 5))
    assert [len(block) for block in blocks] == [5, 5, 5, 5, 3]
    np.testing.assert_array_equal(np.concatenate(blocks), stream)


def test_trimming_takes_exactly_the_asked_samples() -> None:
    stream = np.arange(30.0)[:, None]
    kept = list(trim(iter(np.split(stream, [4, 9, 15])), first=6, count=11))
    np.testing.assert_array_equal(np.concatenate(kept).ravel(), np.arange(6.0, 17.0))


@pytest.mark.parametrize("coupling", [{}, {"coupling": "ac", "corner_frequency": 0.1}])
def test_the_modes_that_are_sensed_are_those_of_the_updaters_model(
    coupling: dict[str, object],
) -> None:
    """Another assembly, another eigensolver, real modes: all that the sensors see below 12.5 Hz."""
    axes = layout(**coupling)
    sensed = sensed_modes(SimulatedTower(TURBINE, axes, SHORT))
    known = ModalModel(TURBINE, axes).modal(TURBINE.nominal)
    apart = np.abs(sensed.frequencies[:, None] / known.frequencies[0] - 1.0)
    nearest = apart.argmin(axis=0)
    assert apart.min(axis=0).max() < 2e-3  # twice the tube elements
    mac = modal_assurance_criterion(sensed.shapes[nearest], known.shapes[0])
    assert mac.diagonal().min() > 0.999


def test_axes_off_by_ninety_degrees_sense_the_other_direction() -> None:
    straight, turned = (
        sensed_modes(tower(replace(SHORT, instruments=Instruments(misalignment=(angle,) * 8))))
        for angle in (0.1, 90.1)
    )
    fore_aft, side_side = straight.shapes[:, :4], straight.shapes[:, 4:]
    scale = np.abs(straight.shapes).max()
    np.testing.assert_allclose(turned.shapes[:, :4], side_side, atol=1e-9 * scale)
    np.testing.assert_allclose(turned.shapes[:, 4:], -fore_aft, atol=1e-9 * scale)


def test_the_foundation_changes_at_the_instant_of_an_event(
    quiet: NDArray[np.float64], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the middle of what is integrated at a time as at a beginning of it, and not before."""
    scour = FoundationSchedule(events=(StiffnessEvent(10.0, (0.5, 0.5, 0.5)),))
    without, changed = quiet, recorded(replace(QUIET, foundation=scour))
    close = 1e-5 * without.std()
    spread = 1.3  # half length of the converter's filter [s]
    before, after = slice(0, round((10.0 - spread) * 40)), slice(round((10.0 + spread) * 40), 800)
    np.testing.assert_allclose(changed[before], without[before], rtol=0, atol=close)
    assert np.abs(changed[after] - without[after]).max() > 0.1 * without.std()
    monkeypatch.setattr("sensors.simulation.tower.CHUNK_DURATION", 15.0)  # from 5 s before 0
    at_a_beginning = recorded(replace(QUIET, foundation=scour))
    np.testing.assert_allclose(changed, at_a_beginning, rtol=0, atol=close)


@pytest.mark.parametrize(("rate", "size"), [(12.5, 12), (62.5, 62), (33.3, 33), (0.5, 1)])
def test_a_rate_without_a_whole_number_of_samples_a_second_has_blocks_of_about_one(
    rate: float, size: int
) -> None:
    """At low rates the converter's filter lags by more than a minute."""
    blocks = list(tower(replace(SHORT, sampling_rate=rate)))
    assert [len(block.samples) for block in blocks[:-1]] == [size] * (len(blocks) - 1)
    assert sum(len(block.samples) for block in blocks) == round(20.0 * rate)
    begins = [(block.start_ns - blocks[0].start_ns) / NANOSECONDS for block in blocks]
    assert begins == pytest.approx(np.arange(len(blocks)) * size / rate, abs=1e-9)
