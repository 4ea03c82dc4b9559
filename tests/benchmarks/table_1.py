"""The model's eleven frequencies against the publication's Table 1.

python -m tests.benchmarks table_1
"""

import numpy as np

from pipeline.reproduction.paper import LABELS, TABLE_1
from pipeline.scenario import load_scenario
from sensors.dynamics.modal_model import ModalModel
from tests.benchmarks._results import keep

COMMAND = "python -m tests.benchmarks table_1"


def main(_: list[str]) -> None:
    """Print the differences and keep the result."""
    scenario = load_scenario("paper")
    model = ModalModel(scenario.structure, scenario.layout)
    ours = model.subset(LABELS).modal(model.nominal[None]).frequencies[0]
    printed = np.array([mode.model_frequency for mode in TABLE_1])
    apart = 100 * (ours / printed - 1)
    for label, frequency, percent in zip(LABELS, ours, apart, strict=True):
        print(f"mode {label:2s} {frequency:8.4f} Hz  {percent:+.2f} %")
    figures = {
        "worst": round(float(np.abs(apart).max()), 2),
        "rms": round(float(np.sqrt(np.mean(apart**2))), 2),
        "first_two": round(float(np.abs(apart[:2]).max()), 3),
    }
    print(keep("table-1", figures, command=COMMAND,
               depends=("sensors/dynamics", "sensors/structure")))  # fmt: skip
