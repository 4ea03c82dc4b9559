"""Which layout of its sensors a turbine's windows are updated with, as its recordings state it.

    recordings  |— a: 41 m —|— b: 41 m —|— c: 30 m —|
    periods     |———————————0———————————|—————1—————|     the posterior begins again with c

Modes keep their names over a change. Sums of evidence are of one model of the sensors: they do not.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.archive.plan import IdentificationTask
from pipeline.archive.survey import FileSurvey
from sensors.acquisition.layout import (
    LayoutDifference,
    SensorLayout,
    holds_for,
    joined_layout,
    layout_difference,
)


@dataclass(frozen=True, slots=True)
class LayoutPeriod:
    """Tasks in a row that one layout holds for."""

    layout: SensorLayout
    """Of all units together."""
    first: Path
    """File that it begins with."""
    last: Path
    """File that it ends with."""
    changed: LayoutDifference | None = None
    """From the period before; None: it is the first."""


def layout_periods(
    tasks: Sequence[IdentificationTask], surveys: Iterable[FileSurvey]
) -> tuple[tuple[LayoutPeriod, ...], tuple[int, ...]]:
    """Return the periods of a turbine in order of time, and of each task the number of its own.

    Parameters
    ----------
    tasks : sequence of IdentificationTask
        Of one turbine, in order of time.
    surveys : iterable of FileSurvey
        Of the archive. A file's own layout counts; where it has none, that of the same name.
    """
    stated = _stated(surveys)
    units = [_units_of(task, stated) for task in tasks]
    newest: dict[str, SensorLayout] = {}
    for own in reversed(units):  # a unit that comes later is known from the beginning
        newest |= own
    periods: list[LayoutPeriod] = []
    numbers = []
    for task, own in zip(tasks, units, strict=True):
        newest |= own
        if newest:
            layout = joined_layout([newest[unit] for unit in sorted(newest)])
            _extend(periods, layout, task.path)
        numbers.append(max(0, len(periods) - 1))
    return tuple(periods), tuple(numbers)


def _extend(periods: list[LayoutPeriod], layout: SensorLayout, path: Path) -> None:
    """Let a file go on in the last period, or begin one."""
    if not periods:
        periods.append(LayoutPeriod(layout, path, path))
        return
    last = periods[-1]
    changed = layout_difference(last.layout, layout)
    if changed is not None:
        periods.append(LayoutPeriod(layout, path, path, changed))
        return
    wider = layout if holds_for(layout, last.layout) else last.layout
    periods[-1] = LayoutPeriod(wider, last.first, path, last.changed)


def _stated(surveys: Iterable[FileSurvey]) -> dict[tuple[str, str, Path | None], SensorLayout]:
    """Layouts by turbine, name and file; None: whatever file."""
    stated: dict[tuple[str, str, Path | None], SensorLayout] = {}
    for survey in surveys:
        for layout in survey.layouts:
            for path in (survey.path, None):
                stated[layout.turbine, layout.layout_id, path] = layout
    return stated


def _units_of(
    task: IdentificationTask, stated: Mapping[tuple[str, str, Path | None], SensorLayout]
) -> dict[str, SensorLayout]:
    """Return the layout of each unit of a task, by its name."""
    found = (
        stated.get((task.turbine, name, task.path)) or stated.get((task.turbine, name, None))
        for name in task.layout_ids
    )
    return {layout.unit: layout for layout in found if layout is not None}
