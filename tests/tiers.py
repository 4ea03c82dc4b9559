"""Three tiers of the suite, and what this machine could not run.

    pytest -m quick      under half a minute on one core: what most changes break first
    pytest               everything but the nightly tests
    pytest -m nightly    everything and the trials, in random order, hypothesis drawing afresh

Which tests are quick follows from `quick.txt`: the modules whose tests together need little time,
measured by `python -m pytest --cpu-times FILE` and `python -m tests.tiers FILE`. A night's order
and draws follow from its seed, which the first lines print; `--night-seed N` runs that night again.
`--order-seed N` mixes the order of the other tiers and draws nothing.
"""

import json
import os
import random
import sys
from collections import defaultdict
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

QUICK_LIST = Path(__file__).with_name("quick.txt")
# Modules whose tests share a fixture of many seconds, or take long: each in one process, and begun
# first, that no process waits for another in the end.
TOGETHER = (
    "tests/test_flow.py",
    "tests/test_trials.py",
    "tests/pipeline/archive",
    "tests/pipeline/reproduction",
    "tests/acceptance",
    "tests/pipeline/updating/structural",
    "tests/pipeline/offline/test_audit.py",
    "tests/test_golden_run.py",
    "tests/test_scenario_studies.py",
    "tests/test_feed_trials.py",
    "tests/test_readme.py",
    "tests/docs",
)
QUICK_TIME = 15.0  # of all quick tests together; starting takes some seconds more [CPU s]
SLOW_SHARE = 1.2  # a module that takes longer is not quick [CPU s]
NIGHT_EXAMPLES = 300  # of a hypothesis test that asks for no number of its own

# The same examples every time and on every machine, however slow; at night others.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile(
    "night", derandomize=False, deadline=None, max_examples=NIGHT_EXAMPLES, print_blob=True
)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--night-seed", type=int, default=None, help="of a night's order and draws")
    parser.addoption("--order-seed", type=int, default=None, help="mixes the order by day")
    parser.addoption("--cpu-times", type=Path, default=None, help="write CPU seconds by module")


def pytest_configure(config: pytest.Config) -> None:
    for line in (
        "quick: one of the tests that take half a minute together",
        "nightly: needs minutes, or draws afresh; runs with -m nightly only",
    ):
        config.addinivalue_line("markers", line)
    settings.load_profile("night" if _is_night(config) else "repeatable")
    config.stash[_TIMES] = defaultdict(float)


_TIMES = pytest.StashKey[dict[str, float]]()


def and_at_night(day: object, night: object) -> list[Any]:
    """Return two values for `pytest.mark.parametrize`, seeds or how many: a study's short form by
    day; its other half, or all of it, at night.

    What holds for each is asked of it, so that a night asks no less than one study of both.
    """
    return [pytest.param(day, id="day"), pytest.param(night, id="night", marks=pytest.mark.nightly)]


def _is_night(config: pytest.Config) -> bool:
    return str(config.option.markexpr) == "nightly"


def _night_seed(config: pytest.Config) -> int:
    """Return the seed that was asked for, else the date, the same in every process."""
    asked: int | None = config.option.night_seed
    return int(datetime.now(UTC).strftime("%Y%m%d")) if asked is None else asked


