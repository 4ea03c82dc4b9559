"""The main job under several Pythons, with the lowest and the newest versions that are allowed.

    python -m tests.matrix [--python 3.11 3.12 3.13 3.14] [--only lowest|newest]

Needs uv. Each environment gets the wheel of this tree, replays the shipped recording, and its last
posterior is held against the first environment's: medians within a tenth of a standard deviation,
widths within 3 %. The table is written to tests/benchmarks/results/matrix.json, each row with its
commit; an interpreter that cannot be had is a row that says so.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any

from tests.benchmarks._results import git, keep, kept

ROOT = Path(__file__).parents[1]
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
RESOLUTIONS = {"lowest": "lowest-direct", "newest": "highest"}
NAMES = ("k11", "k22", "k12")
SHOWN = ("numpy", "scipy", "eclipse-zenoh", "protobuf", "rerun-sdk", "typer")
MEDIAN_APART, WIDTH_APART = 0.1, 0.03  # of a std; relative
MINUTES = 15.0  # at most for one main job


def run(*command: object, cwd: Path = ROOT, timeout: float = 60 * MINUTES) -> str:
    """Return what a command prints. Raises RuntimeError with its last line."""
    clean = {name: each for name, each in os.environ.items() if name != "PYTHONPATH"}
    clean["OMP_NUM_THREADS"] = "1"
    ran = subprocess.run([str(each) for each in command], cwd=cwd, capture_output=True, text=True,
                         timeout=timeout, check=False, env=clean)  # fmt: skip
    if ran.returncode:
        lines = (ran.stderr.strip() or ran.stdout.strip()).splitlines()
        raise RuntimeError(lines[-1] if lines else f"exit code {ran.returncode}")
    return ran.stdout


def environment(uv: str, folder: Path, wheel: Path, python: str, resolution: str) -> Path:
    """Make an environment with the wheel; return its Python."""
    try:
        run(uv, "venv", "--quiet", "--python", python, folder)
    except RuntimeError as error:
        cause = str(error).strip().removeprefix("cause: ")
        raise RuntimeError(
            f"no Python {python} on this machine, and uv cannot fetch one ({cause})"
        ) from error
    interpreter = folder / "bin" / "python"
    with (ROOT / "pyproject.toml").open("rb") as file:
        direct = tomllib.load(file)["project"]["dependencies"]  # named, so that these are lowest
    run(uv, "pip", "install", "--quiet", "--python", interpreter,
        "--resolution", RESOLUTIONS[resolution], wheel, *direct)  # fmt: skip
    return interpreter


def posterior(interpreter: Path, cwd: Path) -> dict[str, Any]:
    """Run the main job in an empty folder; return its posterior."""
    cwd.mkdir()
    run(interpreter.with_name("pilewatch"), "run", cwd=cwd)
    summary = json.loads((cwd / "out" / "summary.json").read_text(encoding="utf-8"))
    return dict(summary["posterior"])


def verdict(ours: dict[str, Any], first: dict[str, Any]) -> str:
    """Return how far a posterior is from the first one."""
    medians, widths = [], []
    for name in NAMES:
        width = first[name]["p95"] - first[name]["p05"]
        medians.append(abs(ours[name]["median"] - first[name]["median"]) / (width / 3.29))
        widths.append(abs((ours[name]["p95"] - ours[name]["p05"]) / width - 1))
    same = max(medians) <= MEDIAN_APART and max(widths) <= WIDTH_APART
    figures = f"medians {max(medians):.2f} std, widths {100 * max(widths):.1f} % apart"
    return f"{'same' if same else 'DIFFERENT'}: {figures}"


def versions(uv: str, interpreter: Path) -> dict[str, str]:
    """Return what was installed of the packages that matter."""
    listed = json.loads(run(uv, "pip", "list", "--python", interpreter, "--format", "json"))
    return {each["name"]: each["version"] for each in listed if each["name"] in SHOWN}


def main() -> None:
    """Run the matrix, print and keep its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--python", nargs="*", default=PYTHONS)
    parser.add_argument("--only", choices=RESOLUTIONS)
    options = parser.parse_args()
    uv = shutil.which("uv") or sys.exit("uv is needed: pip install uv")
    before = kept("matrix") or {"figures": {}, "commit": ""}
    table = {label: {"commit": before["commit"]} | row for label, row in before["figures"].items()}
    first: dict[str, Any] | None = None
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run(uv, "build", "--quiet", "--wheel", "--out-dir", folder, ROOT)
        (wheel,) = folder.glob("*.whl")
        for python in options.python:
            for resolution in [options.only] if options.only else RESOLUTIONS:
                label = f"{python} {resolution}"
                place = folder / label.replace(" ", "-")
                try:
                    interpreter = environment(str(uv), place, wheel, python, resolution)
                    found = posterior(interpreter, folder / f"run-{place.name}")
                    first = first or found
                    row = {"result": verdict(found, first), **versions(str(uv), interpreter)}
                except (RuntimeError, subprocess.TimeoutExpired) as error:
                    row = {"result": f"not run: {error}"}
                shutil.rmtree(place, ignore_errors=True)
                table[label] = row | {"commit": git("rev-parse", "HEAD")}
                sys.stdout.write(f"{label:12s} {row}\n")
                sys.stdout.flush()
    keep("matrix", table, command="python -m tests.matrix", depends=("pyproject.toml",))


if __name__ == "__main__":
    main()
