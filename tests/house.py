"""Figures of the house: `python -m tests.house`.

lines     of code, without docstrings and comments: the product and some of its rooms
arrows    which room imports which
chain     the longest chain of imports, by grimp
passed    product files that a block passes in lock-step, and its moves from file to file: a
          block within a window, and the one that closes a window
"""

import ast
import io
import json
import sys
import tokenize
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from types import FrameType
from typing import Any

from pipeline.app import Outputs, build
from pipeline.runtime.lock_step import NodeAccount, _dispatch
from pipeline.runtime.source_feed import with_end
from pipeline.sources.sources import replayed
from sensors.acquisition.blocks import AccelerationBlock
from sensors.arrays import one_blas_thread
from tests.test_layout import arrows_between_rooms, imports, longest_chain
from tests.test_scenario_keys import settings_keys

ROOT = Path(__file__).parents[1]
RECORDING = ROOT / "recordings" / "parked.mcap"
FIRST_WINDOW = 700  # blocks after which the first window is closed and drawn upon
N_MEDIAN = 60  # blocks at the start, of which the median is taken
MUCH_MORE = 3  # files that the closing of a window passes, over those of a plain block [-]
TOPS = ("sensors", "pipeline")
ROOMS = {
    "restart": (
        "pipeline/runtime/snapshots.py",
        "pipeline/nodes/by_turbine.py",
        "pipeline/nodes/units/resuming.py",
    ),
    "state": ("pipeline/state",),
    "accounts": (
        *("pipeline/monitoring/summary.py", "pipeline/monitoring/status.py"),
        *("pipeline/monitoring/metrics.py", "pipeline/monitoring/alarms/alarm_rules.py"),
        *("pipeline/viewer/pictures/status_text.py", "pipeline/viewer/pictures/farm_overview.py"),
        "pipeline/report/recorded_session.py",
    ),
    "nodes": ("pipeline/nodes",),
}


def lines_of_code(path: Path) -> int:
    """Lines of a module that hold code: no docstring, no comment, no blank."""
    text = path.read_text("utf-8")
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    silent = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT)
    code = {
        line
        for token in tokens
        if token.type not in (*silent, tokenize.ENDMARKER)
        for line in range(token.start[0], token.end[0] + 1)
    }
    documented = [
        node.body
        for node in ast.walk(ast.parse(text))
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef))
    ]
    for body in documented:
        for each in body:  # docstrings, and those of attributes
            if isinstance(each, ast.Expr) and isinstance(each.value, ast.Constant):
                code -= set(range(each.lineno, (each.end_lineno or 0) + 1))
    return len(code)


def modules_in(*places: str) -> Iterator[Path]:
    """The product's modules in files and folders."""
    for place in places:
        path = ROOT / place
        found = [path] if path.suffix else path.rglob("*.py")
        yield from (each for each in found if "_pb2" not in each.name)


def total(*places: str) -> dict[str, int]:
    """Lines of a room, all and those of code."""
    files = list(modules_in(*places))
    return {
        "lines": sum(len(each.read_text("utf-8").splitlines()) for each in files),
        "code": sum(map(lines_of_code, files)),
    }


@cache
def _product_file(name: str) -> str | None:
    path = Path(name)
    inside = path.is_relative_to(ROOT) and path.relative_to(ROOT).parts[0] in TOPS
    return str(path.relative_to(ROOT)) if inside else None


class Passed:
    """What a call of a function passes of the product: files, and moves from one to another."""

    def __init__(self) -> None:
        self.files: set[str] = set()
        self.moves = 0

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        """A profile function."""
        if event != "call" or (file := _product_file(frame.f_code.co_filename)) is None:
            return
        self.files.add(file)
        caller = frame.f_back
        while caller is not None and _product_file(caller.f_code.co_filename) is None:
            caller = caller.f_back
        self.moves += caller is not None and _product_file(caller.f_code.co_filename) != file

    def measured(self, call: Callable[[], None]) -> "Passed":
        """After that call."""
        sys.setprofile(self)
        try:
            call()
        finally:
            sys.setprofile(None)
        return self


def _passed() -> Iterator[tuple[bool, Passed]]:
    """Of every message of a recording in lock-step: whether it is a block, what it passes."""
    source = replayed(RECORDING)
    nodes = [plan.make() for plan in build(source.scenario, source.layout, Outputs())]
    accounts = [NodeAccount(node, source.layout.turbine, lambda: 0) for node in nodes]
    with one_blas_thread():
        for message in with_end(source.messages()):
            here = Passed().measured(partial(_dispatch, message, accounts))
            yield isinstance(message, AccelerationBlock), here


def passed_by_first_window() -> tuple[Passed, Passed]:
    """What the median block of the first minute passes, and the block that closes a window."""
    plain: list[Passed] = []
    for is_block, here in _passed():
        if len(plain) > N_MEDIAN and len(here.files) > MUCH_MORE * len(plain[-1].files):
            return sorted(plain[:N_MEDIAN], key=lambda passed: passed.moves)[N_MEDIAN // 2], here
        if is_block:
            plain.append(here)
    raise AssertionError("no window was closed")


def passed_by_second_window() -> tuple[Passed, Passed]:
    """What a block passes before the one that closes the second window, and that one."""
    n_blocks, plain = 0, Passed()
    for is_block, here in _passed():
        n_blocks += is_block
        if n_blocks > FIRST_WINDOW and len(here.files) > MUCH_MORE * len(plain.files):
            return plain, here
        plain = here
    raise AssertionError("no window was closed")


def _figures(passed: Passed) -> dict[str, Any]:
    return {"files": len(passed.files), "moves": passed.moves}


def figures() -> dict[str, Any]:
    """All of them."""
    chain = longest_chain()
    plain, closing = passed_by_second_window()
    return {
        "keys": len(settings_keys()),
        "modules": len(imports()),
        "product": total(*TOPS),
        **{room: total(*places) for room, places in ROOMS.items()},
        "arrows": len(arrows_between_rooms()),
        "chain": len(chain),
        "chain_of": chain,
        "passed": {"plain": _figures(plain), "closing": _figures(closing)},
    }


if __name__ == "__main__":
    print(json.dumps(figures(), indent=1))  # noqa: T201
