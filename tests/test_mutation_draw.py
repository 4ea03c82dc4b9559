"""Faults that are drawn change one place of a module that stays a module."""

import ast

from tests.mutation.__main__ import LISTS, ROOT, excused, faults_of
from tests.mutation.draw import changes_of, drawn, executing, shortest_first
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


def test_what_keeps_a_division_by_zero_from_happening_is_left_as_it_is() -> None:
    assert [change[-1] for change in changes_of("x = a / (b + 1e-300) + 1e-9")] == [
        "/ is *",
        "+ is -",
        "+ is -",
        f"1e-09 is {1.25 * 1e-9!r}",
    ]


def test_what_is_logged_is_left_as_it_is() -> None:
    lines = ('logger.warning("%d", 1 + 2)', '_log.info("%d", 2)', 'log_once(f"{1 + 2}")')
    assert [changes_of(line) for line in lines] == [[], [], []]


def test_a_fault_is_held_by_the_tests_that_execute_its_function_the_shortest_first() -> None:
    place = "pipeline/state/phrases.py"
    lines = (ROOT / place).read_text(encoding="utf-8").splitlines()
    line = next(n for n, text in enumerate(lines, start=1) if text.startswith("def count_noun"))
    seconds = {"tests/a.py": 3.0, "tests/b.py": 0.1, "tests/test_flow.py": 0.0, "tests/c.py": 1e3}
    calls = {
        f"{place}::count_noun": ["tests/a.py", "tests/b.py", "tests/c.py", "tests/test_flow.py"],
        f"{place}::another": ["tests/d.py"],
        "pipeline/state/books.py::count_noun": ["tests/d.py"],
    }
    executed = {"seconds": seconds | {"tests/d.py": 1.0}, "executing": calls}
    assert executing(place, line + 1, executed) == ["tests/b.py", "tests/a.py"]
    assert executing(place, 1, executed) == ["tests/b.py", "tests/d.py", "tests/a.py"]
    assert executing("pipeline/state/health.py", 1, executed) == []


def test_a_test_that_is_known_not_to_execute_the_function_is_left_out_where_others_do() -> None:
    place = "pipeline/state/phrases.py"
    lines = (ROOT / place).read_text(encoding="utf-8").splitlines()
    line = next(n for n, text in enumerate(lines, start=1) if text.startswith("def count_noun"))
    own = "tests/pipeline/state/test_phrases.py"
    seconds = {"tests/a.py": 3.0, "tests/b.py": 0.1, "tests/c.py": 2.0, own: 1.0}
    calls = {f"{place}::count_noun": ["tests/a.py", "tests/b.py"]}
    executed = {"seconds": seconds, "executing": calls}
    tests = ["tests/a.py", "tests/unknown.py", "tests/b.py", "tests/c.py", own]
    kept = ["tests/b.py", own, "tests/a.py", "tests/unknown.py"]
    assert shortest_first(tests, place, line + 1, executed) == kept
    assert len(shortest_first(tests, place, line, {"seconds": seconds, "executing": {}})) == 5


def test_a_constant_is_held_by_the_tests_of_what_imports_it() -> None:
    calls = {"sensors/files/table.py::in_standard_unit": ["tests/a.py"]}
    assert "sensors.constants" in (ROOT / "sensors/files/table.py").read_text(encoding="utf-8")
    executed = {"seconds": {"tests/a.py": 1.0}, "executing": calls}
    assert executing("sensors/constants.py", 3, executed) == ["tests/a.py"]


def test_a_module_of_the_library_is_held_by_tests_that_import_the_library() -> None:
    near = nearest_tests("pipeline/api/pilewatch/structure.py")
    assert near
    assert all(each.startswith("tests/pipeline/api/") for each in near)


def test_a_module_that_tests_run_by_its_name_is_held_by_the_test_of_that_name() -> None:
    assert "tests/pipeline/archive/test_worker.py" in nearest_tests("pipeline/archive/worker.py")


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
