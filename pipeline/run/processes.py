"""Nodes as processes: their command lines, and their shares of the turbines."""

import sys
from collections.abc import Sequence

from pipeline.nodes.node import Plan
from pipeline.nodes.sharding import Shard
from pipeline.run.endpoints import bus_options
from pipeline.run.options import SessionOptions
from pipeline.runtime.supervisor import SupervisedProcess
from pipeline.sources.sources import Source
from pipeline.transport.zenoh_bus import ZenohSettings
from pipeline.viewer.outputs.outputs import ConnectedViewer
from sensors.errors import InputError

SHARED = ("identification", "updating")  # nodes whose turbines several processes can share


def processes(
    plan: Plan, command: Sequence[str], shards: int, *, inherited: Sequence[int] = ()
) -> list[SupervisedProcess]:
    """Return the node in a process, or its shares of the turbines in one each.

    Parameters
    ----------
    plan : Plan
        Of the node.
    command : sequence of str
        That runs the node.
    shards : int
        How many processes share the turbines.
    inherited : sequence of int, optional
        File descriptors that the processes keep open, such as the folder's lock.
    """
    if shards == 1 or plan.name not in SHARED:
        return [SupervisedProcess(plan.node, command, inherited=inherited)]
    return [
        SupervisedProcess(
            plan.node,
            [*command, "--shard", f"{number}/{shards}"],
            name=plan.name + Shard(number, shards).suffix,
            inherited=inherited,
        )
        for number in range(1, shards + 1)
    ]


def require_processes(options: SessionOptions) -> None:
    """Raises InputError where turbines are to be shared by other than processes."""
    if options.shards != 1 and options.way != "processes":
        raise InputError(f"--shards {options.shards} needs --processes, which shares the turbines")
    if options.shards < 1:
        raise InputError(f"--shards is {options.shards}; at least 1 process has all turbines")


def node_command(
    name: str, source: Source, options: SessionOptions, bus: ZenohSettings, scenario: str | None
) -> list[str]:
    """`pilewatch node` as another process, for the same graph as this session's."""
    command = [sys.executable, "-m", "pipeline", "node", name, "--tied", *bus_options(bus)]
    command += ["--out", str(options.out)]
    if source.recording is not None:
        command += ["--recording", str(source.recording)]
    if scenario is not None:
        command += ["--scenario", scenario]
    elif source.recording is None:
        command += ["--scenario", source.scenario.origin]
    for path in source.layout_files:
        command += ["--layout", str(path)]
    command += ["--sampler", source.scenario.updating.sampling.method]
    if isinstance(options.view, ConnectedViewer):
        command += ["--view", options.view.word]
    elif options.view is not None:
        command += ["--view", "spawn"]
    return command + ([] if options.rrd else ["--no-rrd"])
