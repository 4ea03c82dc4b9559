"""How often each mode of the simulated tower is found in one window of a scenario, and what whole
sessions of a scenario say over many seeds.

    python -m tests.benchmarks scenarios [--scenario paper-linear paper] [--seeds 20]
        [--first-seed 101] [--duration 600] [--wave-height 3.5] [--blade-rms 6e3] [--above 0.5]
    python -m tests.benchmarks scenarios --sessions [--scenario bad-sensors] [--seeds 20]

Each seed is one window, identified blind. A mode counts as found where an identified one
lies within 2 % of the simulated structure's frequency and has a MAC of .9 or more with its shape
as the accelerometers read it; each identified mode is taken for one at most. What is identified
besides is a mixture of two modes of the structure, or of nothing. `--above` takes everything below
a frequency off the record first: what the sea's own response costs the weak modes beside it.

With `--sessions` every seed is a whole session: how often the last posterior's 90 % intervals hold
the truth, and which of the scenario's faults were named.
"""

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.signal import butter, sosfiltfilt

from pipeline.messages import Mode
from pipeline.modal_assurance import complex_normalised, modal_assurance_criterion
from pipeline.oma.identification import identify
from pipeline.scenario import Scenario, load_scenario
from pipeline.sources.sources import simulated_tower
from sensors.arrays import FloatArray
from sensors.dynamics.modal_model import ModalModel
from tests.benchmarks._sessions import print_sessions
from tests.sensors.simulation.sensed_modes import SensedModes, sensed_modes

LEAST_MAC = 0.9  # between an identified and a true shape [-]
NEAR = 0.02  # relative distance of frequencies [-]
LEAST_SHARE = 0.95  # of a mixture's shape that two neighbours span [-]
PUBLISHED = tuple(str(number) for number in range(1, 12))  # [foundation-updating] Table 1


def main(arguments: list[str]) -> None:
    """Print a table: modes down, scenarios across, windows that found the mode."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks scenarios")
    parser.add_argument("--scenario", nargs="+")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=101)
    parser.add_argument("--sessions", action="store_true", help="whole sessions, not one window")
    parser.add_argument("--duration", type=float, help="of the window [s]")
    parser.add_argument("--wave-height", type=float, help="Hs of the sea [m]")
    parser.add_argument("--blade-rms", type=float, help="broadband load on each blade [N]")
    parser.add_argument("--above", type=float, default=0.0, help="high-pass the record [Hz]")
    options = parser.parse_args(arguments)
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    if options.sessions:
        print_sessions(options.scenario or ["bad-sensors"], seeds)
        return
    columns = {}
    for name in options.scenario or ["paper-linear", "paper"]:
        scenario = changed(
            load_scenario(name),
            duration=options.duration,
            wave_height=options.wave_height,
            blade_rms=options.blade_rms,
        )
        columns[name] = found_modes(scenario, seeds, above=options.above)
    print_found(columns, seeds)


def changed(
    scenario: Scenario,
    *,
    duration: float | None = None,
    wave_height: float | None = None,
    blade_rms: float | None = None,
) -> Scenario:
    """One window of the scenario, with another length [s], sea [m] or load on the blades [N]."""
    simulation = scenario.simulation
    window = scenario.oma.window_duration if duration is None else duration
    if wave_height is not None and simulation.sea is not None:
        sea = replace(simulation.sea, significant_wave_height=wave_height)
        simulation = replace(simulation, sea=sea)
    if blade_rms is not None:
        broadband = replace(simulation.broadband, blade_rms=blade_rms)
        simulation = replace(simulation, broadband=broadband)
    return replace(
        scenario,
        simulation=replace(simulation, duration=window),
        oma=replace(scenario.oma, window_duration=window, hop=window),
    )


@dataclass(slots=True)
class Found:
    """What was identified in a scenario's windows."""

    frequencies: dict[str, float]  # of the published modes [Hz]
    n_windows: int = 0
    counts: Counter[str] = field(default_factory=Counter)  # windows, by published mode
    others: int = 0  # further modes of the structure
    mixtures: int = 0  # of two neighbours
    spurious: int = 0  # of nothing

    def add(self, modes: Sequence[Mode], truth: SensedModes, labels: Sequence[str]) -> None:
        """The modes of one more window. labels: of the true modes, "" where not published."""
        taken = matched(modes, truth)
        names = [labels[true] for true in taken.values()]
        self.n_windows += 1
        self.counts.update(name for name in names if name)
        self.others += names.count("")
        for number, mode in enumerate(modes):
            if number not in taken:
                mixed = is_mixture(mode, truth)
                self.mixtures += mixed
                self.spurious += not mixed


