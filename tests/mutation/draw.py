"""Draw small faults by chance, one in a module, from modules that no other list touches.

    python -m tests.mutation.draw --seed 20261123 --faults 120 --without numerics faults fresh
    python -m tests.mutation.draw --seed 20261124 --faults 40 --without numerics faults fresh drawn
    python -m tests.mutation.draw --seed 20261125 --faults 60 --without numerics faults fresh \\
        drawn again
    python -m tests.mutation.draw --seed 20261126 --faults 60 --without numerics faults fresh \\
        drawn again third
    python -m tests.mutation.draw --seed 20261128 --faults 100
    python -m tests.mutation.draw --seed 186001 --faults 40 --without numerics faults fresh \\
        drawn again third fourth fifth   (13 modules are left; 27 more by seed 186002 over all)
    python -m tests.mutation.draw --seed 20261201 --faults 80 --without fifth sixth
    python -m tests.mutation.draw --seed 20261217 --faults 60   (ninth)
    python -m tests.mutation.draw --seed 20261127 --faults 60   (tenth)
    python -m tests.mutation.draw --seed 20261129 --faults 60 --executed FILE   (eleventh)
    python -m tests.mutation.draw --seed 20261230 --faults 100 --executed FILE   (twelfth)
    python -m tests.mutation.draw --seed 20261131 --faults 40 --executed FILE   (thirteenth)
    python -m tests.mutation.draw --seed 20261132 --faults 60   (fourteenth)
    python -m tests.mutation.draw --seed 20261133 --faults 60   (fifteenth)

Where a fault is and what it changes is drawn; its tests are those that import the module, the
nearest first, or else those that import what imports it; and those that hold what is published and
what settings take, where a module has to do with these. With `--executed FILE`, which
`tests.mutation.executed` writes, those follow that execute the function with the fault, the
shortest first, for some seconds in all, and one that passes most of the module's room: a fault that
the suite catches is not missed because the test that catches it is far away. Those that import the
module and are known not to execute the function are left out then, where others do. Texts of
messages, docstrings, logging, generated code and what only draws are left out: a fault there
changes no figure.
"""

import argparse
import ast
import json
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np

HERE, ROOT = Path(__file__).parent, Path(__file__).parents[2]
COMPARED = {
    ast.Lt: ("<", "<="), ast.LtE: ("<=", "<"), ast.Gt: (">", ">="), ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="), ast.NotEq: ("!=", "=="), ast.In: (" in ", " not in "),
    ast.NotIn: (" not in ", " in "), ast.Is: (" is ", " is not "), ast.IsNot: (" is not ", " is "),
}  # fmt: skip
COMPUTED = {
    ast.Add: ("+", "-"), ast.Sub: ("-", "+"), ast.Mult: ("*", "/"), ast.Div: ("/", "*"),
    ast.FloorDiv: ("//", "/"), ast.BitAnd: ("&", "|"), ast.BitOr: ("|", "&"),
}  # fmt: skip
EXCHANGED = {
    "min": "max", "max": "min", "any": "all", "all": "any", "minimum": "maximum",
    "maximum": "minimum", "mean": "sum", "floor": "ceil", "ceil": "floor", "cos": "sin",
    "sin": "cos", "argmin": "argmax", "argmax": "argmin", }  # fmt: skip
LEAST_FIGURE = 1e-100  # less is added so that nothing is divided by 0
ORDERED = (ast.Lt, ast.LtE, ast.Gt, ast.GtE)
WITHOUT_EFFECT = {"strict", "no_wrap"}  # a guard against errors of the code; a terminal's lines
MOST_TESTS = 4  # modules of tests that are run for a fault because they import its module
MOST_SECONDS = 10.0  # of those that are run because they execute its function [CPU s]
SLOW = {  # minutes each
    "acceptance",
    "outside",
    "reproduction",
    "test_browser.py",
    "test_flow.py",
    "test_on_outside_data.py",
}
API = "pipeline/api/"  # what stands in it is imported as of the top: `pilewatch`
PUBLISHED = "tests/pipeline/test_published.py"  # what these rooms say, and every default
PUBLISHING = {"cli", "export", "monitoring", "recording", "report", "state"}
KEYS = "tests/test_scenario_keys.py"  # what settings take
A_RUN = "tests/test_golden_run.py::test_a_run_gives_the_same_messages_as_before[bad-sensors]"
WHOLE = {  # a test that passes most of a room, of ten seconds at most
    **dict.fromkeys(("acquisition", "dynamics", "loads", "simulation", "structure"), A_RUN),
    **dict.fromkeys(("nodes", "oma", "runtime", "updating"), A_RUN),
    **dict.fromkeys(("sources", "state", "transport"), "tests/pipeline/test_histories.py"),
    "api": "tests/pipeline/api/test_pilewatch.py",
    "archive": "tests/pipeline/archive/test_history.py",
    "cli": "tests/pipeline/cli/test_commands.py",
    "feeds": "tests/sensors/feeds/test_any_message.py",
    "files": "tests/sensors/files/test_formats.py",
    "offline": "tests/pipeline/cli/test_commands.py",
    "report": "tests/pipeline/report/test_page.py",
    "viewer": "tests/pipeline/viewer/test_viewer.py",
}
_LOGGING = re.compile(r"(?:_log|_LOG|logger)\.|log_once\(")
Change = tuple[int, int, int, str, str]  # line, first and last column, new text, what it is
Executed = dict[str, Any]  # what tests.mutation.executed writes


