"""The scripts that make the documentation, loaded as modules: they are no package."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

DOCS = Path(__file__).parents[2] / "docs"


def script(name: str, folder: Path = DOCS) -> ModuleType:
    """The module in NAME.py of a folder, not run as a program."""
    spec = importlib.util.spec_from_file_location(name, folder / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def runner() -> ModuleType:
    """What runs the notebooks."""
    return script("notebooks")


@pytest.fixture(scope="module")
def reference() -> ModuleType:
    """What writes the pages of reference."""
    return script("reference")


@pytest.fixture(scope="module")
def reference_export() -> ModuleType:
    """What writes the page of an export's files."""
    return script("reference_export")
