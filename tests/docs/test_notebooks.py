"""The notebooks run from top to bottom, and each draws or prints something."""

import re
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
def test_a_notebook_finds_its_files_where_it_is_opened(path: Path) -> None:
    """Opened in a notebook server it runs in its own folder."""
    for named in re.findall(r"[\w./-]+\.(?:mcap|csv|toml)\b", path.read_text("utf-8")):
        assert (path.parent / named).is_file(), named


def test_what_is_said_of_the_broken_records_is_so(runner: ModuleType) -> None:
    text, _ = runner.executed(ROOT / "docs" / "notebooks" / "data_quality.ipynb")
    printed = re.findall(r"^(\w+) +<Modes: (.*)>$", text, flags=re.MULTILINE)
    found = dict(printed)
    assert all("none in 0 windows, 1 rejected" in found[name] for name in ("missing", "constant"))
    assert found["noise"] == "none in 1 window"
    assert found["sound"].startswith("2 in")
    assert found["clipped"].partition(": ")[2].startswith("0.802, 2.105, 2.398")
    assert "clipped - ch2" in text


def test_damping_is_as_uncertain_as_is_said(runner: ModuleType) -> None:
    """An eighth to a third of itself, by the notebook's own table."""
    text, _ = runner.executed(ROOT / "docs" / "notebooks" / "own_array.ipynb")
    rows = re.findall(r"<tr>\s*<th>m\d</th>(.*?)</tr>", text, flags=re.DOTALL)
    figures = [[float(x) for x in re.findall(r"<td>(.*?)</td>", row)] for row in rows]
    shares = [std / damping for _, _, damping, std, *_ in figures]
    assert len(shares) == 3
    assert 0.11 < min(shares) < 0.14
    assert 0.3 < max(shares) < 0.37


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_stored_without_outputs(path: Path) -> None:
    assert '"execution_count": null' in path.read_text("utf-8")
    assert '"output_type"' not in path.read_text("utf-8")