def changes_of(source: str) -> list[Change]:
    """Return every small change that one line of a module admits."""
    lines = source.splitlines()
    found = []
    for node in _outside_of_texts(ast.parse(source)):
        for line, start, end, new, what in _changes_at(node, lines):
            if "->" not in lines[line - 1][start:end] and not _LOGGING.search(lines[line - 1]):
                found.append((line, start, end, new, what))
    return sorted(set(found))


def _outside_of_texts(node: ast.AST) -> Iterator[ast.AST]:
    """Walk without annotations, decorators, messages of errors and formatted texts."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list"):
            continue
        if isinstance(node, ast.keyword) and node.arg in WITHOUT_EFFECT:
            continue
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or isinstance(child, ast.JoinedStr | ast.Raise):
                continue
            if isinstance(child, ast.Call) and _LOGGING.match(f"{ast.unparse(child.func)}("):
                continue
            yield child
            yield from _outside_of_texts(child)


def _changes_at(node: ast.AST, lines: list[str]) -> Iterator[Change]:
    if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in COMPARED:
        if isinstance(node.ops[0], ORDERED) and any(map(_is_measured_limit, _sides(node))):
            return
        yield from _between(node.left, node.comparators[0], COMPARED[type(node.ops[0])], lines)
    elif isinstance(node, ast.BinOp) and type(node.op) in COMPUTED:
        yield from _between(node.left, node.right, COMPUTED[type(node.op)], lines)
    elif isinstance(node, ast.BoolOp):
        words = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
        yield from _between(node.values[0], node.values[1], words, lines)
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        if 0 < node.value < LEAST_FIGURE:
            return
        new = node.value + 1 if isinstance(node.value, int) else node.value * 1.25 or 0.25
        yield _replaced(node, repr(new), f"{node.value} is {new}")
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield _replaced(node, repr(not node.value), f"{node.value} is {not node.value}")
    elif isinstance(node, ast.UnaryOp) and node.lineno == node.operand.lineno:
        start, end = node.col_offset, node.operand.col_offset
        yield node.lineno, start, end, "", f"without {lines[node.lineno - 1][start:end].strip()}"
    elif isinstance(node, ast.Call):
        yield from _exchanged(node.func)
    elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        if node.end_lineno == node.lineno:
            yield _replaced(node, "pass", "a call is left out")
    elif isinstance(node, ast.AugAssign) and type(node.op) in COMPUTED:
        yield from _between(node.target, node.value, COMPUTED[type(node.op)], lines)


def _sides(node: ast.Compare) -> tuple[ast.expr, ast.expr]:
    return node.left, node.comparators[0]


def _is_measured_limit(side: ast.expr) -> bool:
    """Whether no measured figure lies on a limit, so that < and <= are the same."""
    return isinstance(side, ast.Constant) and isinstance(side.value, float) and side.value != 0


def _exchanged(called: ast.expr) -> Iterator[Change]:
    """Call the function's opposite."""
    if isinstance(called, ast.Name | ast.Attribute) and called.end_col_offset is not None:
        name = called.id if isinstance(called, ast.Name) else called.attr
        if name in EXCHANGED:
            line, end, new = (
                called.end_lineno or called.lineno,
                called.end_col_offset,
                EXCHANGED[name],
            )
            yield line, end - len(name), end, new, f"{name} is {new}"


