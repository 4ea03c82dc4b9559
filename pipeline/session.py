"""One session from its source to its summary: what `pilewatch run` does.

Files of an earlier session are set aside under their date, never overwritten. Whatever ends the
session early, what was recorded is closed properly and the summary says what is known.
"""

import json
import logging
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from pipeline import runner
from pipeline.app import Outputs, Plan, build
from pipeline.checkpoints import FOLDER as CHECKPOINTS
from pipeline.feeding import FeedAccount
from pipeline.files import written_whole
from pipeline.json_values import Json
from pipeline.messages import Message
from pipeline.metrics import MetricsDesk, served
from pipeline.nodes.node import Node
from pipeline.nodes.shard import Shard, ShardedNode, parsed_shard
from pipeline.notices.channels import channels_of
from pipeline.notices.desk import FOLDER as NOTICES
from pipeline.notices.desk import KEY as NOTICES_KEY
from pipeline.notices.desk import NoticesDesk, desk_of
from pipeline.notices.settings import NoticesSettings
from pipeline.recording.parts import close_leftovers, raw_files
from pipeline.recording.recent import files_of
from pipeline.recording.writer import ACTIVE_SUFFIX
from pipeline.replay_control import KEY as REPLAY_KEY
from pipeline.replay_control import ReplayControl
from pipeline.sources import Source
from pipeline.status import ENDPOINT_FILE, StatusDesk
from pipeline.status import KEY as STATUS_KEY
from pipeline.summary import SessionSummary
from pipeline.supervisor import SupervisedProcess
from pipeline.transport.bus import Bus
from pipeline.transport.zenoh_bus import ZenohBus, ZenohSettings, free_endpoint, peer_of
from pipeline.transport.zenoh_settings import ANY_LOCAL_PORT
from pipeline.viewer.outputs import ConnectedViewer, RrdFile, ViewerOutput, require_rerun
from sensors.blocks import AccelerationBlock
from sensors.errors import InputError

logger = logging.getLogger(__name__)

RECORDING, PICTURES, SUMMARY = "session.mcap", "session.rrd", "summary.json"
SHARED = ("identification", "updating")  # nodes whose turbines several processes can share
Way = Literal["threads", "processes", "lock-step"]


@dataclass(frozen=True, slots=True)
class SessionOptions:
    """What a person may choose about a session, beside its source."""

    out: Path = Path("out")
    speed: float = float("inf")  # 1: real time; infinity: as fast as the nodes follow
    way: Way = "threads"
    rrd: bool = True  # write out/session.rrd
    view: ViewerOutput | None = None  # a viewer beside it
    zenoh: ZenohSettings = field(default_factory=ZenohSettings)
    fresh: bool = False  # begin anew, whatever checkpoint there is
    shards: int = 1  # processes that share the turbines, of each node that can be shared
    elsewhere: tuple[str, ...] = ()  # nodes of a live session that run on other machines
    metrics: int | None = None  # port on this machine where Prometheus may ask
    notices: NoticesSettings | None = None  # whom to tell of what; None: nobody


@dataclass(frozen=True, slots=True)
class Session:
    """What came out."""

    summary: SessionSummary
    figures: Json  # the content of summary.json
    files: tuple[Path, ...]
    complete: bool  # whether summary.json could be written


