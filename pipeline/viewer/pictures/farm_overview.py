"""All turbines of a session at a glance: who needs attention, and how stiff each one stands.

One row a turbine, in the order in which they appeared. No rerun here.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.messages import FoundationPosterior, ParameterSummary
from pipeline.viewer.pictures.corner import Text
from pipeline.viewer.pictures.status_text import (
    STIFFNESSES,
    SessionStatus,
    StatusIndicator,
    clock_time,
    counted,
)

ROWS = 24  # of the board of lamps, then it goes on in a further column
LAMP_X = (3.0, 4.4, 6.1)  # measurements, modes, foundation [picture units]
COLUMN = 8.5  # from one column of turbines to the next [picture units]
HEADS = ("data", "modes", "foundation")


@dataclass(frozen=True, slots=True, eq=False)
class StatusIndicators:
    """Lamps of all turbines, a row each; picture units, y down."""

    lights: tuple[tuple[float, float], ...]
    lamps: tuple[StatusIndicator, ...]  # one a light
    texts: tuple[Text, ...]


def lamp_board(statuses: Sequence[SessionStatus]) -> StatusIndicators:
    """Three lamps a turbine: its measurements, its modes, its foundation."""
    places = [_place(number) for number in range(len(statuses))]
    columns = range(1 + (len(statuses) - 1) // ROWS)
    heads = [
        Text((column * COLUMN + x, -1.0), head)
        for column in columns
        for x, head in zip(LAMP_X, HEADS, strict=True)
    ]
    names = [
        Text((x + 1.0, y - 0.3), status.turbine)
        for (x, y), status in zip(places, statuses, strict=True)
    ]
    return StatusIndicators(
        lights=tuple((x + lamp_x, y) for x, y in places for lamp_x in LAMP_X),
        lamps=tuple(lamp for status in statuses for lamp in status.lamps),
        texts=(*heads, *names),
    )


def board_bounds(n_turbines: int) -> tuple[list[float], list[float]]:
    """x and y range of the board."""
    columns = 1 + (n_turbines - 1) // ROWS
    return [-0.8, columns * COLUMN - 1.5], [-1.8, max(3.0, min(n_turbines, ROWS) - 0.2)]


def _place(number: int) -> tuple[float, float]:
    return (number // ROWS) * COLUMN, float(number % ROWS)


def farm_markdown(statuses: Sequence[SessionStatus]) -> str:
    """The verdict over all, those that need attention, and a table of all."""
    states = Counter(_state(status) for status in statuses)
    verdict = ", ".join(f"{count} {state}" for state, count in states.most_common())
    parts = [f"### {counted(len(statuses), 'turbine')}: {verdict}", *_attention(statuses)]
    heads = (
        *("turbine", "foundation", *(f"{name} ÷ nominal" for name in STIFFNESSES)),
        *("lowest mode [Hz]", "windows used", "rejected", "gaps", "until (UTC)"),
    )
    lines = [heads, ("---",) * len(heads), *(_row(status) for status in statuses)]
    table = "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
    return "\n\n".join([*parts, table, "Median ± half of the 90 % interval; a tab a turbine."])


def _state(status: SessionStatus) -> str:
    """What the lamp of the foundation says, without its first word."""
    return status.lamps[-1].text.removeprefix("foundation: ")


def _attention(statuses: Sequence[SessionStatus]) -> list[str]:
    """Whatever lamp is not good, turbine by turbine; first those with a bad one."""
    lines: dict[str, list[str]] = {"bad": [], "doubt": []}
    for status in statuses:
        wrong = [lamp for lamp in status.lamps if lamp.state in lines]
        if wrong:
            worst = "bad" if any(lamp.state == "bad" for lamp in wrong) else "doubt"
            words = "; ".join(lamp.text for lamp in wrong)
            lines[worst].append(f"- **{status.turbine}**: {words}")
    listed = [*lines["bad"], *lines["doubt"]]
    return ["\n".join(listed)] if listed else []


def _row(status: SessionStatus) -> tuple[str, ...]:
    lowest = min((mode.frequency for mode in status.modes), default=None)
    *stiffness, used, until = _knowledge(status.posterior)
    return (
        *(status.turbine, _state(status), *stiffness),
        "–" if lowest is None else f"{lowest:.4f}",
        *(used, str(status.n_rejected), str(status.n_gaps), until),
    )


def _knowledge(posterior: FoundationPosterior | None) -> tuple[str, ...]:
    """Stiffnesses, number of windows and the end of the last one."""
    if posterior is None:
        return (*("–" for _ in STIFFNESSES), "0", "–")
    ratios = (_ratio(posterior.parameter(name)) for name in STIFFNESSES)
    return (*ratios, str(posterior.n_windows), clock_time(posterior.time_ns))


def _ratio(spring: ParameterSummary) -> str:
    half_width = (spring.p95 - spring.p05) / 2 / abs(spring.nominal)
    return f"{spring.median / spring.nominal:.3f} ± {half_width:.3f}"