def _replaced(node: ast.expr | ast.Expr, new: str, what: str) -> Change:
    return node.lineno, node.col_offset, node.end_col_offset or 0, new, what


def _between(
    left: ast.expr, right: ast.expr, words: tuple[str, str], lines: list[str]
) -> Iterator[Change]:
    """Exchange the operator that stands between two expressions on one line."""
    if left.end_lineno != right.lineno or left.end_col_offset is None:
        return
    between = lines[right.lineno - 1][left.end_col_offset : right.col_offset]
    old, new = words
    if between.count(old) == 1:
        start = left.end_col_offset + between.index(old)
        yield right.lineno, start, start + len(old), new, f"{old.strip()} is {new.strip()}"


def modules(without: Sequence[str]) -> list[Path]:
    """Return the modules that may be drawn: none of those lists has a fault in them."""
    taken = {
        fault["place"]
        for name in without
        for fault in json.loads((HERE / f"{name}.json").read_text(encoding="utf-8"))
    }
    files = [file for top in ("sensors", "pipeline") for file in sorted((ROOT / top).rglob("*.py"))]
    return [
        file
        for file in files
        if str(file.relative_to(ROOT)) not in taken
        and file.name not in ("__init__.py", "__main__.py")
        and not {"pictures", "drawing", "reproduction"} & set(file.parts)
        and not file.name.endswith("_pb2.py")
    ]


def tests_of(place: str) -> list[str]:
    """Return tests that import a module, else those that import what imports it, nearest first.

    The one that has its name is among them, imported or not.
    """
    path, own = Path(place), own_test(place)
    wide = [own] if (ROOT / own).exists() else []
    if PUBLISHING & set(path.parts) or "settings" in path.stem:
        wide.append(PUBLISHED)
    if "__post_init__" in (ROOT / place).read_text(encoding="utf-8"):
        wide.append(KEYS)
    named, seen = [place], {place}
    while named:
        near = sorted(_importing(named, ROOT / "tests", "test_*.py"), key=_distance_from(place))
        if near:
            return [*near[:MOST_TESTS], *(each for each in wide if each not in near[:MOST_TESTS])]
        named = [each for each in _product_modules_importing(named) if each not in seen]
        seen |= set(named)
    return ["tests/test_flow.py"]


def own_test(place: str) -> str:
    """Return the test that has a module's name."""
    path = Path(place)
    return str(Path("tests") / path.parent / f"test_{path.name}")


def executing(place: str, line: int, executed: Executed) -> list[str]:
    """Return tests that execute the function around a line, the shortest first, while they fit.

    A line outside of functions has the tests of all functions of its module, and where none is
    executed, as in a module of constants, of the modules that import it.
    """
    tests = _executing_around(place, line, executed)
    for importing in () if tests else _product_modules_importing([place]):
        tests |= _executing_any(f"{importing}::", executed)
    chosen, seconds = [], 0.0
    for test in sorted(tests, key=lambda test: (executed["seconds"][test], test)):
        seconds += executed["seconds"][test]
        if seconds <= MOST_SECONDS and not SLOW & set(Path(test).parts):
            chosen.append(test)
    return chosen


def shortest_first(tests: Sequence[str], place: str, line: int, executed: Executed) -> list[str]:
    """Return tests in order of their time, those last of which it is not known.

    Tests that are known not to execute the function around a line are left out where others do, but
    for the one that has the module's name, which may run it in a process of its own.
    """
    seconds, around = executed["seconds"], _executing_around(place, line, executed)
    passed_by = seconds.keys() - around - {own_test(place)} if around else set[str]()
    kept = [each for each in tests if each not in passed_by]
    return sorted(kept, key=lambda each: seconds.get(each, np.inf))


def _executing_around(place: str, line: int, executed: Executed) -> set[str]:
    """Tests that execute the function around a line; outside of functions, any of the module's."""
    function = _function_around(line, (ROOT / place).read_text(encoding="utf-8"))
    return _executing_any(f"{place}::{function}", executed, whole=bool(function))


def _executing_any(name: str, executed: Executed, *, whole: bool = False) -> set[str]:
    """Tests that execute a function of that whole name, or one whose name begins so."""
    return {
        test
        for function, tests in executed["executing"].items()
        if (function == name if whole else function.startswith(name))
        for test in tests
    }


def of_the_room(place: str) -> list[str]:
    """Return the test that passes most of a module's room."""
    rooms = [WHOLE[part] for part in Path(place).parts[1:-1] if part in WHOLE]
    return rooms[:1]


