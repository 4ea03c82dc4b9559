"""Which test modules execute a function: what `draw` chooses the tests of a fault by.

    python -m pytest -p tests.mutation.executed --executed FILE

runs the suite in one process and writes FILE; what it has of other modules of tests stays. Calls in
processes that tests start are not seen.
"""

import json
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
TOPS = ("sensors/", "pipeline/")


class Calls:
    """Functions that were called while each test module, or each shared fixture, had its turn."""

    def __init__(self) -> None:
        self.of: dict[str, set[CodeType]] = defaultdict(set)
        self.fixtures: dict[str, set[str]] = defaultdict(set)  # shared ones that a module needs
        self.seconds: dict[str, float] = defaultdict(float)
        self._now: set[CodeType] = set()

    def __call__(self, frame: FrameType, event: str, argument: Any) -> None:
        """Note a call, and trace no line of what is called."""
        self._now.add(frame.f_code)

    def begin(self, turn: str) -> set[CodeType]:
        """Note what is called from now on as of a turn; return what was noted to before."""
        before, self._now = self._now, self.of[turn]
        return before

    def end(self, before: set[CodeType]) -> None:
        """Go back to the turn before."""
        self._now = before

    def modules(self) -> dict[str, set[CodeType]]:
        """Return what each test module calls, alone or by a fixture that another one made."""
        return {
            module: self.of[module].union(*(self.of[each] for each in self.fixtures[module]))
            for module in self.seconds
        }


_CALLS = Calls()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--executed", type=Path, required=True, help="write who calls which function")


def pytest_runtestloop() -> None:
    threading.settrace(_CALLS)
    sys.settrace(_CALLS)


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: Any, request: Any) -> Iterator[object]:
    if fixturedef.scope != "session":
        return (yield)
    before = _CALLS.begin(fixturedef.argname)
    try:
        return (yield)
    finally:
        _CALLS.end(before)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[object]:
    module = item.nodeid.split("::")[0]
    _CALLS.fixtures[module] |= set(getattr(item, "fixturenames", ()))
    before, started = _CALLS.begin(module), time.process_time()
    sys.settrace(_CALLS)  # a test that traces, too, has taken its own away
    try:
        return (yield)
    finally:
        _CALLS.end(before)
        _CALLS.seconds[module] += time.process_time() - started


def pytest_sessionfinish(session: pytest.Session) -> None:
    sys.settrace(None)
    file: Path = session.config.option.executed
    kept = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    found: dict[str, set[str]] = defaultdict(set)
    for function, modules in kept.get("executing", {}).items():
        found[function] = set(modules) - _CALLS.seconds.keys()
    for module, called in _CALLS.modules().items():
        for code in called:
            if function := _name_of(code):
                found[function].add(module)
    seconds = {module: round(each, 2) for module, each in _CALLS.seconds.items()}
    content = {
        "seconds": dict(sorted((kept.get("seconds", {}) | seconds).items())),
        "executing": {name: sorted(modules) for name, modules in sorted(found.items()) if modules},
    }
    file.write_text(json.dumps(content, indent=1), encoding="utf-8")


def _name_of(code: CodeType) -> str | None:
    """Return `place::function` of the product's own code, a class's method as `Class.method`."""
    place = code.co_filename.removeprefix(f"{ROOT}/")
    if not place.startswith(TOPS) or code.co_qualname.startswith("<"):
        return None
    return f"{place}::{code.co_qualname.split('.<locals>')[0]}"
