"""Every figure of README and documentation has its birth certificate."""

import json
import re
import tomllib
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.benchmarks import figures
from tests.benchmarks._results import FOLDER, git, kept
from tests.benchmarks.figures import PAGE, README, main, page_table, readme_table, rows, with_table

BENCHMARKS = FOLDER.parent
CERTIFICATE = {"command", "seeds", "commit", "date", "machine", "depends", "figures"}


def without_marks(text: str) -> str:
    """A table without what depends on the state of the repository."""
    return text.replace(" * |", " |")


@pytest.mark.parametrize(("path", "table"), [(README, readme_table), (PAGE, page_table)])
def test_the_tables_are_what_the_results_give(path: Path, table: object) -> None:
    text = path.read_text(encoding="utf-8")
    assert callable(table)
    assert without_marks(with_table(text, table())) == without_marks(text)


def test_results_behind_rows_say_how_they_were_measured() -> None:
    used = {row.result for row in rows()}
    for name in used:
        result = kept(name)
        assert result is not None, name
        assert result.keys() >= CERTIFICATE
        assert re.fullmatch(r"[0-9a-f]{40}", result["commit"])
        assert result["command"].startswith("python -m tests.")


def test_the_command_of_a_result_states_its_seeds() -> None:
    """With others, the benchmark's default, it would measure another figure than it stands by."""
    always_alike = {"identification-speed", "modal"}  # one set of samples, of draws
    for path in sorted(FOLDER.glob("*.json")):
        result = kept(path.stem)
        assert result is not None
        if result["seeds"] and path.stem not in always_alike:
            assert str(result["seeds"][0]) in result["command"], path.stem


def test_a_row_of_the_same_records_is_of_the_seeds_of_the_one_before() -> None:
    """A peer on other records would be told as better or worse than it is."""
    table = rows()
    same = [place for place, row in enumerate(table) if row.what.startswith("the same records")]
    assert same
    for place in same:
        ours, theirs = kept(table[place].result), kept(table[place - 1].result)
        assert ours is not None
        assert theirs is not None
        assert ours["seeds"] == theirs["seeds"]


def test_every_row_names_a_command_that_exists() -> None:
    names = {file.stem for file in BENCHMARKS.glob("*.py")}
    for row in rows():
        first, *others = row.command.split()
        if first == "python":
            assert find_spec(others[1]) is not None, row.what
        else:
            assert first in names, row.what


def test_a_check_names_the_code_that_is_newer(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    newer = "pipeline/oma/poles.py: function stable"
    monkeypatch.setattr(figures, "newer_code", lambda result: newer)
    with pytest.raises(SystemExit):
        main(["--check"])
    old = [each for each in capsys.readouterr().out.splitlines() if each.startswith("old: ")]
    assert len(old) == len(rows())
    assert all(each.endswith(f"({newer})") for each in old)


@pytest.mark.nightly
def test_no_row_is_older_than_its_code() -> None:
    if not git("rev-parse", "HEAD"):
        pytest.skip("no repository: git is needed to tell how old a result is")
    assert [f"{row.what} ({row.newer})" for row in rows() if row.is_old] == []


def seeds(kind: str) -> dict[str, set[int]]:
    with (BENCHMARKS / f"seeds_{kind}.toml").open("rb") as file:
        spans: dict[str, list[str]] = tomllib.load(file)
    found: dict[str, set[int]] = {}
    for name, texts in spans.items():
        ends = [[int(each) for each in text.split("..")] for text in texts]
        found[name] = {seed for end in ends for seed in range(end[0], end[-1] + 1)}
    return found


def test_no_seed_that_something_was_tuned_on_is_reported() -> None:
    tuned = set().union(*seeds("tuning").values())
    for name, reported in seeds("reporting").items():
        assert not reported & seeds("tuning").get(name, set())
        assert name == "reproduction" or not reported & tuned


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.json")), ids=lambda path: path.stem)
def test_every_result_says_how_and_of_which_code_it_was_measured(path: Path) -> None:
    result = json.loads(path.read_text(encoding="utf-8"))
    assert set(result) >= CERTIFICATE
    assert result["command"].startswith("python -m tests.")
    assert len(result["commit"]) == 40
    assert result["depends"]
