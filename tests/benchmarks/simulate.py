"""What simulating costs, beside SciPy's integrator on the same modal model.

python -m tests.benchmarks simulate [--hours H] [--scenario parked]

The processor's time is that of both threads: one makes the loads, the other integrates.
"""

import argparse
import resource
import time
from dataclasses import replace

import numpy as np
from scipy.signal import lsim

from pipeline.scenario import load_scenario
from sensors.layout import SensorLayout, biaxial_layout
from sensors.loads import BroadbandLoad, WaveBandLoad, random_loads
from sensors.simulated import LOWEST_INTEGRATION_RATE, SimulatedTower
from sensors.turbine.assembly import assemble
from sensors.turbine.description import TurbineDescription, load_turbine
from sensors.turbine.response import AccelerationResponse, FloatArray
from sensors.turbine.structure_modes import (
    ModalDamping,
    ObservedModes,
    observed_modes,
    structure_modes,
)

ELEVATIONS = (41.0, 80.0, 106.0, 145.0)  # [m]
LSIM_DURATION = 30.0  # [s]; what it takes is proportional


def main(arguments: list[str]) -> None:
    """Print CPU time and memory of a simulation, and of its integration by scipy.signal.lsim."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks simulate")
    parser.add_argument(
        "--hours", type=float, default=1.0, help="simulated time, 8 channels, 40 Hz"
    )
    parser.add_argument("--scenario", default="parked", help="the environment to simulate")
    options = parser.parse_args(arguments)
    hours, scenario = options.hours, load_scenario(options.scenario)
    description = load_turbine("iea15mw_monopile")
    layout = biaxial_layout("tower", turbine="iea15mw", unit="tower", elevations=ELEVATIONS)
    settings = replace(scenario.simulation, duration=3600.0 * hours, seed=scenario.seed)
    start, clock = time.process_time(), time.perf_counter()
    blocks = sum(1 for _ in SimulatedTower(description, layout, settings))
    cpu, wall = time.process_time() - start, time.perf_counter() - clock
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        f"{scenario.name}: {hours:g} h of 8 channels at 40 Hz, {blocks} blocks: "
        f"{cpu:.1f} s CPU, {wall:.1f} s wall"
    )
    print(f"per simulated hour {cpu / hours:.2f} s CPU; peak memory {memory:.0f} MB")
    _print_integration(_modal_model(description, layout))


def _print_integration(modes: ObservedModes) -> None:
    """The integration alone, the same forces through this package and through lsim."""
    rate = LOWEST_INTEGRATION_RATE
    n = round(LSIM_DURATION * rate)
    forces = np.random.default_rng(1).standard_normal((n, modes.participation.shape[1]))
    forces[0] = 0.0
    start = time.process_time()
    ours = AccelerationResponse(modes, rate).advance(forces)
    own_time = time.process_time() - start
    start = time.process_time()
    _, theirs, _ = lsim(_state_space(modes), forces, np.arange(n) / rate, interp=True)
    lsim_time = time.process_time() - start
    difference = np.abs(ours - theirs).max() / np.abs(theirs).max()
    print(f"integration of {len(modes.frequencies)} modes, CPU per simulated hour:")
    print(f"  exact recursion {own_time * 3600 / LSIM_DURATION:8.2f} s")
    print(
        f"  lsim            {lsim_time * 3600 / LSIM_DURATION:8.2f} s, {lsim_time / own_time:.0f} x"
    )
    print(f"  largest difference {difference:.1e} of the largest reading")


def _modal_model(description: TurbineDescription, layout: SensorLayout) -> ObservedModes:
    model = assemble(description, tube_refinement=2)
    loads = random_loads(
        model,
        broadband=BroadbandLoad(),
        waves=WaveBandLoad(),
        sampling_rate=LOWEST_INTEGRATION_RATE,
    )
    distribution = np.concatenate([load.distribution for load in loads], axis=1)
    modes = structure_modes(model, ModalDamping(), highest_frequency=0.5 * LOWEST_INTEGRATION_RATE)
    return observed_modes(model, modes, layout, distribution)


def _state_space(modes: ObservedModes) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """(A, B, C, D) of the same modes, state (q, q'), output u'' − g ψ."""
    omega = 2 * np.pi * modes.frequencies
    n = len(omega)
    spring, damper = np.diag(-(omega**2)), np.diag(-2 * modes.damping_ratios * omega)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [spring, damper]])
    B = np.concatenate([np.zeros_like(modes.participation), modes.participation])
    tilt = modes.gravity * modes.rotation
    C = np.concatenate([modes.displacement @ spring - tilt, modes.displacement @ damper], axis=1)
    return A, B, C, modes.displacement @ modes.participation
