"""How often each mode of the simulated tower is found in ten minutes of a scenario.

    python -m tests.benchmarks scenarios [--scenario paper-linear paper] [--seeds 20]
        [--first-seed 101] [--above 0.4]

Each seed is one window, identified blind. A mode counts as found where an identified one
lies within 2 % of the model's frequency at the true stiffness and has a MAC of .9 or more with its
shape; each identified mode is taken for one at most. `--above` takes everything below a frequency
off the record first: what the sea's own response costs the weak modes beside it.
"""

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.signal import butter, sosfiltfilt

from pipeline.messages import Mode
from pipeline.modal_shapes import modal_assurance_criterion
from pipeline.oma.identification import identify
from pipeline.scenario import Scenario, load_scenario
from pipeline.sources import simulated_tower
from sensors.turbine.modal import ModalModel, ModalParameters

FloatArray = NDArray[np.float64]

LEAST_MAC = 0.9  # between an identified and a true shape [-]
NEAR = 0.02  # relative distance of frequencies [-]


def main(arguments: list[str]) -> None:
    """Print a table: modes down, scenarios across, windows that found the mode."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks scenarios")
    parser.add_argument("--scenario", nargs="+", default=["paper-linear", "paper"])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=101)
    parser.add_argument("--above", type=float, default=0.0, help="high-pass the record [Hz]")
    options = parser.parse_args(arguments)
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    columns = {
        name: found_modes(load_scenario(name), seeds, above=options.above)
        for name in options.scenario
    }
    print(f"of {options.seeds} windows of 600 s, seeds {seeds[0]} to {seeds[-1]}")
    print("mode   model Hz" + "".join(f"{name:>16s}" for name in columns))
    first = next(iter(columns.values()))
    for label, frequency in first.frequencies.items():
        found = "".join(f"{column.counts[label]:16d}" for column in columns.values())
        print(f"{label:5s} {frequency:9.4f}{found}")
    rows = {"others of the model": "others", "identified, of no true mode": "spurious"}
    for words, name in rows.items():
        print(f"{words:28s}" + "  ".join(f"{getattr(c, name):6.1f}" for c in columns.values()))


class Found:
    """How often each of the published modes was found in a scenario's windows."""

    def __init__(self, truth: ModalParameters, labels: tuple[str, ...]) -> None:
        published = [label for label in labels if label.isdigit() and int(label) <= 11]
        self.frequencies = {k: float(truth.frequencies[0, labels.index(k)]) for k in published}
        self.counts: Counter[str] = Counter()
        self.others = 0.0  # other true modes found, mean over windows
        self.spurious = 0.0  # identified modes that are none of the true ones, mean


def found_modes(scenario: Scenario, seeds: Sequence[int], *, above: float = 0.0) -> Found:
    """Identify one window for each seed, of what lies above a frequency [Hz]."""
    model = ModalModel(scenario.structure, scenario.layout)
    truth = model.modal(scenario.structure.nominal * scenario.simulation.stiffness_ratios)
    found = Found(truth, model.labels)
    window = scenario.oma.window_duration
    for seed in seeds:
        simulation = replace(scenario.simulation, duration=window)
        tower = simulated_tower(replace(scenario, seed=seed, simulation=simulation))
        samples = np.concatenate(list(tower.samples())).astype(np.float64)
        if above > 0:
            samples = high_passed(samples, above, scenario.simulation.sampling_rate)
        modes = identify(samples, scenario.simulation.sampling_rate, scenario.oma).modes
        labels = matched(modes, truth, model.labels)
        found.counts.update(labels)
        found.others += len([label for label in labels if label not in found.frequencies]) / len(
            seeds
        )
        found.spurious += (len(modes) - len(labels)) / len(seeds)
    return found


def high_passed(samples: FloatArray, corner: float, sampling_rate: float) -> FloatArray:
    """Without what lies below a corner frequency [Hz]; both ways, so that no phase is turned."""
    sections = butter(6, corner, "highpass", fs=sampling_rate, output="sos")
    return np.asarray(sosfiltfilt(sections, samples, axis=0))


def matched(modes: tuple[Mode, ...], truth: ModalParameters, labels: tuple[str, ...]) -> list[str]:
    """Labels of the true modes that were identified, each identified mode taken once."""
    if not modes:
        return []
    frequencies = np.array([mode.frequency for mode in modes])
    apart = np.abs(frequencies[:, None] / truth.frequencies[0] - 1.0) / NEAR
    mac = modal_assurance_criterion(np.array([mode.shape for mode in modes]), truth.shapes[0])
    cost = np.where((apart < 1.0) & (mac > LEAST_MAC), apart + (1.0 - mac), 1e3)
    pairs = zip(*linear_sum_assignment(cost), strict=True)
    return [labels[j] for i, j in pairs if cost[i, j] < 1e3]
