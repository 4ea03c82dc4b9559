"""Which layout of its sensors a turbine's windows are updated with, as its recordings state it.

    recordings  |— a: 41 m —|— b: 41 m —|— c: 30 m —|
    periods     |———————————0———————————|—————1—————|     the posterior begins again with c

Modes keep their names over a change. Sums of evidence are of one model of the sensors: they do not.

A file is identified with its own units: where these use a channel name twice, its channels have
their unit's name too. Units that any file holds together are on the tower together, whether or not
one of them is in a file; a unit that took another one's place is alone.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.archive.plan import IdentificationTask
from pipeline.archive.survey import FileSurvey
from sensors.acquisition.layout import (
    Accelerometer,
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


Renamed = tuple[tuple[str, str], ...]
"""Names of channels as a file has them, each with that of the turbine's layout."""


@dataclass(frozen=True, slots=True)
class LayoutHistory:
    """The layouts of a turbine's windows, as its recordings state them."""

    periods: tuple[LayoutPeriod, ...]
    """In order of time."""
    period_of_task: tuple[int, ...]
    """Number of each task's period."""
    renamed: tuple[Renamed, ...]
    """Of each task the channels that its file alone would give another name."""


def layout_history(
    tasks: Sequence[IdentificationTask], surveys: Sequence[FileSurvey]
) -> LayoutHistory:
    """Return the layout periods of a turbine, and what each task's channels are called in them.

    Parameters
    ----------
    tasks : sequence of IdentificationTask
        Of one turbine, in order of time.
    surveys : sequence of FileSurvey
        Of the archive. A file's own layout counts; where it has none, that of the same name.
    """
    stated = _stated(surveys)
    in_file = {survey.path: survey.layouts for survey in surveys}
    units = [_units_of(task, stated) for task in tasks]
    groups = _groups(units)
    newest: _Units = {}
    for own in reversed(units):  # a unit that comes later is known from the beginning
        newest = {**newest, **own}
    periods: list[LayoutPeriod] = []
    numbers: list[int] = []
    renamed: list[Renamed] = []
    before: tuple[_Units, ...] = ()
    for task, own in zip(tasks, units, strict=True):
        newest = {**newest, **own}
        identified = _identified_units(task, own, in_file)
        if before != (newest, own, identified):  # of most files it is what it was
            before = (newest, own, identified)
            layout = _layout_at(newest, groups, own) if newest else None
            names = _renamed(identified, newest, groups)
        if layout is not None:
            _extend(periods, layout, task.path)
        numbers.append(max(0, len(periods) - 1))
        renamed.append(names)
    return LayoutHistory(tuple(periods), tuple(numbers), tuple(renamed))


_Units = Mapping[str, SensorLayout]  # layouts by the names of their units


def _groups(units: Iterable[Collection[str]]) -> list[frozenset[str]]:
    """Return the units that files hold together, directly or by others, each in one group."""
    groups: list[frozenset[str]] = []
    for own in dict.fromkeys(map(frozenset, units)):
        joined = [group for group in groups if group & own]
        groups = [group for group in groups if not group & own]
        groups.append(own.union(*joined))
    return groups


def _names(units: _Units) -> dict[tuple[str, str], str]:
    """Return what units that are joined call a channel, by its unit and its own name."""
    layouts = [units[unit] for unit in sorted(units)]
    if not layouts:
        return {}
    own = [(layout.unit, name) for layout in layouts for name in layout.channel_names]
    return dict(zip(own, joined_layout(layouts).channel_names, strict=True))


def _names_in(newest: _Units, groups: Sequence[frozenset[str]]) -> dict[tuple[str, str], str]:
    """Return the same of all units, those of each group joined."""
    names: dict[tuple[str, str], str] = {}
    for group in groups:
        names |= _names({unit: newest[unit] for unit in group})
    return names


def _layout_at(newest: _Units, groups: Sequence[frozenset[str]], own: _Units) -> SensorLayout:
    """Return the channels of all units; of two groups' of one name that of the file's own."""
    present = frozenset[str]().union(*(group for group in groups if group & own.keys()))
    names = _names_in(newest, groups)
    channels: dict[str, Accelerometer] = {}
    for unit in sorted(newest):
        for channel in newest[unit].channels:
            name = names[unit, channel.name]
            if unit in present or name not in channels:
                channels[name] = replace(channel, name=name)
    layouts = [newest[unit] for unit in sorted(present or newest)]
    together = joined_layout(layouts)
    if len(together.channels) == len(channels):
        return together
    return SensorLayout(
        "+".join(newest[unit].layout_id for unit in sorted(newest)),
        together.turbine,
        "+".join(sorted(newest)),
        tuple(channels.values()),
    )


def _identified_units(
    task: IdentificationTask, own: _Units, in_file: Mapping[Path, Iterable[SensorLayout]]
) -> _Units:
    """Return the units that the identification of a task joins: it reads every layout of a file,
    of units without a block too."""
    paths = dict.fromkeys([task.path, *(piece.path for piece in task.pieces)])
    there = [layout for path in paths for layout in in_file.get(path, ())]
    return {each.unit: each for each in there if each.turbine == task.turbine} | dict(own)


def _renamed(identified: _Units, newest: _Units, groups: Sequence[frozenset[str]]) -> Renamed:
    """Return which channels of a task have another name in the turbine's layout."""
    names = _names_in(newest, groups)
    return tuple(
        (name, names[channel])
        for channel, name in _names(identified).items()
        if names.get(channel, name) != name
    )


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
