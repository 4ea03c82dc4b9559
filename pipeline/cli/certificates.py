"""`pilewatch certificates`: who may publish and who may read, for a station and its towers."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.console import output
from sensors.errors import InputError


def certificates(
    folder: Annotated[Path, typer.Argument(help="Where certificates and configurations go.")],
    unit: Annotated[
        list[str] | None,
        typer.Option("--unit", help="TURBINE/UNIT that may publish; repeatable. Name all of them."),
    ] = None,
    viewer: Annotated[
        list[str] | None, typer.Option("--viewer", help="A name that may only read; repeatable.")
    ] = None,
    host: Annotated[
        str, typer.Option(help="Name or address at which the shore station listens.")
    ] = "localhost",
    port: Annotated[int, typer.Option(help="Its port.")] = 7447,
) -> None:
    """Make TLS certificates and Zenoh configurations with access control.

    What exists is kept; the configurations are written anew. Keep FOLDER out of version control.
    """
    from pipeline.deploy.access import SHORE, parse_unit, write_configurations
    from pipeline.deploy.certificates import AUTHORITY, make_certificates

    units = [parse_unit(text) for text in unit or ()]
    names = [SHORE, *(each.name for each in units), *(viewer or ())]
    taken = {name for name in names if names.count(name) > 1 or name == AUTHORITY}
    if taken:
        raise InputError(f"{', '.join(sorted(taken))} cannot name two machines or the authority")
    if not units and not viewer:
        raise InputError("nobody may connect: name --unit TURBINE/UNIT or --viewer NAME")
    made = make_certificates(folder, names, host=host)
    written = write_configurations(folder, units, viewer or (), host=host, port=port)
    output.print(f"new certificates: {', '.join(made) or 'none'}", soft_wrap=True)
    output.print("Written: " + ", ".join(str(path) for path in written), soft_wrap=True)
    output.print(f"On the shore: pilewatch run --source live --zenoh-config {folder}/{SHORE}.json5")
