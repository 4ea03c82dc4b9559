"""Faults that are drawn change one place of a module that stays a module."""

import ast

from tests.mutation.draw import changes_of, drawn

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
