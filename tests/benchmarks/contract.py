"""Coverage and widths of the acceptance contract's cached hours, as figures.

python -m tests.benchmarks contract
"""

import numpy as np

from tests.acceptance.cached_day import HOURS, cached_day
from tests.acceptance.contract import NAMES, cases, of_day
from tests.benchmarks._results import keep

COMMAND = "python -m tests.benchmarks contract"
DEPENDS = ("pipeline/updating", "sensors/dynamics", "sensors/structure", "tests/acceptance/days")


def main(_: list[str]) -> None:
    """Print the table and keep the result."""
    for kind, settings in cases().items():
        posteriors = of_day(kind, settings)
        truths = np.array([hour.theta for hour in cached_day(kind)])
        springs = [[each.parameter(name) for name in NAMES] for each in posteriors]
        held = np.array(
            [
                [s.p05 <= k <= s.p95 for s, k in zip(row, true, strict=True)]
                for row, true in zip(springs, truths, strict=True)
            ]
        )
        widths = np.array([[(s.p95 - s.p05) / 2 / s.nominal for s in row] for row in springs])
        errors = np.array(
            [
                [abs(s.median / k - 1) for s, k in zip(row, true, strict=True)]
                for row, true in zip(springs, truths, strict=True)
            ]
        )
        figures: dict[str, float | int] = {"hours": HOURS}
        for index, name in enumerate(NAMES):
            figures[f"held_{name}"] = int(held[:, index].sum())
            figures[f"half_width_{name}"] = round(100 * float(np.median(widths[:, index])), 2)
            figures[f"error_{name}"] = round(100 * float(np.median(errors[:, index])), 2)
        print(kind, figures)
        print(keep(f"contract-{kind}", figures, command=COMMAND, depends=DEPENDS))
