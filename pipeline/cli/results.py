"""Print the results of a session or of the updating from a recording."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from pipeline.cli.console import escape_markup, output
from pipeline.state.phrases import WHAT_TO_DO, count_noun, figures_named
from sensors.json_values import Json

if TYPE_CHECKING:
    from pipeline.messages import FoundationPosterior
    from pipeline.monitoring.summary import SessionSummary
    from pipeline.scenario import Scenario
    from pipeline.state.turbine_state import TurbineState
    from sensors.acquisition.layout import SensorLayout

PRINTED_PER_CODE = 3  # warnings and rejected windows; all are in summary.json


def print_results(
    summary: "SessionSummary",
    figures: Json,
    *,
    scenario: "Scenario",
    layout: "SensorLayout",
    misfits: bool = False,
) -> None:
    """Print modes, posterior, changes, rejected windows, warnings.

    Parameters
    ----------
    figures : Json
        Content of summary.json.
    scenario : Scenario
        Scenario of the session; without a structural model there is no posterior.
    layout : SensorLayout
        Of the sensors that measured.
    misfits : bool, optional
        Whether to print the misfit of each mode; always printed for an untrusted posterior.
    """
    from pipeline.cli.tables.modes import identified_modes_table

    identified = figures["windows"]["identified"]
    if summary.main.modes:
        output.print(identified_modes_table(summary.main.modes, identified))
    else:
        length = f"a window is {scenario.oma.window_duration:g} s long"
        output.print(f"No modes: {count_noun(identified, 'window')} identified; {length}.")
    if not scenario.has_structure:
        output.print("Modes only: the scenario has no structural model.")
    elif summary.main.posterior is None:
        _print_nearest(summary.main, scenario, layout)
    else:
        _print_posterior(summary.main.posterior, figures["posterior"], misfits=misfits)
    for event in figures["events"]:
        output.print(f"[bold]change:[/] {escape_markup(event['text'])}")
        if event["revised"] is not None:
            output.print(escape_markup(f"  {event['revised']['text']}"))
    for code, reasons in _by_code(figures["windows"]["rejected"]).items():
        for rejected in reasons[:PRINTED_PER_CODE]:
            start = rejected["start"]  # null before anything was measured
            place = "window" if start is None else f"window at {start:.0f} s"
            output.print(f"{place} rejected: {escape_markup(rejected['reason'])}")
        _print_rest(reasons, f"rejected ({code})")
    for code, warnings in _by_code(figures["warnings"]).items():
        for warning in warnings[:PRINTED_PER_CODE]:
            output.print(f"[yellow]{code}[/]: {escape_markup(figures_named(warning['text']))}")
        _print_rest(warnings, code)


def _print_nearest(state: "TurbineState", scenario: "Scenario", layout: "SensorLayout") -> None:
    """Print the model's modes that the identified ones are nearest to, without a posterior."""
    from pipeline.cli.tables.modes import nearest_modes_table
    from pipeline.offline.model_modes import nearest_modes

    if state.modes:
        channels = state.estimates[-1].channels
        nearest = nearest_modes(state.modes, scenario.structure, layout, channels)
        output.print(nearest_modes_table(nearest))
    output.print("[bold]No posterior:[/] no window could be used.")


def _print_posterior(posterior: "FoundationPosterior", figures: Json, *, misfits: bool) -> None:
    from pipeline.cli.tables.posteriors import figures_tables, misfit_table, posterior_table

    for table in (posterior_table(figures), *figures_tables(figures)):
        output.print(table)
    if misfits or not posterior.trusted:
        output.print(misfit_table(posterior))
    if not posterior.trusted:
        output.print(f"[bold red]NOT TRUSTED[/]: the data contradict the model; {WHAT_TO_DO}.")


def _by_code(items: Sequence[Json]) -> dict[str, list[Json]]:
    """Return code → items with it, in the order of first occurrence."""
    found: dict[str, list[Json]] = {}
    for each in items:
        found.setdefault(each["code"], []).append(each)
    return found


def _print_rest(items: Sequence[Json], kind: str) -> None:
    if (rest := len(items) - PRINTED_PER_CODE) > 0:
        output.print(f"[dim]… and {rest} more {kind}[/]")