def run_session(
    source: Source,
    options: SessionOptions,
    *,
    report: Callable[[AccelerationBlock], None] | None = None,
    scenario_option: str | None = None,
    stopping: threading.Event | None = None,
) -> Session:
    """Run a source through the whole graph and write recording, pictures and summary.

    report            called with every block that the source gives
    scenario_option   as the person named it, for nodes in other processes
    stopping          ends the session when set (Ctrl-C, SIGTERM)

    Raises InputError for what a person can mend, NodeFailed for what must be looked into.
    """
    started = time.monotonic()
    source = prepare_folder(source, options.out)
    if options.fresh or not source.is_live:  # a replay is an experiment of its own
        set_checkpoints_aside(options.out)
    goes_on = source.is_live and not options.fresh
    outputs = session_outputs(
        source, options, tuple(raw_files(options.out / RECORDING)) if goes_on else ()
    )
    summary = SessionSummary(source.text, source.layout.turbine, live=source.is_live)

    def account(block: AccelerationBlock) -> None:
        if not source.is_live:  # there it counts what it hears
            summary.count(block)
        if report:
            report(block)

    desks: list[Node] = [summary]
    try:
        with ExitStack() as stack:
            if options.metrics is not None:
                figures_desk = MetricsDesk()
                stack.enter_context(served(figures_desk, options.metrics))
                desks.append(figures_desk)
            if options.notices is not None:
                channels = channels_of(options.notices)
                folder = options.out / NOTICES
                desks.append(
                    stack.enter_context(desk_of(folder, options.notices.notices, channels))
                )
            _run(source, options, outputs, desks, account, scenario_option, stopping)
    finally:
        figures = summary.as_json(wall=time.monotonic() - started)
        complete = _write_summary(options.out / SUMMARY, figures)
    files = tuple(options.out / name for name in (RECORDING, PICTURES, SUMMARY))
    return Session(summary, figures, tuple(path for path in files if path.exists()), complete)


