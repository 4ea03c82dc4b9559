"""The page of warnings has every code that the product gives, and no other."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from pipeline.oma.windows import block_admission
from tests.syntax import nodes_of, tree_of

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "pages" / "reference" / "warnings.md"
MAKERS = {"QualityWarning", "Finding", "rejected_estimate", "EstimateRefused"}
CODE = re.compile(r"[a-z]+(?:-[a-z]+)*")
BY_TEXT = {"no-paired-mode", "mode-birth", "mode-death", "mode-drift"}  # made otherwise


def constants_of(path: Path) -> Iterator[tuple[str, str]]:
    """Names and texts of a module's constants."""
    for node in tree_of(path).body:
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant):
            names = (each.id for each in node.targets if isinstance(each, ast.Name))
            yield from ((name, node.value.value) for name in names if name.isupper())


def codes_of(path: Path, constants: dict[str, str]) -> Iterator[str]:
    """Codes that are written, or named, where a warning or a rejection is made."""
    for node in nodes_of(path):
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") in MAKERS:
            arguments = (*node.args[:2], *(each.value for each in node.keywords))
            texts = (each.value for each in arguments if isinstance(each, ast.Constant))
            named = (constants.get(each.id) for each in arguments if isinstance(each, ast.Name))
            for text in (*texts, *named):
                if isinstance(text, str) and CODE.fullmatch(text):
                    yield text


def test_every_code_is_on_the_page_and_no_other() -> None:
    sources = [
        path
        for folder in ("pipeline", "sensors")
        for path in (ROOT / folder).rglob("*.py")
        if "api" not in path.parts
    ]
    named = {name: text for source in sources for name, text in constants_of(source)}
    given = {code for source in sources for code in codes_of(source, named)}
    given -= {"reject", "warn", "mend"}
    known = vars(block_admission)
    constants = {name: value for name, value in known.items() if name.isupper()}
    given |= {each for each in constants.values() if isinstance(each, str)} | BY_TEXT
    table = [line.split("|")[1] for line in PAGE.read_text("utf-8").splitlines() if "| `" in line]
    listed = {code for cell in table for code in re.findall(r"`([a-z-]+)`", cell)}
    assert len(given) > 60
    assert listed - given == set()
    assert given - listed == set()
