"""What an archive holds of each turbine, and under what scenario it is taken."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from pipeline.archive.access.remote import name_of
from pipeline.archive.history.layout_periods import LayoutPeriod, Renamed, layout_history
from pipeline.archive.identification import IdentificationCall
from pipeline.archive.plan import Overlap, TurbinePlan, parts_by_turbine, turbine_plan
from pipeline.archive.posteriors import UpdatingPlan
from pipeline.archive.survey import FileSurvey, Part
from pipeline.recording.file_order import utc_span
from pipeline.scenario import (
    Scenario,
    farm_members,
    load_scenario,
    modes_only,
    scenario_from_metadata,
    with_sampler,
)
from pipeline.scenario.differences import other_settings
from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.layout import SensorLayout, joined_layout

MOST_CHANGES = 5  # of a turbine's layout that are reported one by one
MOST_CHANNELS_WITHOUT_LAYOUT = 64  # that a file without a layout is expected to have


@dataclass(frozen=True, slots=True, eq=False)
class TurbineArchive:
    """One turbine's share of an archive, and under what scenario it is taken."""

    plan: TurbinePlan
    scenario: Scenario
    layouts: tuple[SensorLayout, ...]
    """That its samples were taken with, in order of time."""
    periods: tuple[LayoutPeriod, ...] = ()
    """Of which layout its windows are, in order of time; () one holds for all."""
    period_of_task: tuple[int, ...] = ()
    """Number of each task's period; () all are of the first."""
    renamed: tuple[Renamed, ...] = ()
    """Channels of each task that the layouts of the periods call otherwise; () of none."""
    other_settings: tuple[str, ...] = ()
    """Which recordings store other settings than those that all are processed with, a line each."""

    @property
    def layout(self) -> SensorLayout | None:
        """The newest of all units together; None: no file has one."""
        if self.periods:
            return self.periods[-1].layout
        newest = {layout.unit: layout for layout in self.layouts}
        return joined_layout([newest[unit] for unit in sorted(newest)]) if newest else None

    @property
    def channels(self) -> tuple[str, ...]:
        """Every one that a window may have: of one unit, of units joined, of unknown layout."""
        periods = (period.layout for period in self.periods)
        named = [each for each in (self.layout, *periods, *self.layouts) if each is not None]
        names = [name for each in named for name in each.channel_names]
        most = max(
            (len(layout.channels) for layout in self.layouts), default=MOST_CHANNELS_WITHOUT_LAYOUT
        )
        return tuple(dict.fromkeys([*names, *(f"channel {i + 1}" for i in range(most))]))

    @property
    def identification(self) -> Iterator[IdentificationCall]:
        """Return the identification of every task, in order of time."""
        numbers = self.period_of_task or (0,) * len(self.plan.tasks)
        renamed = self.renamed or ((),) * len(self.plan.tasks)
        for task, period, names in zip(self.plan.tasks, numbers, renamed, strict=True):
            own = tuple(each for each in self.layouts if each.layout_id in task.layout_ids)
            yield IdentificationCall(task, self.scenario.oma, own, period, names)

    @property
    def updating(self) -> UpdatingPlan | None:
        """Return the plan of the updating with the newest layout; None without a structural model
        or a layout."""
        if not self.scenario.has_structure or self.layout is None:
            return None
        return UpdatingPlan(
            structure=self.scenario.structure,
            layout=self.layout,
            settings=self.scenario.updating,
            operation=self.scenario.operation,
            seed=self.scenario.seed,
            population=self.scenario.population,
        )

    @property
    def updating_by_period(self) -> tuple[UpdatingPlan, ...]:
        """Return the plan of each layout period, in order of time; () none is updated."""
        if self.updating is None:
            return ()
        if len(self.periods) < 2:  # the newest layout, as earlier versions had it of all
            return (self.updating,)
        return tuple(replace(self.updating, layout=period.layout) for period in self.periods)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Return what its recordings do not have in common, a line each for people."""
        overlaps = dict.fromkeys(map(_overlap_text, self.plan.overlaps))  # once for all units
        changes = self.layout_changes
        more = len(changes) - MOST_CHANGES
        last = (f"and {more} more changes of the layout",) if more > 0 else ()
        return (*overlaps, *changes[:MOST_CHANGES], *last, *self.other_settings)

    @property
    def layout_changes(self) -> tuple[str, ...]:
        """Return where the layout changes, in order of time; () where nothing is updated."""
        if not self.updating_by_period:
            return ()
        return tuple(
            f"channel {after.changed.channel} {after.changed.before} in {name_of(before.last)}, "
            f"{after.changed.after} in {name_of(after.first)}; each window is updated with its own "
            f"recording's layout, and the posterior begins again with {name_of(after.first)}"
            for before, after in pairwise(self.periods)
            if after.changed is not None
        )

    @property
    def n_windows(self) -> int:
        """Windows of all tasks; as many as fit into a file that must be read to know."""
        hop = self.scenario.oma.hop * NANOSECONDS
        return sum(
            task.n_windows or max(1, round((task.end_ns - task.start_ns) / hop))
            for task in self.plan.tasks
        )


def _overlap_text(overlap: Overlap) -> str:
    first, second = name_of(overlap.first), name_of(overlap.second)
    used = "both are used" if overlap.used_twice else f"those of {second} are left out"
    span = utc_span(overlap.start_ns, overlap.end_ns)
    return f"{first} and {second} both cover {span}; {used}"


def archived_turbines(
    surveys: Sequence[FileSurvey], scenario: str | None, sampler: str | None
) -> tuple[TurbineArchive, ...]:
    """Return what an archive holds of every turbine, in order of their names.

    Raises ScenarioError, and UpdatingError for a sampler that does not exist.
    """
    chosen = None if scenario is None else load_scenario(scenario)
    turbines = []
    for turbine, parts in parts_by_turbine(surveys).items():
        stored = [] if chosen else _stored_scenarios(parts, surveys)
        newest = [scenario_from_metadata(kept, f"scenario in {name}") for name, kept in stored[:1]]
        own = _of_turbine(turbine, next(iter(newest), chosen or modes_only(turbine)))
        other = tuple(other_settings(stored, own, turbine))
        own = own if sampler is None else with_sampler(own, sampler)
        layouts = _layouts_of(turbine, parts, surveys)
        plan = turbine_plan(parts, own.oma)
        stated = layout_history(plan.tasks, surveys)
        turbines.append(
            TurbineArchive(
                plan,
                own,
                layouts,
                periods=stated.periods,
                period_of_task=stated.period_of_task,
                renamed=stated.renamed,
                other_settings=other,
            )
        )
    return tuple(turbines)


def _of_turbine(turbine: str, scenario: Scenario) -> Scenario:
    """Return the scenario with the structure that its farm gives the turbine."""
    members = {member.turbine.id: member for member in farm_members(scenario)}
    return replace(scenario, turbine=members.get(turbine, scenario).turbine)


def _stored_scenarios(
    parts: Sequence[Part], surveys: Sequence[FileSurvey]
) -> list[tuple[str, dict[str, str]]]:
    """Return name and stored scenario of each of the turbine's files, the newest first."""
    stored = {survey.path: survey.scenario for survey in surveys if survey.scenario}
    paths = dict.fromkeys(part.path for part in reversed(parts) if part.path in stored)
    return [(name_of(path), dict(stored[path])) for path in paths]


def _layouts_of(
    turbine: str, parts: Sequence[Part], surveys: Sequence[FileSurvey]
) -> tuple[SensorLayout, ...]:
    """Return the layouts that the turbine's samples were taken with, in order of time."""
    known = {
        layout.layout_id: layout
        for survey in surveys
        for layout in survey.layouts
        if layout.turbine == turbine
    }
    used = dict.fromkeys(part.layout_id for part in parts)
    return tuple(known[layout_id] for layout_id in used if layout_id in known)
