"""A session from its source to its summary. Whatever ends it early, what was recorded is closed
properly and the summary reports what is known."""

import os
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.app import Outputs, build
from pipeline.messages import Message
from pipeline.monitoring.alarms.alarm_node import ALARMS_KEY, AlarmNode, running_alarm_node
from pipeline.monitoring.alarms.alarm_node import FOLDER as NOTICES
from pipeline.monitoring.alarms.channels import channels_of
from pipeline.monitoring.metrics import MetricsNode, delivery_families, served
from pipeline.monitoring.status import STATUS_KEY, StatusNode
from pipeline.monitoring.summary import SessionSummary
from pipeline.nodes.node import Node, Plan
from pipeline.nodes.sharding import ShardedNode, parsed_shard
from pipeline.recording.latest_messages import files_of
from pipeline.recording.rotation import FRESH, raw_files
from pipeline.run.endpoints import ZenohEndpoints, meeting_point, open_hub
from pipeline.run.folder import (
    PICTURES,
    RECORDING,
    SUMMARY,
    make_folder,
    prepare_folder,
    set_aside,
    set_checkpoints_aside,
    set_tracks_aside,
    write_summary,
)
from pipeline.run.options import SessionOptions
from pipeline.run.ownership import Ownership, epoch_of, is_fresh, owned
from pipeline.run.processes import SHARED, node_command, processes, require_processes
from pipeline.runtime.flow_control import UNACKNOWLEDGED_BLOCKS
from pipeline.runtime.lock_step import run_lock_step
from pipeline.runtime.node_thread import NodeThread, open_session, serve
from pipeline.runtime.runner import run_workers
from pipeline.runtime.snapshots import ANSWERS
from pipeline.runtime.snapshots import FOLDER as CHECKPOINTS
from pipeline.runtime.source_feed import BlockReport, Worker
from pipeline.runtime.watchdog import Watchdog, WatchdogNode, notified
from pipeline.sources.feed_publisher import FeedAccount
from pipeline.sources.replay_control import REPLAY_KEY, ReplayControl
from pipeline.sources.sources import Source
from pipeline.transport.zenoh_bus import ZenohBus
from pipeline.viewer.outputs.outputs import RrdFile, ViewerOutput, require_rerun
from sensors.acquisition.blocks import AccelerationBlock
from sensors.arrays import one_blas_thread
from sensors.errors import InputError
from sensors.json_values import Json


@dataclass(frozen=True, slots=True)
class FinishedRun:
    """What came out."""

    summary: SessionSummary
    figures: Json
    """The content of summary.json."""
    files: tuple[Path, ...]
    complete: bool
    """Whether summary.json could be written."""


def run_session(
    source: Source,
    options: SessionOptions,
    *,
    report: BlockReport | None = None,
    scenario_option: str | None = None,
    stopping: threading.Event | None = None,
) -> FinishedRun:
    """Run a source through the whole graph and write recording, pictures and summary.

    Parameters
    ----------
    report : callable, optional
        Called with every block that the source gives.
    scenario_option : str, optional
        As the person named it, for nodes in other processes.
    stopping : threading.Event, optional
        Ends the session when set (Ctrl-C, SIGTERM).

    Raises
    ------
    InputError
        For what a person can correct.
    NodeFailed
        For what must be looked into.
    """
    make_folder(options.out)
    with owned(options.out, fresh=options.fresh) as ownership:
        run = _Run(source, options, ownership, report, scenario_option, stopping)
        return run.finished()


@dataclass(frozen=True, slots=True)
class _Doors:
    """How the parts of a session find each other, and whom anybody can ask."""

    meeting: ZenohEndpoints
    status: StatusNode
    bus: ZenohBus


