"""The notebooks run from top to bottom, and each draws or prints something."""

from pathlib import Path
from types import ModuleType

import pytest

pytest.importorskip("pandas", reason="the extra `notebook` is not installed")
pytest.importorskip("pilewatch", reason="the project is not installed")

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
LONG = ("posterior",)  # two thirds of the time of all
SHORTENED = {  # by day, what takes longest after it: fewer windows before and after a change
    "a_change": {
        "duration=3600.0": "duration=1200.0",
        ".loc[:5]": ".loc[:1]",
        ".loc[6:]": ".loc[2:]",
    }
}


def test_there_are_five() -> None:
    assert len(NOTEBOOKS) >= 5


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, marks=[pytest.mark.nightly] if path.stem in (*LONG, *SHORTENED) else [])
        for path in NOTEBOOKS
    ],
    ids=lambda path: path.stem,
)
def test_a_notebook_runs(runner: ModuleType, path: Path) -> None:
    assert_runs(runner, path)


@pytest.mark.parametrize("name", SHORTENED)
def test_a_notebook_runs_with_a_shorter_record(
    runner: ModuleType, name: str, tmp_path: Path
) -> None:
    (path,) = (each for each in NOTEBOOKS if each.stem == name)
    text = path.read_text("utf-8")
    for long, short in SHORTENED[name].items():
        assert long in text
        text = text.replace(long, short)
    (tmp_path / path.name).write_text(text, "utf-8")
    assert_runs(runner, tmp_path / path.name)


def assert_runs(runner: ModuleType, path: Path) -> None:
    text, figures = runner.executed(path)
    assert text.startswith("# ")
    assert "```text" in text or figures
    assert all(png.startswith(b"\x89PNG") for png in figures)
    assert "outputs" not in text


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_stored_without_outputs(path: Path) -> None:
    assert '"execution_count": null' in path.read_text("utf-8")
    assert '"output_type"' not in path.read_text("utf-8")
