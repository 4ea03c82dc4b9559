"""A peer on the records of `structures`: pyOMA-2's SSI-cov with its automatic clustering.

    python -m tests.benchmarks structures_pyoma2 [--first-seed 165001] [--records 60] [--keep]

Covariance-driven SSI of 50 block rows at the record's rate, orders 2 to 50 in steps of 2, poles
clustered by its preset `Kvaale`: of its presets, on six other records (seeds 160001 to 160006), the
one with the fewest invented modes among those that missed an eighth or less and stayed within three
attainable std.
"""

from dataclasses import replace

import numpy as np

from pipeline.messages import Mode
from sensors.arrays import FloatArray
from tests.benchmarks._results import keep
from tests.benchmarks._seeded import seeded_options, seeds_of
from tests.benchmarks.structures import draw, figures, judge

BLOCK_ROWS, HIGHEST_ORDER, PRESET = 50, 50, "Kvaale"


def pyoma2_modes(samples: FloatArray, sampling_rate: float) -> list[Mode]:
    """Modes of a record; nothing is said about their std."""
    from pyoma2.algorithms import SSI
    from pyoma2.algorithms.data.run_params import Clustering
    from pyoma2.setup.single import SingleSetup

    setup = SingleSetup(samples, fs=sampling_rate)
    ssi = SSI(name="ssi", method="cov", br=BLOCK_ROWS, ordmin=2, ordmax=HIGHEST_ORDER, step=2)
    setup.add_algorithms(ssi)
    setup.run_by_name("ssi")
    ssi.add_clustering(Clustering(name=PRESET, quick=PRESET))
    ssi.run_clustering(PRESET)
    found = ssi.result.clustering_results[PRESET]
    frequencies, damping = np.atleast_1d(found.Fn), np.atleast_1d(found.Xi)
    shapes = np.real(np.atleast_2d(np.asarray(found.Phi).T))
    return [
        _mode(float(f), float(zeta), shape)
        for f, zeta, shape in zip(frequencies, damping, shapes[: len(frequencies)], strict=True)
    ]


def _mode(frequency: float, damping_ratio: float, shape: FloatArray) -> Mode:
    largest = shape[np.argmax(np.abs(shape))]
    factor = np.zeros((2 + len(shape), 1))
    return Mode("", frequency, 0.0, damping_ratio, 0.0, shape / largest, factor, 0)


def main(arguments: list[str]) -> None:
    """Print the figures that need no std, and keep them where asked."""
    options = seeded_options("structures_pyoma2", first_seed=165_001, records=60).parse_args(
        arguments
    )
    structures, judged = [], []
    for seed in seeds_of(options):
        structure = draw(seed)
        judged.append(judge(structure, pyoma2_modes(structure.samples, structure.sampling_rate)))
        structures.append(replace(structure, samples=structure.samples[:, :0]))
    found = figures(structures, judged)
    found = {name: value for name, value in found.items() if not name.startswith("cover")}
    for name, value in found.items():
        print(f"{name:20s} {value:.4g}")
    if options.keep:
        keep(
            "structures-pyoma2",
            found,
            command="python -m tests.benchmarks structures_pyoma2 "
            f"--first-seed {options.first_seed} --records {options.records} --keep",
            seeds=seeds_of(options),
            depends=("tests/benchmarks/structures.py", "tests/benchmarks/structures_pyoma2.py"),
        )