@dataclass(frozen=True, slots=True)
class _Run:
    """A run of a folder that this process owns; see `run_session`."""

    source: Source
    options: SessionOptions
    ownership: Ownership
    report: BlockReport | None
    scenario_option: str | None
    stopping: threading.Event | None

    def finished(self) -> FinishedRun:
        """Run until the source has ended; what came out.

        What can be refused (options, a port that is taken) is asked for before the files of an
        earlier session are touched: a mistake costs nothing.
        """
        started, out = time.monotonic(), self.options.out
        self._require_possible()
        with ExitStack() as stack:
            doors = None if self.options.way == "lock-step" else self._opened(stack)
            beside = (*_sinks_beside(self.options, stack),)
            prepared = replace(self, source=prepare_folder(self.source, out))
            outputs = prepared._outputs()
            source = prepared.source
            summary = SessionSummary(source.text, source.layout.turbine, live=source.is_live)
            try:
                prepared._run(outputs, summary, (summary, *beside), doors)
            finally:
                figures = summary.as_json(wall=time.monotonic() - started)
                complete = write_summary(out / SUMMARY, figures)
        written = (out / name for name in (RECORDING, PICTURES, SUMMARY))
        files = tuple(path for path in written if path.exists())
        return FinishedRun(summary, figures, files, complete)

    def _require_possible(self) -> None:
        """Raises InputError for options that go with no such run."""
        source, options = self.source, self.options
        require_processes(options)
        if options.way == "lock-step" and source.is_live:
            raise InputError("--lock-step cannot run a live source, which does not wait")
        _here(self._graph(session_outputs(source, options)), source, options.elsewhere)

    def _opened(self, stack: ExitStack) -> "_Doors":
        """What the session's parts meet at, and what it answers on; open until the stack closes."""
        source = self.source
        meeting, status = meeting_point(self.options.zenoh), StatusNode(source.text)
        key = f"{STATUS_KEY}/{source.layout.turbine}"
        hub = open_hub(meeting, status, key, self.options.out, self.stopping)
        return _Doors(meeting, status, stack.enter_context(hub))

    def _outputs(self) -> Outputs:
        """Files and viewers; of a live source with what earlier runs left unanswered."""
        source, options = self.source, self.options
        if options.fresh or not source.is_live:  # a replay is an experiment of its own
            set_checkpoints_aside(options.out)
            set_tracks_aside(options.out)
        goes_on = source.is_live and not options.fresh
        earlier = tuple(raw_files(options.out / RECORDING)) if goes_on else ()
        return session_outputs(source, options, earlier, epoch=self.ownership.epoch)

    def _graph(self, outputs: Outputs) -> tuple[Plan, ...]:
        source = self.source
        return build(source.scenario, source.layout, outputs, source.layouts)

    def _run(
        self,
        outputs: Outputs,
        summary: SessionSummary,
        sinks: Sequence[Node],
        doors: "_Doors | None",
    ) -> None:
        source, options = self.source, self.options
        graph = _here(self._graph(outputs), source, options.elsewhere)

        def count(block: AccelerationBlock) -> None:
            if not source.is_live:  # there the summary counts what it receives
                summary.run.fold(block)
            if self.report:
                self.report(block)

        if doors is not None:
            return self._run_on_bus(graph, sinks, count, doors)
        nodes = [*(plan.make() for plan in graph), *sinks]
        messages = source.messages(options.speed, self.stopping)
        return run_lock_step(
            messages,
            nodes,
            turbine=source.layout.turbine,
            report=count,
            stopping=self.stopping,
        )

    def _run_on_bus(
        self, graph: Sequence[Plan], sinks: Sequence[Node], report: BlockReport, doors: "_Doors"
    ) -> None:
        source, options, stopping = self.source, self.options, self.stopping
        turbine, bus = source.layout.turbine, doors.bus
        follows = options.speed == float("inf") and not source.is_live
        control = ReplayControl(source, options.speed, stopping)
        workers = [
            *self._workers(graph, doors.meeting),
            *_threads((*sinks, doors.status), doors.meeting, turbine),
        ]
        for each in sinks:
            if isinstance(each, AlarmNode):
                bus.answer(f"{ALARMS_KEY}/{turbine}", each.answer)
        if not source.is_live:
            bus.answer(f"{REPLAY_KEY}/{turbine}", control.answer)
        run_workers(
            _messages(source, control, stopping),
            workers,
            bus,
            turbine=turbine,
            unacknowledged_blocks=UNACKNOWLEDGED_BLOCKS if follows else None,
            report=report,
            stopping=stopping,
        )

    def _workers(self, graph: Sequence[Plan], meeting: ZenohEndpoints) -> Iterator[Worker]:
        """The nodes of the graph: in processes, which inherit the folder's lock, or in threads."""
        if self.options.way != "processes":
            nodes = (plan.make() for plan in graph)
            yield from _threads(nodes, meeting, self.source.layout.turbine)
            return
        held = (self.ownership.descriptor,)
        for plan in graph:
            command = node_command(
                plan.name, self.source, self.options, meeting.nodes, self.scenario_option
            )
            yield from processes(plan, command, self.options.shards, inherited=held)


def _threads(nodes: Iterable[Node], meeting: ZenohEndpoints, turbine: str) -> Iterator[Worker]:
    for node in nodes:
        yield NodeThread(node, lambda: ZenohBus(meeting.nodes), turbine)


def _sinks_beside(options: SessionOptions, stack: ExitStack) -> Iterator[Node]:
    """Watchdog, metrics and alarms, as the options ask for them; open until the stack closes."""
    if notified():
        yield WatchdogNode(Watchdog(os.environ))
    figures_node = None if options.metrics is None else MetricsNode()
    if figures_node is not None and options.metrics is not None:
        stack.enter_context(served(figures_node, options.metrics, option="--metrics"))
        yield figures_node
    if options.notices is not None:
        settings, channels = options.notices, channels_of(options.notices)
        folder = options.out / NOTICES
        running = running_alarm_node(folder, settings.notices, channels, settings.heartbeat)
        alarms = stack.enter_context(running)
        if figures_node is not None:
            figures_node.parts.append(lambda: delivery_families(alarms.delivery_states))
        yield alarms


