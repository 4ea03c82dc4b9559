"""Small faults put into a copy of the tree, one at a time: do their tests notice?

    python -m tests.mutation [LIST …] [--only 3,7] [--keep]

A list holds where each fault is (found by its text, wherever the line lives now), what it changes
and which tests must fail: `numerics` those of the published statement, `faults` those of states,
transport and recordings, `fresh` those of other modules, chosen before their tests were read.
`survivors.json` holds those that no test can or need notice, with the reason. `--keep` writes the
counts to `tests/benchmarks/results/faults.json`. Exit code 1 where a fault survives that is not
listed there, or has no place any more.
"""

import argparse
import json
import os
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from importlib import import_module
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from tests.benchmarks import _results

HERE, ROOT = Path(__file__).parent, Path(__file__).parents[2]
LISTS = ("numerics", "faults", "fresh", "drawn", "again", "third", "fourth", "fifth", "sixth",
         "seventh", "eighth", "ninth", "tenth",
         "eleventh", "twelfth", "thirteenth", "fourteenth", "fifteenth")  # fmt: skip
LEFT_OUT = shutil.ignore_patterns(".git", ".venv", "out", "__pycache__", ".*_cache")
# What the tests import and no fault is in: once for all faults.
LIBRARIES = ("numpy", "scipy.stats", "scipy.optimize", "scipy.signal", "scipy.linalg", "emcee",
             "pyarrow.parquet", "pyarrow.csv", "google.protobuf", "hypothesis", "typer.testing",
             "rich.console", "httpx", "aiosmtplib", "mcap.reader", "mcap.writer")  # fmt: skip
LIMIT = 600.0  # a fault that makes its tests take longer is noticed [s]
Fault = dict[str, Any]
_MOMENTS = count(round(time.time()))  # [s]


def faults_of(name: str) -> list[Fault]:
    """Return the faults of a list."""
    return list(json.loads((HERE / f"{name}.json").read_text(encoding="utf-8")))


def excused() -> dict[str, str]:
    """Return why a fault may survive, by what it changes."""
    return dict(json.loads((HERE / "survivors.json").read_text(encoding="utf-8")))


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


def outcome(tree: Path, fault: Fault) -> str:
    """Return "caught", "timeout", "survived", or "gone" where the line is no longer there."""
    where = place_of(tree, fault["old"], fault["occurrence"])
    if where is None:
        return "gone"
    file, offset = where
    text = file.read_text(encoding="utf-8")
    _write(file, text[:offset] + fault["new"] + text[offset + len(fault["old"]) :])
    try:
        return "caught" if fails(tree, fault["tests"]) else "survived"
    except TimeoutError:
        return "timeout"
    finally:
        _write(file, text)


def _write(file: Path, text: str) -> None:
    """Write a module as of a second of its own: what is compiled of another text is not taken."""
    file.write_text(text, "utf-8")
    moment = next(_MOMENTS)
    os.utime(file, (moment, moment))


def fails(tree: Path, tests: Sequence[str], limit: float = LIMIT) -> bool:
    """Return whether tests of a tree fail; raises TimeoutError where they last longer."""
    if missing := [each for each in tests if not (tree / each.split("::")[0]).exists()]:
        raise FileNotFoundError(*missing)
    child = os.fork()
    if child == 0:
        os.setsid()  # what its tests start ends with it
        signal.alarm(round(limit) + 5)  # and it ends where its parent is killed
        os._exit(_run_in(tree, tests))
    end = time.monotonic() + limit
    while time.monotonic() < end:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            code = os.waitstatus_to_exitcode(status)
            if code in range(5):  # 4: not even conftest.py can be imported
                return code != 0
            raise RuntimeError(f"pytest {' '.join(tests)} ended with {code}")
        time.sleep(0.05)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    raise TimeoutError


def _run_in(tree: Path, tests: Sequence[str]) -> int:
    """Run pytest in this process, in a tree whose modules are not imported yet."""
    silence = os.open(os.devnull, os.O_RDWR)
    for descriptor in range(3):
        os.dup2(silence, descriptor)
    for name in [each for each in sys.modules if each.split(".")[0] == "tests"]:
        del sys.modules[name]
    paths = [str(tree), str(tree / "pipeline/api")]
    sys.path[:] = [*paths, *(each for each in sys.path if Path(each or ".").resolve() != ROOT)]
    os.environ |= {"PYTHONPATH": os.pathsep.join(paths), "PYTHONDONTWRITEBYTECODE": "1"}
    sys.dont_write_bytecode = True
    os.chdir(tree)
    # Since pytest 9 a room would else swallow the module that is named before it. With a marker
    # named, tests run in the order of the list: without one, the suite's longest come first.
    options = ("-x", "-q", "-p", "no:cacheprovider", "--keep-duplicates", "-m", "not nightly")
    return int(pytest.main([*options, *tests]))


def tried(tree: Path, name: str, chosen: Sequence[int]) -> dict[str, list[str]]:
    """Try faults of a list; what each changes, by what becomes of it."""
    became: dict[str, list[str]] = {"caught": [], "timeout": [], "survived": [], "gone": []}
    faults = faults_of(name)
    for number in chosen or range(len(faults)):
        fault, started = faults[number], time.monotonic()
        found = outcome(tree, fault)
        became[found].append(fault["what"])
        took = time.monotonic() - started
        print(f"{name} {number:3d} {found:9s} {fault['what']} ({took:.0f} s)", flush=True)
    return became


def figures_of(became: dict[str, list[str]]) -> dict[str, Any]:
    """Return counts, and the survivors by name."""
    total = sum(map(len, became.values()))
    caught = len(became["caught"]) + len(became["timeout"])
    return {
        "faults": total,
        "caught": caught,
        "caught_share": round(caught / total, 3),
        **{each: became[each] for each in ("timeout", "survived", "gone")},
        "commit": _results.git("rev-parse", "HEAD"),
    }


def main() -> int:
    """Try the faults and count what becomes of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("lists", nargs="*", choices=[*LISTS, []], default=list(LISTS))
    parser.add_argument("--only", default="", help="numbers within the one list that is named")
    parser.add_argument("--keep", action="store_true", help="write the counts")
    options = parser.parse_args()
    os.environ["OMP_NUM_THREADS"] = "1"
    for library in LIBRARIES:
        import_module(library)
    chosen = [int(each) for each in options.only.split(",") if each]
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        shutil.copytree(ROOT, tree, ignore=LEFT_OUT)
        for name in options.lists:
            found[name] = figures_of(tried(tree, name, chosen))
    print(json.dumps(found, indent=1, ensure_ascii=False))
    if options.keep:
        before = _results.kept("faults") or {"figures": {}}
        _results.keep(
            "faults",
            before["figures"] | found,
            command="python -m tests.mutation --keep",
            depends=["tests/mutation"],
        )
    missed = [what for each in found.values() for what in (*each["survived"], *each["gone"])]
    return 1 if set(missed) - set(excused()) else 0


if __name__ == "__main__":
    sys.exit(main())