def _function_around(line: int, source: str) -> str:
    """Return a function's or method's qualified name, without those within it; "" outside."""
    nodes, qualified = ast.parse(source).body, ""
    while nodes:
        around = [
            node
            for node in nodes
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
            and node.lineno <= line <= (node.end_lineno or 0)
        ]
        nodes = []
        for node in around:
            qualified += f".{node.name}" if qualified else node.name
            if not isinstance(node, ast.ClassDef):
                return qualified
            nodes = node.body
    return ""


def _product_modules_importing(places: list[str]) -> list[str]:
    tops = ("sensors", "pipeline")
    return [each for top in tops for each in _importing(places, ROOT / top, "*.py")]


def _importing(places: list[str], folder: Path, pattern: str) -> list[str]:
    """Return the files of a folder that import one of some modules."""
    words = []
    for place in places:
        path = Path(place.removeprefix(API)).with_suffix("")
        path = path.parent if path.name == "__init__" else path
        dotted, package = ".".join(path.parts), ".".join(path.parent.parts)
        words.append(rf"(from {dotted} import|import {dotted}\b)")
        words.append(rf"from {package} import [^#]*?\b{path.name}\b")
        if place.startswith(API):
            words.append(rf"from \.{path.name} import")
    pattern_of_imports = re.compile("|".join(words))
    return [
        str(file.relative_to(ROOT))
        for file in folder.rglob(pattern)
        if not SLOW & set(file.parts)
        and pattern_of_imports.search(file.read_text(encoding="utf-8"))
    ]


def _distance_from(place: str) -> Callable[[str], tuple[int, str]]:
    """Return how many folders lie between a test and a module's own."""
    mirrored = Path(own_test(place)).parts

    def distance(test: str) -> tuple[int, str]:
        parts = Path(test).parts
        common = sum(
            1
            for _ in takewhile(lambda pair: pair[0] == pair[1], zip(parts, mirrored, strict=False))
        )
        return -common, test

    return distance


def drawn(
    seed: int, number: int, without: Sequence[str] = (), executed: Executed | None = None
) -> list[dict[str, Any]]:
    """Draw faults, each in a module of its own."""
    rng = np.random.default_rng(seed)
    files, found = modules(without), []
    texts = [
        file.read_text(encoding="utf-8")
        for top in ("sensors", "pipeline")
        for file in (ROOT / top).rglob("*.py")
    ]
    for index in rng.permutation(len(files)):
        if len(found) == number:
            break
        source = files[index].read_text(encoding="utf-8")
        changes = changes_of(source)
        if changes:
            place = str(files[index].relative_to(ROOT))
            change = changes[rng.integers(len(changes))]
            old, new = _unique(source, change, texts)
            what = f"{place}:{change[0]} {change[4]}"
            tests = tests_of(place)
            if executed:
                tests = list(dict.fromkeys([*tests, *executing(place, change[0], executed)]))
                tests = shortest_first(tests, place, change[0], executed)
                tests += [each for each in of_the_room(place) if each not in tests]
            found.append(
                {
                    "place": place,
                    "old": old,
                    "new": new,
                    "occurrence": None,
                    "what": what,
                    "tests": tests,
                }
            )
    return found


def _unique(source: str, change: Change, texts: list[str]) -> tuple[str, str]:
    """Return a line before and after its change, with as many before it as make it unique."""
    line, start, end, new, _ = change
    lines = source.splitlines()
    before = lines[line - 1].encode()
    after = (before[:start] + new.encode() + before[end:]).decode()
    for first in range(line - 1, -1, -1):
        old = "\n".join(lines[first:line])
        if sum(text.count(old) for text in texts) == 1:
            return old, "\n".join([*lines[first : line - 1], after])
    raise ValueError(f"line {line} is not unique")


def main() -> None:
    """Print faults as a list."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--faults", type=int, default=120)
    parser.add_argument("--without", nargs="*", default=[], help="lists whose modules are left out")
    parser.add_argument("--executed", type=Path, help="which tests execute a function")
    options = parser.parse_args()
    executed = options.executed and json.loads(options.executed.read_text(encoding="utf-8"))
    faults = drawn(options.seed, options.faults, options.without, executed)
    json.dump(faults, sys.stdout, indent=1, ensure_ascii=False)
    sys.stdout.write("\n")


if __name__ == "__main__":
    main()