def session_outputs(
    source: Source,
    options: SessionOptions,
    earlier: tuple[Path, ...] = (),
    *,
    epoch: int = 0,
    fresh: bool = False,
) -> Outputs:
    """Return the files and viewers of a session.

    Parameters
    ----------
    source : Source
        What the session reads.
    options : SessionOptions
        What the session writes and shows.
    earlier : tuple of Path, optional
        Recordings in which nodes find what they have not answered yet.
    epoch : int, optional
        Number of the run, by its folder's lock.
    fresh : bool, optional
        Whether it goes on from nothing of an earlier run; also where the options have it.

    Raises
    ------
    ViewerError
        If rerun is missing.
    """
    views: tuple[ViewerOutput, ...] = ()
    if options.rrd:
        views = (RrdFile(options.out / PICTURES, indexed=not source.is_live),)
    if options.view is not None:
        views += (options.view,)
    if views:
        require_rerun(views)
    name = f"{source.layout.turbine} {source.text}"
    kept = options.way != "lock-step"
    begins = {FRESH: "yes"} if source.is_live and (fresh or options.fresh) else {}
    return Outputs(
        recording=options.out / RECORDING,
        metadata={**source.metadata, "run": {"epoch": str(epoch)} | begins},
        views=views,
        session=name,
        checkpoints=options.out / CHECKPOINTS if kept else None,
        tracks=options.out / ANSWERS if kept else None,
        earlier=earlier,
        epoch=epoch,
        live=source.is_live,
    )


def _here(graph: tuple[Plan, ...], source: Source, elsewhere: Sequence[str]) -> tuple[Plan, ...]:
    """Return the graph without the nodes that other machines run."""
    names = [plan.name for plan in graph]
    for name in elsewhere:
        if name not in names:
            raise InputError(f"--elsewhere {name}: there is no such node; {', '.join(names)} are")
        if not source.is_live:
            raise InputError(f"--elsewhere {name} is for --source live, not for {source.text}")
    return tuple(plan for plan in graph if plan.name not in elsewhere)


def _messages(
    source: Source, control: ReplayControl, stopping: threading.Event | None
) -> Iterator[Message] | None:
    """Return what the session publishes itself; None where the instruments do."""
    if source.feed is not None:
        return FeedAccount(source.feed, source.layout).messages(stopping or threading.Event())
    return None if source.is_live else control.messages()


def run_node(
    name: str,
    source: Source,
    options: SessionOptions,
    stopping: threading.Event,
    shard: str | None = None,
    *,
    tied: bool = False,
) -> None:
    """Run one node of the graph by itself, until `stopping` is set.

    Parameters
    ----------
    shard : str, optional
        "2/4": of the turbines, those that are the second of four such nodes'.
    tied : bool, optional
        Whether the node is a run's, which owns the folder.

    Raises
    ------
    InputError
        For a node that has nothing to do here, that the graph does not have or that cannot be
        shared.
    NodeFailed
        For one that failed.
    """
    _require_work(name, source, options)  # before anything is written
    if shard is not None and name not in SHARED:
        raise InputError(f"--shard is for {' and '.join(SHARED)}, not for {name}")
    make_folder(options.out)
    with ExitStack() as stack:
        epoch, fresh = epoch_of(options.out), tied and is_fresh(options.out)
        if not tied:
            what = f"node {name}" if shard is None else f"node {name} {shard}"
            epoch = stack.enter_context(owned(options.out, what)).epoch
        recording = options.out / RECORDING
        earlier = () if options.fresh else tuple({*raw_files(recording), *files_of(recording)})
        outputs = session_outputs(source, options, earlier, epoch=epoch, fresh=fresh)
        graph = build(source.scenario, source.layout, outputs, source.layouts)
        plans = {plan.name: plan for plan in graph}
        if name not in plans:
            raise InputError(f"there is no node {name!r}; there are {', '.join(plans)}")
        stack.enter_context(one_blas_thread())
        bus = stack.enter_context(open_session(lambda: ZenohBus(options.zenoh, stopping)))
        if options.fresh and name == "updating":
            set_checkpoints_aside(options.out)
        if options.fresh and name == "identification":
            set_tracks_aside(options.out)
        if name == "viewer" and (options.out / PICTURES).exists():
            set_aside(options.out / PICTURES)  # of the viewer that this one follows
        node = plans[name].make()
        if shard is not None:
            node = ShardedNode(node, parsed_shard(shard, source.turbines))
        serve(node, bus, turbine=source.layout.turbine, stopping=stopping)


def _require_work(name: str, source: Source, options: SessionOptions) -> None:
    """Raise InputError for a node that the graph has only with a structure or an output."""
    if name == "updating" and not source.scenario.has_structure:
        raise InputError(
            f"updating needs a structure: scenario {source.scenario.name} has none; give "
            "--scenario NAME or FILE.toml whose [turbine] description names one"
        )
    if name == "viewer" and not options.rrd and options.view is None:
        raise InputError("the viewer has nothing to draw on: leave --no-rrd out or give --view")
