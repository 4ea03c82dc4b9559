"""How fast and how exact the reduced modal model is, against the whole one.

python -m tests.benchmarks modal [--draws N] [--sign published|embedded-pile] [--keep]
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
from scipy.linalg import eigh

from sensors.acquisition.layout import biaxial_layout
from sensors.dynamics.modal_model import ModalModel, ModalParameters, full_modes
from sensors.structure.assembly import assemble
from sensors.structure.description import TurbineDescription, load_turbine
from sensors.structure.foundation import SPRING_SIGNS
from tests.benchmarks._results import keep

PRIOR_BOX = (0.25, 4.0)  # of the nominal stiffness, [foundation-updating] §4.2
ELEVATIONS = (41.0, 80.0, 106.0, 145.0)  # [m]


def main(arguments: list[str]) -> None:
    """Print CPU time per θ and errors over admissible draws of the prior box."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks modal")
    parser.add_argument("--draws", type=int, default=300, help="admissible draws of the prior box")
    parser.add_argument("--sign", choices=SPRING_SIGNS, default="published")
    parser.add_argument("--keep", action="store_true", help="write the result")
    options = parser.parse_args(arguments)
    description = load_turbine("iea15mw_monopile").with_sign(options.sign)
    layout = biaxial_layout("tower", turbine="iea15mw", unit="tower", elevations=ELEVATIONS)
    every = ModalModel(description, layout)
    eleven = every.subset([mode.name for mode in description.reference_modes])
    theta = admissible_draws(every, options.draws, seed=1)
    dense = _dense_microseconds(description, theta[:8])
    print(f"dense eigen-solution of the whole model   {dense:8.0f} µs per θ")
    costs = {}
    for name, model in (("the reference modes", eleven), ("every visible mode", every)):
        cost = costs[name] = _microseconds(lambda model=model: model.modal(theta), len(theta))
        print(f"{name:22} {len(model.labels):3d} modes      {cost:8.0f} µs per θ", end="")
        print(f"   1/{dense / cost:.0f} of the dense one")
    frequency_error, shape_error = errors_against_whole(description, every, theta)
    print(f"largest errors over {len(theta)} admissible draws of {PRIOR_BOX} × nominal:")
    print(f"  frequency {frequency_error:.1e}   1 − MAC {shape_error:.1e}")
    if options.keep:
        keep(
            "modal",
            {
                "draws": len(theta),
                "modes": len(every.labels),
                "whole_over_eleven": round(dense / costs["the reference modes"]),
                "whole_over_visible": round(dense / costs["every visible mode"]),
                "frequency_error": frequency_error,
                "shape_error": shape_error,
            },
            command=f"python -m tests.benchmarks modal --draws {options.draws}",
            seeds=(1,),
            depends=("sensors/dynamics", "sensors/structure"),
        )


def admissible_draws(model: ModalModel, count: int, *, seed: int) -> np.ndarray:
    """(count, 3) draws of θ, uniform over the admissible part of the prior box."""
    generator = np.random.default_rng(seed)
    theta = generator.uniform(*PRIOR_BOX, size=(4 * count, 3)) * model.nominal
    return theta[model.admissible(theta)][:count]


def errors_against_whole(
    description: TurbineDescription, model: ModalModel, theta: np.ndarray
) -> tuple[float, float]:
    """Largest relative frequency error and largest 1 − MAC over all modes and foundations.

    Each mode is compared with the nearest in frequency of the whole model's modes that have its
    shape (MAC > 0.9).
    """
    parameters = model.modal(theta)
    worst_frequency = worst_shape = 0.0
    for row, one in enumerate(theta):
        whole = full_modes(description, model.layout, one, highest_frequency=30.0)
        frequency, shape = _row_errors(parameters, row, whole.frequencies, whole.shapes)
        worst_frequency, worst_shape = max(worst_frequency, frequency), max(worst_shape, shape)
    return worst_frequency, worst_shape


def _row_errors(
    parameters: ModalParameters, row: int, frequencies: np.ndarray, shapes: np.ndarray
) -> tuple[float, float]:
    mine = parameters.shapes[row]
    products = (mine @ shapes.T) ** 2
    mac = products / np.outer((mine**2).sum(axis=1), (shapes**2).sum(axis=1))
    distance = np.abs(frequencies / parameters.frequencies[row][:, None] - 1)
    distance[mac < 0.9] = np.inf
    nearest = distance.argmin(axis=1)
    modes = np.arange(len(mine))
    return float(distance[modes, nearest].max()), float((1 - mac[modes, nearest]).max())


def _dense_microseconds(description: TurbineDescription, theta: np.ndarray) -> float:
    """CPU time of one eigen-solution of all the model's degrees of freedom [µs]."""
    model = assemble(description)

    def solve() -> None:
        for one in theta:
            eigh(model.on_springs(one).stiffness, model.mass)

    return _microseconds(solve, len(theta))


def _microseconds(work: Callable[[], object], count: int, repeats: int = 15) -> float:
    """Smallest CPU time of a few repeats, per item [µs]; the first, cold run is left out."""
    work()
    times = []
    for _ in range(repeats):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times) / count * 1e6
