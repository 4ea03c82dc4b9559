"""The tiers of the suite, tried on a small suite of its own."""

import re

import pytest

from tests.tiers import QUICK_LIST, _quick_modules, not_run_here

pytest_plugins = ["pytester"]
SUITE = """
    import pytest
    from hypothesis import given, strategies as st

    drawn = []

    def test_one(): pass
    def test_two(): pass
    def test_three(): pass
    def test_four(): pass

    @pytest.mark.nightly
    def test_at_night(): pass

    @pytest.mark.skipif(True, reason="mosquitto is not installed")
    def test_broker(): pass

    @given(st.integers(0, 10**12))
    def test_property(n):
        drawn.append(n)

    def test_shows():
        print("drawn", drawn[-1:] if drawn else "none")
"""


@pytest.fixture
def suite(pytester: pytest.Pytester) -> pytest.Pytester:
    pytester.makepyfile(test_small=SUITE)
    pytester.makeconftest('pytest_plugins = ["tests.tiers"]')
    return pytester


@pytest.fixture(scope="module")
def days() -> list[pytest.RunResult]:
    """What a day printed, once it has run: several tests ask for it."""
    return []


@pytest.fixture
def day(suite: pytest.Pytester, days: list[pytest.RunResult]) -> pytest.RunResult:
    """A day without options."""
    if not days:
        days.append(ran(suite))
    return days[0]


def ran(suite: pytest.Pytester, *options: str) -> pytest.RunResult:
    return suite.runpytest_subprocess("-v", "-p", "no:cacheprovider", "-p", "no:xdist", *options)


def told(result: pytest.RunResult) -> tuple[dict[str, int], list[str]]:
    """Outcomes, and the order in which the tests ran."""
    order = re.findall(r"::(test_\w+) (?:PASSED|SKIPPED)", result.stdout.str())
    return result.parseoutcomes(), order


def run(suite: pytest.Pytester, *options: str) -> tuple[dict[str, int], list[str]]:
    return told(ran(suite, *options))


def test_a_day_runs_everything_but_the_nightly_tests(day: pytest.RunResult) -> None:
    outcomes, order = told(day)
    assert outcomes == {"passed": 6, "skipped": 1, "deselected": 1}
    assert order[:4] == ["test_one", "test_two", "test_three", "test_four"]


def test_a_day_runs_the_same_in_the_order_that_a_seed_asks_for(
    suite: pytest.Pytester, day: pytest.RunResult
) -> None:
    outcomes, mixed = run(suite, "--order-seed", "1")
    assert outcomes == {"passed": 6, "skipped": 1, "deselected": 1}
    _, plain = told(day)
    assert mixed != plain
    assert sorted(mixed) == sorted(plain)


def test_a_night_runs_all_in_an_order_of_its_seed(suite: pytest.Pytester) -> None:
    outcomes, one = run(suite, "-m", "nightly", "--night-seed", "1")
    assert outcomes == {"passed": 7, "skipped": 1}
    _, again = run(suite, "-m", "nightly", "--night-seed", "1")
    _, other = run(suite, "-m", "nightly", "--night-seed", "2")
    assert one == again != other
    assert sorted(one) == sorted(other)


def test_what_could_not_be_run_is_listed_with_what_helps(day: pytest.RunResult) -> None:
    day.stdout.fnmatch_lines(
        [
            "*not run on this machine*",
            "1 tests were skipped that a complete machine runs:",
            "  1 × mosquitto is not installed (apt-get install mosquitto)",
        ]
    )


def test_a_machine_that_runs_all_has_nothing_to_list() -> None:
    assert not_run_here({}) == []


def test_every_module_of_the_quick_list_exists() -> None:
    modules = _quick_modules()
    assert len(modules) > 50
    root = QUICK_LIST.parents[1]
    assert all((root / module).is_file() for module in modules)
