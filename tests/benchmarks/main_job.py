"""What the first command of the README takes: an hour of the shipped recording.

python -m tests.benchmarks main_job [--keep]

CPU time is that of all its processes.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.benchmarks._results import ROOT, keep


def main(arguments: list[str]) -> None:
    """Print wall time, CPU time and whether the intervals hold the truth."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks main_job")
    parser.add_argument("--keep", action="store_true", help="write the result")
    options = parser.parse_args(arguments)
    figures = run()
    print(figures)
    if options.keep:
        keep(
            "main-job",
            figures,
            command="python -m tests.benchmarks main_job",
            depends=("pipeline", "sensors"),
        )


def run() -> dict[str, float]:
    """Run it in an empty folder."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        before, began = os.times(), time.perf_counter()
        subprocess.run(
            [sys.executable, "-m", "pipeline", "run", "--out", str(out)],
            cwd=ROOT,
            check=True,
            stdout=subprocess.DEVNULL,
        )
        wall, after = time.perf_counter() - began, os.times()
        posterior = json.loads((out / "summary.json").read_text("utf-8"))["posterior"]
    springs = [posterior[name] for name in ("k11", "k22", "k12")]
    return {
        "wall_s": round(wall, 1),
        "cpu_s": round(
            after.children_user
            + after.children_system
            - before.children_user
            - before.children_system,
            1,
        ),
        "springs_that_hold": sum(
            each["ratio_p05"] < each["truth_ratio"] < each["ratio_p95"] for each in springs
        ),
    }
