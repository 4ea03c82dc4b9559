"""The folders keep their plan: twelve modules at most, arrows one way, one meaning a name."""

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from tests.syntax import nodes_of, tree_of

ROOT = Path(__file__).parents[1]
MOST_MODULES = 12  # in one folder
MOST_LOOSE = 5  # directly in pipeline/
MOST_ARROWS = 160  # between rooms
LONGEST_CHAIN = 22  # of modules that import each other
FACE = "pipeline.api.pilewatch"  # the library's public face: relative imports, names of its own
ENTRY_POINTS = {  # run or loaded by name, imported by nothing
    "pipeline.__main__",
    "pipeline.archive.worker",
    "pipeline.api.pilewatch._own_packages",
}


@cache
def modules() -> dict[str, Path]:
    """File of every product module by its dotted name; a package has its folder's."""
    files = {}
    for top in ("sensors", "pipeline"):
        for path in sorted((ROOT / top).rglob("*.py")):
            if "_pb2" not in path.name:
                name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
                files[name.removesuffix(".__init__")] = path
    return files


def folders() -> dict[str, list[str]]:
    """Modules of each folder that has any, `__init__` aside."""
    rooms: dict[str, list[str]] = defaultdict(list)
    for top in ("sensors", "pipeline"):
        for path in (ROOT / top).rglob("*.py"):
            if path.name != "__init__.py" and "_pb2" not in path.name:
                rooms[str(path.parent.relative_to(ROOT))].append(path.stem)
    return rooms


@cache
def imports() -> dict[str, frozenset[str]]:
    """Product modules that each product module imports, at any depth of its code."""
    known = modules()
    return {name: frozenset(_imported(path, known)) for name, path in known.items()}


def _imported(path: Path, known: dict[str, Path]) -> Iterator[str]:
    for node in nodes_of(path):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom) and node.module:
            module = f"{FACE}.{node.module}" if node.level else node.module
            for alias in node.names:
                inner = f"{module}.{alias.name}"
                if inner in known:
                    yield inner
                elif module in known:
                    yield module


def definitions() -> dict[str, list[str]]:
    """Modules that define each public class or constant."""
    places: dict[str, list[str]] = defaultdict(list)
    for name, path in modules().items():
        for node in () if name.startswith(FACE) else tree_of(path).body:
            for defined in _defined(node):
                if not defined.startswith("_") and defined != "logger":
                    places[defined].append(name)
    return places


def _defined(node: ast.stmt) -> Iterator[str]:
    if isinstance(node, ast.ClassDef):
        yield node.name
    elif isinstance(node, ast.Assign):
        yield from (target.id for target in node.targets if isinstance(target, ast.Name))
    elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
        yield node.target.id


def test_no_folder_is_crowded() -> None:
    crowded = {
        room: len(inside) for room, inside in folders().items() if len(inside) > MOST_MODULES
    }
    assert not crowded
    assert len([m for m in folders()["pipeline"] if m != "__main__"]) <= MOST_LOOSE


def test_sibling_folders_do_not_import_each_other_in_a_circle() -> None:
    arrows = set()
    for importer, imported in imports().items():
        for other in imported:
            pair = _siblings(importer, other)
            if pair is not None:
                arrows.add(pair)
    assert not {(a, b) for a, b in arrows if (b, a) in arrows and a < b}


def _siblings(importer: str, imported: str) -> tuple[str, str] | None:
    """The two folders of one parent that an import crosses; None within one folder."""
    ours, theirs = importer.split("."), imported.split(".")
    for depth, (a, b) in enumerate(zip(ours, theirs, strict=False)):
        if a != b:
            here, there = ".".join(ours[: depth + 1]), ".".join(theirs[: depth + 1])
            both = (ROOT / here.replace(".", "/")).is_dir() and (
                ROOT / there.replace(".", "/")
            ).is_dir()
            return (here, there) if both else None
    return None


def arrows_between_rooms() -> set[tuple[str, str]]:
    """Which room imports which: sensors, the loose modules of pipeline, its folders."""

    def room(module: str) -> str:
        return ".".join(module.split(".")[: 1 if module.startswith("sensors") else 2])

    pairs = {
        (room(importer), room(other)) for importer, others in imports().items() for other in others
    }
    return {(importer, other) for importer, other in pairs if importer != other}


def test_rooms_keep_apart() -> None:
    assert len(arrows_between_rooms()) <= MOST_ARROWS


