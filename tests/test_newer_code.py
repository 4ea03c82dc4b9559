"""A figure is old where its code is another, not where a text or a place is."""

import subprocess
from pathlib import Path

import pytest

from tests.benchmarks._newer_code import Repository

POLES = '''"""Poles of a state-space model."""

import logging
import re
from typing import TYPE_CHECKING

from pipeline.oma.orders import highest

if TYPE_CHECKING:
    from pipeline.messages import Mode

logger = logging.getLogger(__name__)
LIMIT = 3.0  # [Hz]
"""Highest frequency."""
NAMES = {"a pole": re.compile("pole [0-9]+")}


class Poles:
    """All of them."""

    order: int
    """Of the model."""

    def kept(self, state: str) -> bool:
        """Return whether they are."""
        if state == "not yet":
            logger.warning(f"order {self.order} is too low")
        return state == "published"


def stable(order: int) -> "bool | None":
    """Return whether it is."""
    from pipeline.oma.orders import lowest

    if order < 0:
        raise ValueError("an order is positive")
    return lowest() < order < highest()
'''
FILES = {
    "pipeline/oma/poles.py": POLES,
    "pipeline/oma/orders.py": "STEP = 2\n\n\ndef highest():\n    return 100\n",
    "pipeline/scenarios/paper.toml": "duration = 60\n",
    "sensors/arrays.py": "LIMIT = 4.0\nSTEP = 3\n",
    "tests/benchmarks/poles.py": "SEEDS = 10\n",
}
OMA = "pipeline/oma"


class Tree:
    """A small repository, and its first commit."""

    def __init__(self, root: Path) -> None:
        self.root = root
        for path, text in FILES.items():
            self.write(path, text)
        self.git("init", "-q")
        self.commit()
        self.first = self.git("rev-parse", "HEAD")

    def git(self, *arguments: str) -> str:
        who = ("-c", "user.name=a", "-c", "user.email=a@b.c", "-c", "commit.gpgsign=false")
        ran = subprocess.run(
            ["git", *who, *arguments], cwd=self.root, check=True, capture_output=True, text=True
        )
        return ran.stdout.strip()

    def commit(self) -> None:
        self.git("add", "--all")
        self.git("commit", "-q", "--no-verify", "--allow-empty", "-m", "a change")

    def write(self, path: str, text: str) -> None:
        (self.root / path).parent.mkdir(parents=True, exist_ok=True)
        (self.root / path).write_text(text, encoding="utf-8")

    def replace(self, path: str, old: str, new: str) -> None:
        text = (self.root / path).read_text("utf-8")
        assert old in text
        self.write(path, text.replace(old, new))

    def move(self, path: str, to: str) -> None:
        (self.root / to).parent.mkdir(parents=True, exist_ok=True)
        (self.root / path).rename(self.root / to)

    def newer(self, *depends: str) -> list[str]:
        """The same, whether what changed is committed or not."""
        before = list(Repository(self.root).newer(self.first, depends))
        self.commit()
        assert list(Repository(self.root).newer(self.first, depends)) == before
        return before


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Tree:
    for name in ("GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"):  # as in a hook of git
        monkeypatch.delenv(name, raising=False)
    return Tree(tmp_path)


def test_a_test_inside_a_dependency_measures_nothing(tree: Tree) -> None:
    tree.write("pipeline/oma/test_poles.py", "def test_of_poles():\n    assert True\n")
    assert tree.newer(OMA) == []
    tree.write("pipeline/oma/tested.py", "def tested():\n    return 1\n")
    assert tree.newer(OMA) == ["pipeline/oma/tested.py: function tested"]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("Poles of a state-space model", "The poles"),
        ("[Hz]", "[Hz], of a model"),
        ("Highest frequency", "The highest one"),
        ("All of them", "Each"),
        ("Of the model", "Its order"),
        ("Return whether it is", "Return whether it is stable"),
        ("is too low", "is below the lowest one"),
        ("order {self.order} is", "the order of {self.kept} is"),
        ("an order is positive", "no order is below 0"),
        ("pipeline.oma.orders", "pipeline.oma.limits"),
        ("from pipeline.messages import Mode", "from pipeline.modes import Mode"),
        ("def kept(self, state: str)", "def kept(self,\n             state: str)"),
    ],
)
def test_texts_comments_imports_and_layout_are_not_newer(tree: Tree, old: str, new: str) -> None:
    tree.replace("pipeline/oma/poles.py", old, new)
    assert tree.newer(OMA) == []


