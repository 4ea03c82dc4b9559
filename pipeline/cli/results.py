"""What a session, or the updating from a recording, tells a person."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from pipeline.cli.console import escaped, output
from pipeline.state.json_values import Json

if TYPE_CHECKING:
    from pipeline.monitoring.summary import SessionSummary
    from pipeline.scenario import Scenario

TOLD_OF_A_KIND = 3  # doubts, and windows not used; all are in summary.json


def print_results(
    summary: "SessionSummary",
    figures: Json,
    *,
    scenario: "Scenario",
    misfits: bool = False,
) -> None:
    """Modes, posterior, changes, windows not used, doubts.

    figures   the content of summary.json
    scenario  of the session; without a structural model there is no posterior to speak of
    misfits   also how each mode fits; always where the posterior is not to be trusted
    """
    from pipeline.cli.tables.modes import identified_modes_table, nearest_modes_table
    from pipeline.cli.tables.posteriors import misfit_table, posterior_table
    from pipeline.offline.model_modes import nearest_modes

    output.print(identified_modes_table(summary.modes, figures["windows"]["identified"]))
    if not scenario.has_structure:
        output.print("Modes only: the scenario has no structural model.")
    elif summary.posterior is None:
        if summary.modes:
            output.print(nearest_modes_table(nearest_modes(summary.modes, scenario)))
        output.print("[bold]No posterior:[/] no window could be used.")
    else:
        output.print(posterior_table(figures["posterior"]))
        if misfits or not summary.posterior.trusted:
            output.print(misfit_table(summary.posterior))
        if not summary.posterior.trusted:
            output.print("[bold red]NOT TRUSTED[/]: the data contradict the model.")
    for event in figures["events"]:
        output.print(f"[bold]change:[/] {escaped(event['text'])}")
    for code, reasons in _by_code(figures["windows"]["rejected"]).items():
        for rejected in reasons[:TOLD_OF_A_KIND]:
            output.print(
                f"window at {rejected['start']:.0f} s not used: {escaped(rejected['reason'])}"
            )
        _print_rest(reasons, f"windows not used ({code})")
    for code, doubts in _by_code(figures["warnings"]).items():
        for doubt in doubts[:TOLD_OF_A_KIND]:
            output.print(f"[yellow]{code}[/]: {escaped(doubt['text'])}")
        _print_rest(doubts, code)


def _by_code(told: Sequence[Json]) -> dict[str, list[Json]]:
    """Code → what has it, in the order in which each was first told."""
    found: dict[str, list[Json]] = {}
    for each in told:
        found.setdefault(each["code"], []).append(each)
    return found


def _print_rest(told: Sequence[Json], kind: str) -> None:
    if (rest := len(told) - TOLD_OF_A_KIND) > 0:
        output.print(f"[dim]… and {rest} more {kind}[/]")
