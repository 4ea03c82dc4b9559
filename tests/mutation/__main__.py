"""Small faults put into a copy of the tree, one at a time: do their tests notice?

    python -m tests.mutation [--only 3,7] [--list FILE]

`faults.json` holds where each is (found by its text, wherever the line lives now), what it changes
and which tests must fail; `survivors.json` those that no test can or need notice, with the reason.
Exit code 1 where one survives that is not listed there.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

HERE, ROOT = Path(__file__).parent, Path(__file__).parents[2]
LEFT_OUT = shutil.ignore_patterns(".git", ".venv", "out", "__pycache__", ".*_cache", "pictures")
LIMIT = 600.0  # a fault that makes its tests take longer is noticed [s]


def place_of(tree: Path, old: str, occurrence: int | None = None) -> tuple[Path, int] | None:
    """Return file and offset of a text; None where it is nowhere or in several files."""
    files = [file for top in ("sensors", "pipeline") for file in (tree / top).rglob("*.py")]
    holding = [file for file in files if old in file.read_text(encoding="utf-8")]
    if len(holding) != 1:
        return None
    text, offset = holding[0].read_text(encoding="utf-8"), -1
    for _ in range((occurrence or 0) + 1):
        offset = text.find(old, offset + 1)
    return (holding[0], offset) if offset >= 0 else None


def outcome(tree: Path, fault: dict[str, Any]) -> str:
    """Return "caught", "survived", or "gone" where the line is no longer there."""
    where = place_of(tree, fault["old"], fault["occurrence"])
    if where is None:
        return "gone"
    file, offset = where
    text = file.read_text(encoding="utf-8")
    file.write_text(text[:offset] + fault["new"] + text[offset + len(fault["old"]) :], "utf-8")
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider"]
    clean = {"PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1", "OMP_NUM_THREADS": "1"}
    try:
        ran = subprocess.run([*command, *fault["tests"]], cwd=tree, env={**os.environ, **clean},
                             capture_output=True, timeout=LIMIT, check=False)  # fmt: skip
    except subprocess.TimeoutExpired:
        return "caught"
    finally:
        file.write_text(text, "utf-8")
    if ran.returncode not in (0, 1, 2):  # nothing was run
        raise RuntimeError(f"{fault['what']}: {ran.stdout.decode()[-500:]}")
    return "caught" if ran.returncode else "survived"


def main() -> None:
    """Try the faults and count what becomes of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--list", type=Path, default=HERE / "faults.json")
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    faults = json.loads(options.list.read_text(encoding="utf-8"))
    excused = set(json.loads((HERE / "survivors.json").read_text(encoding="utf-8")))
    counts = dict.fromkeys(("caught", "survived", "gone"), 0)
    unexcused = 0
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        shutil.copytree(ROOT, tree, ignore=LEFT_OUT)
        for number in [int(each) for each in options.only.split(",") if each] or range(len(faults)):
            fault, begin = faults[number], time.monotonic()
            became = outcome(tree, fault)
            counts[became] += 1
            unexcused += became == "survived" and fault["what"] not in excused
            print(f"{number:3d} {became:9s} {fault['what']} ({time.monotonic() - begin:.0f} s)",
                  flush=True)  # fmt: skip
    print(counts)
    sys.exit(1 if unexcused else 0)


if __name__ == "__main__":
    main()