@pytest.mark.parametrize(
    ("old", "new", "where"),
    [
        ("LIMIT = 3.0", "LIMIT = 5.0", "assignment LIMIT"),
        ("order < highest()", "order <= highest()", "function stable"),
        ('"published"', '"sent"', "class Poles"),
        ('"not yet"', '"not now"', "class Poles"),  # compared, so that it is no text for people
        ('"a pole"', '"one pole"', "assignment NAMES"),
        ('"pole [0-9]+"', '"pole [1-9]+"', "assignment NAMES"),
        ("order: int\n", "order: float\n", "class Poles"),
        ('"bool | None"', '"bool | int"', "function stable"),
        ("logger = logging.getLogger(__name__)", "logger = None", "assignment logger"),
        ("class Poles:", "@frozen\nclass Poles:", "class Poles"),
    ],
)
def test_code_keys_and_annotations_are_newer(tree: Tree, old: str, new: str, where: str) -> None:
    tree.replace("pipeline/oma/poles.py", old, new)
    assert tree.newer(OMA) == [f"pipeline/oma/poles.py: {where}"]


def test_a_change_elsewhere_is_none_of_the_dependency(tree: Tree) -> None:
    tree.replace("sensors/arrays.py", "4.0", "4.5")
    assert tree.newer(OMA) == []
    assert tree.newer("sensors/arrays.py") == ["sensors/arrays.py: assignment LIMIT"]


def test_a_constant_is_newer_though_another_module_had_the_same(tree: Tree) -> None:
    tree.replace("pipeline/oma/poles.py", "LIMIT = 3.0", "LIMIT = 4.0")
    assert tree.newer(OMA) == ["pipeline/oma/poles.py: assignment LIMIT"]


def test_moved_definitions_are_not_newer(tree: Tree) -> None:
    start = POLES.index("def stable")
    tree.write("pipeline/oma/poles.py", POLES[:start])
    tree.write("pipeline/oma/stability/checks.py", POLES[start:])
    tree.move("pipeline/oma/orders.py", "sensors/orders.py")
    assert tree.newer(OMA) == []


def test_a_definition_from_an_unchanged_module_is_not_newer(tree: Tree) -> None:
    tree.write("pipeline/oma/limits.py", "STEP = 3\n")
    assert tree.newer(OMA) == []


def test_a_definition_that_left_the_dependency_and_changed_is_newer(tree: Tree) -> None:
    tree.move("pipeline/oma/orders.py", "sensors/orders.py")
    tree.replace("sensors/orders.py", "return 100", "return 80")
    assert tree.newer(OMA) == ["sensors/orders.py: function highest"]
    assert tree.newer("pipeline/oma/orders.py") == ["sensors/orders.py: function highest"]


def test_a_new_definition_is_newer_and_a_vanished_one_is_not(tree: Tree) -> None:
    tree.replace("pipeline/oma/orders.py", "STEP = 2\n", "")
    assert tree.newer(OMA) == []
    tree.replace("pipeline/oma/orders.py", "def highest", "print(2)\n\n\ndef highest")
    assert tree.newer(OMA) == ["pipeline/oma/orders.py: statement print(2)"]


def test_other_files_are_newer_by_their_content(tree: Tree) -> None:
    tree.move("pipeline/scenarios/paper.toml", "pipeline/scenarios/published/paper.toml")
    assert tree.newer("pipeline/scenarios") == []
    tree.replace("pipeline/scenarios/published/paper.toml", "60", "61")
    assert tree.newer("pipeline/scenarios") == ["pipeline/scenarios/published/paper.toml"]


def test_named_test_files_count(tree: Tree) -> None:
    tree.replace("tests/benchmarks/poles.py", "10", "12")
    assert tree.newer(OMA) == []
    named = "tests/benchmarks/poles.py"
    assert tree.newer(named) == [f"{named}: assignment SEEDS"]


def test_without_the_commit_or_a_repository_nothing_is_newer(tree: Tree, tmp_path: Path) -> None:
    tree.replace("pipeline/oma/poles.py", "LIMIT = 3.0", "LIMIT = 5.0")
    assert list(Repository(tree.root).newer("0" * 39 + "1", [OMA])) == []
    (tmp_path / ".git").rename(tmp_path / "git")
    assert list(Repository(tree.root).newer(tree.first, [OMA])) == []
