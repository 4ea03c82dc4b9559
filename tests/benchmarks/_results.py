"""Figures with a birth certificate: how, of which seeds, of which code, when and where measured."""

import json
import platform
import subprocess
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks._newer_code import Repository

ROOT = Path(__file__).parents[2]
FOLDER = Path(__file__).with_name("results")
_REPOSITORY = Repository(ROOT)


def keep(
    name: str,
    figures: Mapping[str, Any],
    *,
    command: str,
    seeds: Sequence[int] = (),
    depends: Sequence[str],
) -> Path:
    """Write a result.

    Parameters
    ----------
    name : str
        Of the file.
    figures : mapping
        What was measured, by name.
    command : str
        Measures it again.
    seeds : sequence of int
        That were drawn from.
    depends : sequence of str
        Files and folders whose later definitions make the result old.

    Returns
    -------
    Path
    """
    path = FOLDER / f"{name}.json"
    certificate = {
        "command": command,
        "seeds": list(seeds),
        "commit": git("rev-parse", "HEAD"),
        "date": datetime.now(UTC).date().isoformat(),
        "machine": f"{platform.machine()}, Python {platform.python_version()}, "
        f"numpy {np.__version__}",
        "depends": list(depends),
        "figures": dict(figures),
    }
    path.write_text(json.dumps(certificate, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return path


def kept(name: str) -> dict[str, Any] | None:
    """Return a result; None where there is none."""
    path = FOLDER / f"{name}.json"
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else None


def newer_code(result: Mapping[str, Any]) -> str | None:
    """Return the first definition of what a result depends on that is newer; None where none is."""
    return next(_REPOSITORY.newer(result["commit"], result["depends"]), None)


def is_old(result: Mapping[str, Any]) -> bool:
    """Return whether what a result depends on is other code than when it was measured."""
    return newer_code(result) is not None


def git(*arguments: str) -> str:
    """Return what git answers; "" where there is no repository or no such commit."""
    ran = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    return ran.stdout.strip() if ran.returncode == 0 else ""
