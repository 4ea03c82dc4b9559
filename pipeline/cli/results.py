"""What a session, or the updating from a recording, tells a person."""

from typing import TYPE_CHECKING, Any

from pipeline.cli.console import escaped, output

if TYPE_CHECKING:
    from pipeline.scenario import Scenario
    from pipeline.summary import SessionSummary


def print_results(
    summary: "SessionSummary",
    figures: dict[str, Any],
    *,
    scenario: "Scenario",
    misfits: bool = False,
) -> None:
    """Modes, posterior, changes, windows not used, doubts.

    figures   the content of summary.json
    scenario  of the session; without a structural model there is no posterior to speak of
    misfits   also how each mode fits; always where the posterior is not to be trusted
    """
    from pipeline.model_modes import nearest_modes
    from pipeline.tables import (
        identified_modes_table,
        misfit_table,
        nearest_modes_table,
        posterior_table,
    )

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
    for rejected in figures["windows"]["rejected"]:
        output.print(f"window at {rejected['start']:.0f} s not used: {rejected['reason']}")
    for warning in figures["warnings"]:
        output.print(f"[yellow]{warning['code']}[/]: {escaped(warning['text'])}")