def found_modes(scenario: Scenario, seeds: Sequence[int], *, above: float = 0.0) -> Found:
    """Identify one window for each seed, of what lies above a frequency [Hz]."""
    rate = scenario.simulation.sampling_rate
    found: Found | None = None
    for seed in seeds:
        tower = simulated_tower(replace(scenario, seed=seed))
        truth = sensed_modes(tower)
        labels = published_labels(scenario, truth)
        if found is None:
            frequencies = truth.frequencies.tolist()
            found = Found({k: f for k, f in zip(labels, frequencies, strict=True) if k})
        samples = np.concatenate(list(tower.samples())).astype(np.float64)
        if above > 0:
            samples = high_passed(samples, above, rate)
        found.add(identify(samples, rate, scenario.oma).modes, truth, labels)
    assert found is not None
    return found


def published_labels(scenario: Scenario, truth: SensedModes) -> list[str]:
    """For each true mode the label of the published one that it is, or ""."""
    model = ModalModel(scenario.structure, scenario.layout).subset(PUBLISHED)
    known = model.modal(scenario.structure.nominal * scenario.simulation.stiffness_ratios)
    pairs = pairing(known.frequencies[0], known.shapes[0], truth)
    labels = [""] * len(truth.frequencies)
    for published, true in pairs.items():
        labels[true] = PUBLISHED[published]
    return labels


def print_found(columns: dict[str, Found], seeds: Sequence[int]) -> None:
    print(f"of {len(seeds)} windows, seeds {seeds[0]} to {seeds[-1]}")
    print("mode   true Hz" + "".join(f"{name:>16s}" for name in columns))
    first = next(iter(columns.values()))
    for label in PUBLISHED:
        if label in first.frequencies:
            found = "".join(f"{column.counts[label]:16d}" for column in columns.values())
            print(f"{label:5s} {first.frequencies[label]:8.4f}{found}")
    rows = {
        "other modes": "others",
        "mixtures": "mixtures",
        "of nothing": "spurious",
    }
    for words, name in rows.items():
        means = (getattr(column, name) / column.n_windows for column in columns.values())
        print(f"{words:14s}" + "".join(f"{mean:16.2f}" for mean in means) + "  a window")


def high_passed(samples: FloatArray, corner: float, sampling_rate: float) -> FloatArray:
    """Without what lies below a corner frequency [Hz]; both ways, so that no phase is turned."""
    sections = butter(6, corner, "highpass", fs=sampling_rate, output="sos")
    return np.asarray(sosfiltfilt(sections, samples, axis=0))


def matched(modes: Sequence[Mode], truth: SensedModes) -> dict[int, int]:
    """Place of each identified mode that is a true one → place of the true one, each once."""
    if not modes:
        return {}
    frequencies = np.array([mode.frequency for mode in modes])
    return pairing(frequencies, np.array([mode.shape for mode in modes]), truth)


def pairing(frequencies: FloatArray, shapes: FloatArray, truth: SensedModes) -> dict[int, int]:
    """Which modes (n,), (n, n_channels) are which true ones: near in frequency and shape."""
    apart = np.abs(frequencies[:, None] / truth.frequencies - 1.0) / NEAR
    mac = modal_assurance_criterion(shapes, complex_normalised(truth.shapes))
    cost = np.where((apart < 1.0) & (mac >= LEAST_MAC), apart + (1.0 - mac), 1e3)
    pairs = zip(*linear_sum_assignment(cost), strict=True)
    return {int(i): int(j) for i, j in pairs if cost[i, j] < 1e3}


def is_mixture(mode: Mode, truth: SensedModes) -> bool:
    """Whether the shape is, but for a twentieth, a sum of those of the two nearest true modes, and
    the frequency near one of them."""
    nearest = np.argsort(np.abs(truth.frequencies - mode.frequency))[:2]
    if abs(mode.frequency / truth.frequencies[nearest[0]] - 1.0) > NEAR:
        return False
    basis, _ = np.linalg.qr(complex_normalised(truth.shapes[nearest]).T)
    share = np.sum((basis.T @ mode.shape) ** 2) / np.sum(mode.shape**2)
    return bool(share >= LEAST_SHARE)
