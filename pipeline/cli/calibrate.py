"""`pilewatch calibrate`: a first period of measurements makes the description surer."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.console import JsonOption, ScenarioOption, output, print_json, stderr
from sensors.errors import InputError


def calibrate(
    sessions: Annotated[
        list[Path],
        typer.Argument(help="Sessions of one turbine, with modes: best a week or more of tides."),
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Description with the calibration, TOML.")
    ] = Path("turbine.calibrated.toml"),
    scenario: ScenarioOption = None,
    design: Annotated[
        str | None,
        typer.Option(
            help="Springs of the design: K11,K22,K12 in N/m, N·m/rad, N/rad. They help to tell the "
            "figures from the springs; they are no prior of later sessions."
        ),
    ] = None,
    design_std: Annotated[
        float, typer.Option(help="Standard deviation of each, as a share of it.")
    ] = 0.2,
    as_json: JsonOption = False,
) -> None:
    """Infer the figures of a structure from its first weeks; later sessions begin with them.

    Give the written file as [turbine] description of the scenario.
    """
    from pipeline.cli.tables.calibration import calibration_table, unknown_lines
    from pipeline.offline.calibrate_turbine import calibrate_turbine
    from pipeline.updating.structural.periods.calibration import DesignSprings
    from sensors.atomic_write import written_whole

    if out.exists():
        raise InputError(f"{out} exists; -o names another file")
    if not out.parent.is_dir():
        raise InputError(f"{out}: there is no folder {out.parent}")
    springs = None if design is None else DesignSprings(_springs(design), design_std)
    with stderr.status("fitting springs and figures to all water levels"):
        found = calibrate_turbine(sessions, scenario=scenario, design=springs)
    written_whole(out, found.text.encode())
    if as_json:
        print_json({"file": str(out)} | found.as_json())
        return
    output.print(calibration_table(found))
    for line in unknown_lines(found):
        output.print(line, soft_wrap=True)
    if not found.level_known:
        output.print(
            "No water level was reported: the tide is part of every figure's uncertainty.",
            soft_wrap=True,
        )
    last = f'Written: {out}; use it with [turbine] description = "{out}"'
    output.print(last, soft_wrap=True, markup=False)


def _springs(text: str) -> tuple[float, float, float]:
    try:
        k11, k22, k12 = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(
            f"--design {text!r}: three numbers are needed, K11,K22,K12 in N/m, N·m/rad, N/rad"
        ) from None
    return k11, k22, k12