def longest_chain() -> list[str]:
    """The longest chain of modules that import each other."""
    graph = imports()

    @cache
    def below(name: str) -> tuple[str, ...]:
        return (name, *max((below(each) for each in graph[name] - {name}), key=len, default=()))

    return list(max((below(name) for name in graph), key=len))


def test_no_chain_of_imports_is_long() -> None:
    assert len(longest_chain()) <= LONGEST_CHAIN, " -> ".join(longest_chain())


def test_a_name_has_one_meaning() -> None:
    assert not {name: places for name, places in definitions().items() if len(places) > 1}


def test_every_module_is_used() -> None:
    used = frozenset().union(*imports().values())
    packages = {name for name in modules() if (ROOT / name.replace(".", "/")).is_dir()}
    unused = set(modules()) - used - packages - ENTRY_POINTS
    assert not unused


def test_the_places_of_the_forty_questions_are_there() -> None:
    table = (ROOT / "tests/pipeline/place_questions.md").read_text("utf-8")
    places = re.findall(r"`([a-z_0-9/]+\.py)` \|$", table, re.MULTILINE)
    assert len(places) == 40
    assert not [place for place in places if not (ROOT / place).is_file()]


@pytest.mark.parametrize("name", ["silent_losses.md", "nothing_lost.md"])
def test_what_was_lost_and_what_was_asked_has_its_tests(name: str) -> None:
    table = (ROOT / "tests/pipeline" / name).read_text("utf-8")
    rows = re.findall(r"^\| .* \|$", table, re.MULTILINE)[1:]
    benchmarks = {path.stem for path in (ROOT / "tests/benchmarks").glob("*.py")}
    for row in rows:
        named = re.findall(r"`([a-z_0-9/.]+\.py)::(test_\w+)`", row)
        assert named or set(re.findall(r"`(\w+)`", row)) & benchmarks, row
        for path, test in named:
            assert f"\ndef {test}(" in (ROOT / "tests/pipeline" / path).read_text("utf-8"), test


def test_no_node_is_asked_for_what_it_may_not_have() -> None:
    asking = [
        name
        for name, path in modules().items()
        for node in nodes_of(path)
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "getattr"
        and len(node.args) == 3
        and "node" in ast.unparse(node.args[0])
    ]
    assert not asking


def _commented_fields(path: Path) -> list[str]:
    """Fields of a module's public dataclasses that a comment documents, where help() has none."""
    lines = path.read_text("utf-8").splitlines()
    return [
        f"{kind.name}.{field.target.id}"
        for kind in nodes_of(path)
        if isinstance(kind, ast.ClassDef) and not kind.name.startswith("_")
        if any("dataclass" in ast.unparse(each) for each in kind.decorator_list)
        for field in kind.body
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if not field.target.id.startswith("_") and "ClassVar" not in ast.unparse(field.annotation)
        if any("  # " in line for line in lines[field.lineno - 1 : field.end_lineno])
    ]


def test_fields_of_public_dataclasses_are_documented_by_docstrings() -> None:
    found = {
        name: _commented_fields(path)
        for name, path in modules().items()
        if path.name != "__init__.py"
    }
    assert len(found) > 400
    assert {name: fields for name, fields in found.items() if fields} == {}


def _documented(path: Path) -> Iterator[tuple[str, str, ast.arguments]]:
    """Name, docstring and parameters of public functions and classes; a class has __init__'s."""
    for each in nodes_of(path):
        if isinstance(each, (ast.FunctionDef, ast.AsyncFunctionDef)):
            if not each.name.startswith("_") or each.name == "__init__":
                yield each.name, ast.get_docstring(each) or "", each.args
        elif isinstance(each, ast.ClassDef) and not each.name.startswith("_"):
            for made in each.body:
                if isinstance(made, ast.FunctionDef) and made.name == "__init__":
                    yield each.name, ast.get_docstring(each) or "", made.args


def _tables(path: Path) -> list[str]:
    """Names of those whose docstring lists a parameter as `name   text`."""
    return [
        name
        for name, text, arguments in _documented(path)
        for each in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)
        if re.search(rf"^\s*{each.arg}(, \w+)*\s{{2,}}\S", text, re.MULTILINE)
    ]


def test_parameters_of_public_functions_are_listed_as_numpydoc() -> None:
    listed = {name: found for name, path in modules().items() if (found := _tables(path))}
    assert listed == {}
