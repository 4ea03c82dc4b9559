"""What simulating costs, beside SciPy's integrator on the same modal model.

python -m tests.benchmarks simulate [--hours 24] [--scenario parked paper] [--keep]

Eight channels at 40 Hz. The processor's time is that of all threads: each load is drawn in one of
its own while another integrates. SciPy's `lsim` gets the forces for nothing and integrates a short
stretch; what it takes is proportional.
"""

import argparse
import resource
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from scipy.signal import lsim

from pipeline.scenario import Scenario, load_scenario
from sensors.acquisition.layout import biaxial_layout
from sensors.arrays import FloatArray
from sensors.dynamics.damped_modes import DampedSystem
from sensors.simulation.tower import SimulatedTower
from sensors.structure.description import load_turbine
from tests.benchmarks._results import keep

T = TypeVar("T")

ELEVATIONS = (41.0, 80.0, 106.0, 145.0)  # [m]
LSIM_DURATION = 30.0  # [s]
DAY = 86400.0  # [s]


@dataclass(frozen=True, slots=True)
class Cost:
    """What a simulation took."""

    cpu: float  # per simulated day [s]
    wall: float  # per simulated day [s]
    memory: float  # the process' peak [MB]
    blocks: int


@dataclass(frozen=True, slots=True)
class Integration:
    """The same forces through this package's integrator and through lsim."""

    own: float  # CPU per simulated day [s]
    scipy: float  # CPU per simulated day [s]
    difference: float  # largest, over the largest reading [-]


def main(arguments: list[str]) -> None:
    """Print CPU time, wall time and memory of simulations, and lsim's time."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks simulate")
    parser.add_argument("--hours", type=float, default=24.0, help="simulated time")
    parser.add_argument("--scenario", nargs="+", default=["parked", "paper"])
    parser.add_argument("--keep", action="store_true", help="write the result")
    options = parser.parse_args(arguments)
    figures = {}
    for name in options.scenario:
        tower = eight_channels(load_scenario(name), duration=3600.0 * options.hours)
        cost, integration = simulation_cost(tower), integration_cost(tower)
        print(f"{name}: {options.hours:g} h of 8 channels at 40 Hz, {cost.blocks} blocks")
        print(f"  per simulated day {cost.cpu:6.1f} s CPU, {cost.wall:6.1f} s wall")
        print(f"  peak memory {cost.memory:.0f} MB")
        print(
            f"  of it, integration of {len(tower.modes.frequencies)} modes {integration.own:.1f} s"
        )
        print(f"  lsim on the same modal model, forces given: {integration.scipy:.0f} s CPU a day,")
        print(
            f"    {integration.scipy / integration.own:.0f} x the integration, "
            f"{integration.scipy / cost.cpu:.0f} x the whole simulation; largest difference "
            f"{integration.difference:.0e} of the largest reading"
        )
        figures[name] = {
            "cpu_s_a_day": round(cost.cpu, 1),
            "memory_gb": round(cost.memory / 1024, 2),
            "lsim_over_whole": round(integration.scipy / cost.cpu, 1),
        }
    if options.keep:
        keep(
            "simulate",
            {"hours": options.hours} | figures,
            command=f"python -m tests.benchmarks simulate --hours {options.hours:g}",
            depends=("sensors/simulation", "sensors/dynamics"),
        )


def eight_channels(scenario: Scenario, *, duration: float) -> SimulatedTower:
    """The scenario's tower for a duration [s]."""
    layout = biaxial_layout("tower", turbine="iea15mw", unit="tower", elevations=ELEVATIONS)
    settings = replace(scenario.simulation, duration=duration, seed=scenario.seed)
    return SimulatedTower(load_turbine("iea15mw_monopile"), layout, settings)


def simulation_cost(tower: SimulatedTower) -> Cost:
    """Of all its blocks."""
    days = tower.settings.duration / DAY
    clock = time.perf_counter()
    blocks, cpu = timed(lambda: sum(1 for _ in tower))
    wall = time.perf_counter() - clock
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return Cost(cpu / days, wall / days, memory, blocks)


def integration_cost(tower: SimulatedTower) -> Integration:
    """Of the modal model at the first sample under white forces."""
    rate = tower.settings.sampling_rate * tower.settings.decimation
    n, days = round(LSIM_DURATION * rate), LSIM_DURATION / DAY
    system = tower.system
    forces = np.random.default_rng(1).standard_normal((n, system.modes.participation.shape[1]))
    forces[0] = 0.0  # both begin at rest
    response = tower.response()
    ours, own = timed(lambda: response.advance(forces))
    space = state_space(system)
    (_, theirs, _), scipy = timed(lambda: lsim(space, forces, np.arange(n) / rate, interp=True))
    difference = np.abs(ours - theirs).max() / np.abs(theirs).max()
    return Integration(own / days, scipy / days, float(difference))


def timed(work: Callable[[], T]) -> tuple[T, float]:
    """What the work gives, and its CPU time [s]."""
    start = time.process_time()
    result = work()
    return result, time.process_time() - start


def state_space(system: DampedSystem) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """(A, B, C, D) of the undamped modes' coordinates q and q', output u'' − g ψ."""
    modes = system.modes
    n = len(modes.frequencies)
    spring = np.diag(-((2 * np.pi * modes.frequencies) ** 2))
    A = np.block([[np.zeros((n, n)), np.eye(n)], [spring, -system.damping]])
    B = np.concatenate([np.zeros_like(modes.participation), modes.participation])
    tilt = modes.gravity * modes.rotation
    C = np.concatenate(
        [modes.displacement @ spring - tilt, -modes.displacement @ system.damping], axis=1
    )
    return A, B, C, modes.displacement @ modes.participation
