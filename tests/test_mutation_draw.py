"""Faults that are drawn change one place of a module that stays a module."""

import ast

from tests.mutation.__main__ import LISTS, ROOT, excused, faults_of
from tests.mutation.draw import changes_of, drawn
from tests.mutation.draw import tests_of as nearest_tests

SOURCE = '''def f(a: int, b: int = 2) -> int:
    """Not here: 1 < 2."""
    if a < b and not a:
        raise ValueError(f"{a + 1} is less")
    return max(a, b) * 2
'''


def test_texts_and_errors_are_left_as_they_are() -> None:
    changed = {line for line, *_ in changes_of(SOURCE)}
    assert changed == {1, 3, 5}
    what = {change[-1] for change in changes_of(SOURCE)}
    assert {"< is <=", "and is or", "without not", "max is min", "* is /", "2 is 3"} <= what


def test_the_same_seed_draws_the_same_faults_each_a_module_that_can_be_read() -> None:
    faults = drawn(7, 5)
    assert faults == drawn(7, 5)
    assert len({fault["place"] for fault in faults}) == 5
    for fault in faults:
        assert fault["old"] != fault["new"]
        assert fault["tests"]
    for line, start, end, new, _ in changes_of(SOURCE):
        lines = SOURCE.splitlines()
        lines[line - 1] = lines[line - 1][:start] + new + lines[line - 1][end:]
        ast.parse("\n".join(lines))


def test_limits_of_measured_figures_and_guards_of_the_code_itself_are_left_as_they_are() -> None:
    source = "x = [a for a, b in zip(c, d, strict=True) if a < 0.05 or b < 0.0 or a < b]"
    assert [change[-1] for change in changes_of(source)].count("< is <=") == 2
    assert not any("True" in change[-1] for change in changes_of(source))


def test_a_module_of_the_library_is_held_by_tests_that_import_the_library() -> None:
    assert nearest_tests("pipeline/api/pilewatch/structure.py") == [
        "tests/pipeline/api/test_pilewatch.py"
    ]


def test_every_listed_fault_has_one_place_and_tests_that_are_there() -> None:
    modules = [file for top in ("sensors", "pipeline") for file in (ROOT / top).rglob("*.py")]
    text = "\0".join(file.read_text(encoding="utf-8") for file in modules)

    def has_one_place(old: str) -> bool:
        first = text.find(old)
        return first >= 0 and text.find(old, text.find("\0", first)) < 0

    faults = [(name, fault) for name in LISTS for fault in faults_of(name)]
    assert [(name, each["what"]) for name, each in faults if not has_one_place(each["old"])] == []
    tests = {test.split("::")[0] for _, fault in faults for test in fault["tests"]}
    assert [test for test in sorted(tests) if not (ROOT / test).exists()] == []
    assert excused().keys() <= {fault["what"] for _, fault in faults}