def pytest_report_header(config: pytest.Config) -> str | None:
    return f"night seed: {_night_seed(config)}" if _is_night(config) else None


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Import no module without a quick test where these alone are asked for: half their time."""
    if config.option.markexpr != "quick" or not collection_path.name.startswith("test_"):
        return None
    module = collection_path.relative_to(config.rootpath).as_posix()
    return None if module in _quick_modules() else True


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    night, quick = _is_night(config), _quick_modules()
    for item in items:
        if _module(item.nodeid) in quick and item.get_closest_marker("nightly") is None:
            item.add_marker(pytest.mark.quick)
        if night:
            item.add_marker(pytest.mark.nightly)
    if night:
        seed = _night_seed(config)
        _shuffle(items, random.Random(seed))
        _seed_hypothesis(items, seed)
    elif not config.option.markexpr:
        late = [item for item in items if item.get_closest_marker("nightly") is not None]
        if late:
            config.hook.pytest_deselected(items=late)
            items[:] = [item for item in items if item not in late]
        items.sort(key=_turn)
    if not night and config.option.order_seed is not None:
        _shuffle(items, random.Random(config.option.order_seed))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Return what hands rooms and modules as a whole to the processes."""
    from xdist.scheduler import LoadScopeScheduling

    class ByRoom(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            rooms = (room for room in TOGETHER if nodeid.startswith(room))
            return next(rooms, _module(nodeid))

    return ByRoom(config, log)


def _turn(item: pytest.Item) -> int:
    """Place among the rooms that begin first; the others keep their order."""
    places = (n for n, room in enumerate(TOGETHER) if item.nodeid.startswith(room))
    return next(places, len(TOGETHER))


def _shuffle(items: list[pytest.Item], order: random.Random) -> None:
    """Mix the modules and the tests in each; a module's fixtures are still made once."""
    modules: dict[str, list[pytest.Item]] = defaultdict(list)
    for item in items:
        modules[_module(item.nodeid)].append(item)
    names = list(modules)
    order.shuffle(names)
    for name in names:
        order.shuffle(modules[name])
    items[:] = [item for name in names for item in modules[name]]


def _seed_hypothesis(items: list[pytest.Item], seed: int) -> None:
    """Let every property draw from the night's seed, so that a failure can be run again."""
    from hypothesis import seed as seeded

    for item in items:
        function = getattr(item, "obj", None)
        if getattr(function, "is_hypothesis_test", False):
            seeded(seed)(getattr(function, "__func__", function))


def _module(nodeid: str) -> str:
    return nodeid.split("::")[0]


@cache
def _quick_modules() -> frozenset[str]:
    lines = QUICK_LIST.read_text(encoding="utf-8").splitlines() if QUICK_LIST.exists() else []
    return frozenset(line for line in lines if line and not line.startswith("#"))


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    started = _cpu_time()
    yield
    item.config.stash[_TIMES][_module(item.nodeid)] += _cpu_time() - started


def _cpu_time() -> float:
    """Of this process and of those that it started and that have ended [s]."""
    return sum(os.times()[:4])


def pytest_sessionfinish(session: pytest.Session) -> None:
    path: Path | None = session.config.option.cpu_times
    if path is not None:
        kept = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        kept |= {name: round(each, 3) for name, each in session.config.stash[_TIMES].items()}
        path.write_text(json.dumps(dict(sorted(kept.items())), indent=1) + "\n", encoding="utf-8")


# What a complete machine has, by what a skipped test says that it misses.
REMEDIES = (
    ("mosquitto", "apt-get install mosquitto"),
    ("chromium", "apt-get install chromium, pip install 'pilewatch[browser]'"),
    ("laywright", "pip install 'pilewatch[browser]'"),
    ("network namespaces", "run as root with iproute2"),
    ("pyoma2", "pip install 'pilewatch[bench]'"),
    ("koma", "pip install 'pilewatch[bench]'"),
    ("pybmodes", "pip install 'pilewatch[bench]'"),
    ("openseespy", "pip install openseespy, apt-get install libblas3 liblapack3"),
    ("grpc", "pip install 'pilewatch[dev]'"),
    ("matplotlib", "pip install 'pilewatch[plot]'"),
    ("pandas", "pip install 'pilewatch[notebook]'"),
    ("`notebook`", "pip install 'pilewatch[notebook]'"),
    ("not installed", "pip install -e '.[dev]'"),
)


def not_run_here(skipped: Mapping[str, list[str]]) -> list[str]:
    """Return lines for people: the reasons for which tests were skipped, and what helps."""
    if not skipped:
        return []
    n_tests = sum(map(len, skipped.values()))
    lines = [f"{n_tests} tests were skipped that a complete machine runs:"]
    for reason, tests in sorted(skipped.items()):
        helps = next((remedy for word, remedy in REMEDIES if word in reason), "")
        modules = sorted({_module(test) for test in tests})
        lines.append(f"  {len(tests)} × {reason}{f' ({helps})' if helps else ''}")
        lines.append(f"      {', '.join(modules)}")
    return lines


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    skipped: dict[str, list[str]] = defaultdict(list)
    for report in terminalreporter.stats.get("skipped", []):
        said = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        skipped[said.removeprefix("Skipped: ")].append(report.nodeid)
    lines = not_run_here(skipped)
    if lines:
        terminalreporter.section("not run on this machine")
        for line in lines:
            terminalreporter.write_line(line)


def write_quick_list(times: Mapping[str, float]) -> None:
    """Choose the modules of the quick tier: the shortest ones, while they fit."""
    chosen, total = [], 0.0
    for module, seconds in sorted(times.items(), key=lambda entry: entry[1]):
        if seconds < SLOW_SHARE and total + seconds < QUICK_TIME:
            chosen.append(module)
            total += seconds
    head = f"# {len(chosen)} modules, {total:.0f} CPU s together; written by tests.tiers\n"
    QUICK_LIST.write_text(head + "\n".join(sorted(chosen)) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write_quick_list(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))
