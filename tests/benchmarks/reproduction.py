"""The publication's example over many seeds: what one draw of the measurement cannot say.

    python -m tests.benchmarks reproduction [--seeds 20] [--first-seed 101] [--samples 5000]
        [--sign published|embedded-pile]

Each seed is one window of the scenario `paper`, its modes taken by label where they were found:
Table 2's MAP errors, Figure 3's correlations and peaks, and where Nelder and Mead's simplex ends.
"""

import argparse
from collections.abc import Sequence

import numpy as np

from pipeline.reproduction.example import Example
from pipeline.reproduction.study import (
    found_counts,
    lowest_start,
    map_errors,
    n_peaks,
    run_study,
)
from sensors.arrays import FloatArray
from sensors.structure.foundation import SPRING_SIGNS


def main(arguments: list[str]) -> None:
    """Run the seeds in two processes and print the medians."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks reproduction")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=101)
    parser.add_argument("--samples", type=int, default=5_000, help="of TMCMC, a stage")
    parser.add_argument("--sign", choices=SPRING_SIGNS, default="published")
    options = parser.parse_args(arguments)
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    study = run_study(seeds, signs=(options.sign,), samples=options.samples)
    print(f"{options.seeds} seeds from {options.first_seed}, {options.sign} sign")
    examples = study.examples
    print("found: " + ", ".join(f"{mode} {n}" for mode, n in found_counts(examples).items()))
    _print_posteriors(examples)
    _print_descents(examples)


def half_widths(draws: np.ndarray) -> np.ndarray:
    """Half widths of the 90 % intervals of k11, k22, k12 ÷ nominal, shape (3,) [-]."""
    low, high = np.quantile(draws[:, :3], [0.05, 0.95], axis=0)
    return np.asarray((high - low) / 2)


def _print_posteriors(examples: Sequence[Example]) -> None:
    errors = np.abs([map_errors(example) for example in examples])
    _print("|MAP error| median [%]", np.median(errors, axis=0))
    _print("|MAP error| largest [%]", errors.max(axis=0))
    for name in ("published", "corrected"):
        posteriors = [getattr(example, name) for example in examples]
        _print(
            f"{name}: half width of the 90 % interval, median [%]",
            100.0 * np.median([half_widths(p.draws) for p in posteriors], axis=0),
        )
        _print(f"{name}: covers", np.sum([p.covers for p in posteriors], axis=0))
        correlations = np.array([p.correlations for p in posteriors])
        _print(f"{name}: correlations, median", np.median(correlations, axis=0))
        _print(f"{name}: correlations, least", correlations.min(axis=0))
        print(f"{name}: peaks {sorted(n_peaks(p) for p in posteriors)}")
    wider = [e.published.stds / e.corrected.stds - 1 for e in examples]
    _print("std of TMCMC as published above the corrected, median [%]", 100.0 * np.median(wider, 0))


def _print_descents(examples: Sequence[Example]) -> None:
    print(f"J(K0) median {np.median([e.objective_at_truth for e in examples]):.4f}")
    for place, descent in enumerate(examples[0].descents):
        ends = [example.descents[place] for example in examples]
        errors = np.median([np.abs(100.0 * (end.end - 1)) for end in ends], axis=0)
        least = np.median([end.objective for end in ends])
        _print(f"from γ = {descent.start[0]:g}: J median {least:.4f}, |error| median [%]", errors)
    starts, counts = np.unique([lowest_start(e) for e in examples], return_counts=True)
    pairs = zip(starts, counts, strict=True)
    print("lowest end: " + ", ".join(f"γ = {g:g} in {n}" for g, n in pairs))


def _print(title: str, values: FloatArray) -> None:
    print(f"{title}: " + "  ".join(f"{value:.3g}" for value in values))