def _write_summary(path: Path, figures: Json) -> bool:
    """Whether it could be written; why not is told, and costs neither the results of the session
    nor the reason for which it may have ended."""
    text = json.dumps(figures, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    try:
        written_whole(path, text.encode())
    except OSError as error:
        logger.error("cannot write %s: %s", path, error.strerror)
        return False
    return True


def session_outputs(
    source: Source, options: SessionOptions, earlier: tuple[Path, ...] = ()
) -> Outputs:
    """The files and viewers of a session. Raises ViewerError where rerun is missing.

    earlier   recordings that the identification goes on from
    """
    views: tuple[ViewerOutput, ...] = (RrdFile(options.out / PICTURES),) if options.rrd else ()
    if options.view is not None:
        views += (options.view,)
    if views:
        require_rerun(views)
    name = f"{source.layout.turbine} {source.text}"
    checkpoints = None if options.way == "lock-step" else options.out / CHECKPOINTS
    recording = options.out / RECORDING
    return Outputs(recording, source.metadata, views, name, checkpoints, earlier)


def _run(
    source: Source,
    options: SessionOptions,
    outputs: Outputs,
    desks: Sequence[Node],
    report: Callable[[AccelerationBlock], None],
    scenario_option: str | None,
    stopping: threading.Event | None,
) -> None:
    turbine = source.layout.turbine
    graph = build(source.scenario, source.layout, outputs, source.layouts)
    _require_processes(options)
    graph = _here(graph, source, options.elsewhere)
    if options.way == "lock-step":
        if source.is_live:
            raise InputError("--lock-step cannot run a live source: it waits for nobody")
        nodes = [*(plan.make() for plan in graph), *desks]
        messages = source.messages(options.speed, stopping)
        runner.run_lock_step(messages, nodes, turbine=turbine, report=report)
        return
    meeting = meeting_point(options.zenoh)

    def open_bus() -> Bus:
        return ZenohBus(meeting.nodes)

    follows = options.speed == float("inf") and not source.is_live
    desk = StatusDesk(source.text)
    control = ReplayControl(source, options.speed, stopping)
    # The hub first: a port that is taken is told before a node has begun a file.
    with _hub(meeting, desk, f"{STATUS_KEY}/{turbine}", options.out) as bus:
        workers: list[runner.Worker] = []
        for plan in graph:
            if options.way == "processes":
                command = node_command(plan.name, source, options, meeting.nodes, scenario_option)
                workers += _processes(plan, command, options.shards)
            else:
                workers.append(runner.NodeThread(plan.make(), open_bus, turbine))
        workers += [runner.NodeThread(each, open_bus, turbine) for each in (*desks, desk)]
        for told in desks:
            if isinstance(told, NoticesDesk):
                bus.answer(f"{NOTICES_KEY}/{turbine}", told.answer)
        if not source.is_live:
            bus.answer(f"{REPLAY_KEY}/{turbine}", control.answer)
        runner.run_workers(
            _messages(source, control, stopping),
            workers,
            bus,
            turbine=turbine,
            unacknowledged_blocks=source.scenario.flow.unacknowledged_blocks if follows else None,
            report=report,
            stopping=stopping,
        )


def _here(graph: tuple[Plan, ...], source: Source, elsewhere: Sequence[str]) -> tuple[Plan, ...]:
    """The graph without the nodes that other machines run."""
    names = [plan.name for plan in graph]
    for name in elsewhere:
        if name not in names:
            raise InputError(f"--elsewhere {name}: there is no such node; {', '.join(names)} are")
        if not source.is_live:
            raise InputError(f"--elsewhere {name} is for --source live, not for {source.text}")
    return tuple(plan for plan in graph if plan.name not in elsewhere)


def _require_processes(options: SessionOptions) -> None:
    if options.shards != 1 and options.way != "processes":
        raise InputError(f"--shards {options.shards} needs --processes, which shares the turbines")
    if options.shards < 1:
        raise InputError(f"--shards is {options.shards}; at least 1 process has all turbines")


def _processes(plan: Plan, command: Sequence[str], shards: int) -> list[SupervisedProcess]:
    """The node in a process, or its shares of the turbines in one each."""
    if shards == 1 or plan.name not in SHARED:
        return [SupervisedProcess(plan.node, command)]
    return [
        SupervisedProcess(
            plan.node,
            [*command, "--shard", f"{number}/{shards}"],
            name=plan.name + Shard(number, shards).suffix,
        )
        for number in range(1, shards + 1)
    ]


def _messages(
    source: Source, control: ReplayControl, stopping: threading.Event | None
) -> Iterator[Message] | None:
    """What the session publishes itself; None where the instruments do."""
    if source.feed is not None:
        return FeedAccount(source.feed, source.layout).messages(stopping or threading.Event())
    return None if source.is_live else control.messages()


@dataclass(frozen=True, slots=True)
class MeetingPoint:
    """How the parts of one session find each other."""

    hub: ZenohSettings  # of the one that the source speaks through and that answers for all
    nodes: ZenohSettings  # of every node
    endpoint: str  # where the session can be asked from this machine; "" where it listens nowhere


def meeting_point(settings: ZenohSettings) -> MeetingPoint:
    """peer: the hub listens and the nodes find it and each other; router: the nodes are clients of
    the hub, which routes between them and everybody else; client: all are clients of one router.

    Raises TransportError for a configuration file that is none.
    """
    match settings.role:
        case "client":
            return MeetingPoint(settings, settings, next(iter(settings.endpoints), ""))
        case "router":
            local = free_endpoint()
            nodes = ZenohSettings(mode="client", connect=(local,))
            return MeetingPoint(replace(settings, local=local), nodes, local)
        case _ if settings.config_file is not None:
            local = free_endpoint()
            nodes = replace(
                settings, listen=(ANY_LOCAL_PORT,), connect=(*settings.endpoints, local)
            )
            return MeetingPoint(replace(settings, local=local), nodes, local)
        case _:
            endpoint = settings.listen[0] if settings.listen else free_endpoint()
            hub = replace(settings, listen=settings.listen or (endpoint,))
            return MeetingPoint(hub, peer_of(endpoint), endpoint)


@contextmanager
def _hub(meeting: MeetingPoint, desk: StatusDesk, key: str, out: Path) -> Iterator[ZenohBus]:
    """The session that all others connect to; it answers for all, and its folder says where."""
    place = out / ENDPOINT_FILE
    bus = ZenohBus(meeting.hub)
    desk.connections = lambda: Counter(link.name or link.address for link in bus.links())
    try:
        bus.answer(key, desk.answer)
        place.write_text(f"{meeting.endpoint}\n", encoding="utf-8")
        yield bus
    finally:
        place.unlink(missing_ok=True)
        bus.close()


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
    command += ["--sampler", source.scenario.updating.sampling.method]
    if isinstance(options.view, ConnectedViewer):
        command += ["--view", f"connect={options.view.url}"]
    elif options.view is not None:
        command += ["--view", "spawn"]
    return command + ([] if options.rrd else ["--no-rrd"])


def bus_options(settings: ZenohSettings) -> list[str]:
    """The settings of a bus as they are given on the command line."""
    given = [("--connect", endpoint) for endpoint in settings.connect]
    given += [("--listen", endpoint) for endpoint in settings.listen]
    if settings.mode != "peer":
        given.append(("--mode", settings.mode))
    if settings.config_file is not None:
        given.append(("--zenoh-config", str(settings.config_file)))
    return [word for option in given for word in option]


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
    graph = build(source.scenario, source.layout, outputs, source.layouts)
    plans = {plan.name: plan for plan in graph}
    if name not in plans:
        raise InputError(f"there is no node {name!r}; there are {', '.join(plans)}")
    if shard is not None and name not in SHARED:
        raise InputError(f"--shard is for {' and '.join(SHARED)}, not for {name}")
    with runner.one_blas_thread(), runner.open_session(lambda: ZenohBus(options.zenoh)) as bus:
        _make_folder(options.out)
        if options.fresh and name == "updating":
            set_checkpoints_aside(options.out)
        if name == "viewer" and (options.out / PICTURES).exists():
            _set_aside(options.out / PICTURES)  # of the viewer that this one follows
        node = plans[name].make()
        if shard is not None:
            node = ShardedNode(node, parsed_shard(shard, source.turbines))
        runner.serve(node, bus, turbine=source.layout.turbine, stopping=stopping)


def _make_folder(out: Path) -> None:
    """Raises InputError where it cannot be made."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {out}: {error.strerror}; a folder is needed") from error


def prepare_folder(source: Source, out: Path) -> Source:
    """Make the folder and set an earlier session's files in it aside, under their date.

    Returns the source, which may be one of the files set aside. Raises InputError where the
    folder cannot be made.
    """
    _make_folder(out)
    for whole in close_leftovers(out / RECORDING):
        logger.warning("%s was left unfinished; it ends with its last whole chunk now", whole)
    parts = sorted({*out.glob("session.part*.mcap"), *out.glob("session.*results.mcap")})
    for path in (
        out / RECORDING,
        *parts,
        out / f"{RECORDING}{ACTIVE_SUFFIX}",
        out / PICTURES,
        out / SUMMARY,
    ):
        if path.exists():
            moved = _set_aside(path)
            logger.info("%s of an earlier session is now %s", path, moved)
            if source.recording is not None and source.recording.resolve() == path.resolve():
                source = source.with_recording(moved)
    return source


def set_checkpoints_aside(out: Path) -> None:
    """Let the updating begin with nothing seen; an earlier session's state is kept."""
    if (out / CHECKPOINTS).exists():
        logger.info("the updating's state is now %s", _set_aside(out / CHECKPOINTS))


def _set_aside(path: Path) -> Path:
    """Rename a file to its name with the time of its last change; gives the new path."""
    changed = datetime.fromtimestamp(path.stat().st_mtime, UTC)
    stem, dot, suffixes = path.name.partition(".")
    for number in range(1, 1000):
        again = "" if number == 1 else f"-{number}"
        moved = path.with_name(f"{stem}-{changed:%Y%m%dT%H%M%SZ}{again}{dot}{suffixes}")
        if not moved.exists():
            path.rename(moved)
            return moved
    raise InputError(f"{path}: a thousand earlier sessions of that second; clear the folder")
