"""The state of all turbines of a session: which need attention, and their stiffnesses.

One row a turbine, in the order in which they appeared. No rerun here.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.messages import FoundationPosterior
from pipeline.state.phrases import count_noun
from pipeline.state.posterior_json import STIFFNESSES, plus_minus
from pipeline.viewer.pictures.corner import Text
from pipeline.viewer.pictures.status_text import (
    SessionStatus,
    StatusIndicator,
    clock_time,
)

ROWS_OF_TURBINES = 24  # of indicators in a column of turbines
INDICATOR_X = (3.0, 4.6, 6.6)  # measurements, modes, foundation [picture units]
COLUMN = 9.0  # from one column of turbines to the next [picture units]
HEADS = ("data", "modes", "foundation")


@dataclass(frozen=True, slots=True, eq=False)
class StatusIndicators:
    """Status indicators of all turbines, a row each; picture units, y down."""

    positions: tuple[tuple[float, float], ...]
    indicators: tuple[StatusIndicator, ...]
    """One per position."""
    texts: tuple[Text, ...]


def status_indicators(statuses: Sequence[SessionStatus]) -> StatusIndicators:
    """Return three indicators per turbine: measurements, modes, foundation."""
    places = [_position(number) for number in range(len(statuses))]
    columns = range(1 + (len(statuses) - 1) // ROWS_OF_TURBINES)
    heads = [
        Text((column * COLUMN + x, -1.0), head)
        for column in columns
        for x, head in zip(INDICATOR_X, HEADS, strict=True)
    ]
    names = [
        Text((x + 1.0, y - 0.3), status.turbine)
        for (x, y), status in zip(places, statuses, strict=True)
    ]
    return StatusIndicators(
        positions=tuple((x + indicator_x, y) for x, y in places for indicator_x in INDICATOR_X),
        indicators=tuple(indicator for status in statuses for indicator in status.indicators),
        texts=(*heads, *names),
    )


def board_bounds(n_turbines: int) -> tuple[list[float], list[float]]:
    """Return x and y range of the indicators of all turbines."""
    columns = 1 + (n_turbines - 1) // ROWS_OF_TURBINES
    return [-0.8, columns * COLUMN - 1.5], [-1.8, max(3.0, min(n_turbines, ROWS_OF_TURBINES) - 0.2)]


def _position(number: int) -> tuple[float, float]:
    return (number // ROWS_OF_TURBINES) * COLUMN, float(number % ROWS_OF_TURBINES)


def farm_markdown(statuses: Sequence[SessionStatus]) -> str:
    """Return counts of states, the turbines that need attention, and a table of all."""
    states = Counter(_state(status) for status in statuses)
    counts = ", ".join(f"{count} {state}" for state, count in states.most_common())
    parts = [
        f"### {count_noun(len(statuses), 'turbine')}: {counts}",
        *_lines_needing_attention(statuses),
    ]
    heads = (
        *("turbine", "foundation", *(f"{name} ÷ nominal" for name in STIFFNESSES)),
        *("lowest mode [Hz]", "windows used", "rejected", "gaps", "until (UTC)"),
    )
    lines = [heads, ("---",) * len(heads), *(_row(status) for status in statuses)]
    table = "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
    return "\n\n".join(
        [
            *parts,
            table,
            "Median ± half of the 90 % interval, or the interval; each turbine has a tab.",
        ]
    )


def _state(status: SessionStatus) -> str:
    """Return the state of the foundation, without its first word."""
    return status.indicators[-1].text.removeprefix("foundation: ")


def _lines_needing_attention(statuses: Sequence[SessionStatus]) -> list[str]:
    """Return the indicators that are not good, turbine by turbine; bad ones first."""
    lines: dict[str, list[str]] = {"bad": [], "warning": []}
    for status in statuses:
        wrong = [indicator for indicator in status.indicators if indicator.state in lines]
        if wrong:
            worst = "bad" if any(indicator.state == "bad" for indicator in wrong) else "warning"
            texts = "; ".join(indicator.text for indicator in wrong)
            lines[worst].append(f"- **{status.turbine}**: {texts}")
    listed = [*lines["bad"], *lines["warning"]]
    return ["\n".join(listed)] if listed else []


def _row(status: SessionStatus) -> tuple[str, ...]:
    state = status.state
    modes = state.estimate.modes if state.estimate else ()
    lowest = min((mode.frequency for mode in modes), default=None)
    *stiffness, used, until = _stiffness_cells(state.posterior)
    return (
        *(status.turbine, _state(status), *stiffness),
        "–" if lowest is None else f"{lowest:.4f}",
        *(used, str(state.n_rejected), str(state.n_gaps), until),
    )


def _stiffness_cells(posterior: FoundationPosterior | None) -> tuple[str, ...]:
    """Stiffnesses, number of windows and the end of the last one."""
    if posterior is None:
        return (*("–" for _ in STIFFNESSES), "0", "–")
    springs = (plus_minus(posterior.parameter(name)) for name in STIFFNESSES)
    return (*springs, str(posterior.n_windows), clock_time(posterior.time_ns))
