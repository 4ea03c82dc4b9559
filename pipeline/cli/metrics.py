"""`pilewatch metrics`: the figures of sessions that run elsewhere, for Prometheus."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.console import (
    ConnectOption,
    ModeOption,
    ZenohConfigOption,
    people,
    stopped_by_signals,
    zenoh_settings,
)


def metrics(
    connect: ConnectOption = None,
    port: Annotated[int, typer.Option(help="Where Prometheus asks; 0: any that is free.")] = 9464,
    address: Annotated[
        str,
        typer.Option(help="Of this machine, to listen on; only this machine reaches 127.0.0.1."),
    ] = "127.0.0.1",
    mode: ModeOption = "peer",
    zenoh_config: ZenohConfigOption = None,
    out: Annotated[Path, typer.Option(help="Folder of the session that runs here.")] = Path("out"),
) -> None:
    """Serve rates, gaps, lag, modes, stiffness and change probability to Prometheus."""
    from pipeline.monitoring.metrics import MetricsDesk, listened, served
    from pipeline.monitoring.status import endpoint_of
    from pipeline.runtime.runner import open_session
    from pipeline.transport.zenoh_bus import ZenohBus

    where = connect or ([] if zenoh_config else [endpoint_of(out)])
    settings = zenoh_settings(mode, None, where, zenoh_config)
    desk = MetricsDesk()
    with (
        stopped_by_signals() as stopping,
        served(desk, port, address) as served_port,
        open_session(lambda: ZenohBus(settings)) as bus,
    ):
        people.print(f"Figures at http://{address}:{served_port}/metrics; Ctrl-C ends it.")
        listened(desk, bus, stopping)
