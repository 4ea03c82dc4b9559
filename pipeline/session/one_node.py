"""One node of a session's graph by itself: `pilewatch node NAME`."""

import threading
from dataclasses import replace

from pipeline import runner
from pipeline.app import build
from pipeline.kept_answers import FOLDER as TRACKS
from pipeline.nodes.shard import ShardedNode, parsed_shard
from pipeline.recording.latest_messages import files_of
from pipeline.session.folder import (
    PICTURES,
    RECORDING,
    make_folder,
    set_aside,
    set_checkpoints_aside,
    set_tracks_aside,
)
from pipeline.session.options import SessionOptions
from pipeline.session.processes import SHARED
from pipeline.session.running import session_outputs
from pipeline.sources import Source
from pipeline.transport.zenoh_bus import ZenohBus
from sensors.errors import InputError


def run_node(
    name: str,
    source: Source,
    options: SessionOptions,
    stopping: threading.Event,
    shard: str | None = None,
) -> None:
    """One node of the graph by itself, until `stopping` is set.

    shard   "2/4": of the turbines, those that are the second of four such nodes'

    Raises InputError for a node that the graph does not have or that cannot be shared, NodeFailed
    for one that failed.
    """
    outputs = session_outputs(
        source, options, () if options.fresh else files_of(options.out / RECORDING)
    )
    outputs = replace(outputs, tracks=options.out / TRACKS)
    graph = build(source.scenario, source.layout, outputs, source.layouts)
    plans = {plan.name: plan for plan in graph}
    if name not in plans:
        raise InputError(f"there is no node {name!r}; there are {', '.join(plans)}")
    if shard is not None and name not in SHARED:
        raise InputError(f"--shard is for {' and '.join(SHARED)}, not for {name}")
    with runner.one_blas_thread(), runner.open_session(lambda: ZenohBus(options.zenoh)) as bus:
        make_folder(options.out)
        if options.fresh and name == "updating":
            set_checkpoints_aside(options.out)
        if options.fresh and name == "identification":
            set_tracks_aside(options.out)
        if name == "viewer" and (options.out / PICTURES).exists():
            set_aside(options.out / PICTURES)  # of the viewer that this one follows
        node = plans[name].make()
        if shard is not None:
            node = ShardedNode(node, parsed_shard(shard, source.turbines))
        runner.serve(node, bus, turbine=source.layout.turbine, stopping=stopping)
