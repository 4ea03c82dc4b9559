"""A session's figures for Prometheus: `pilewatch run --metrics PORT`, `pilewatch metrics`.

every message ──► [metrics] ◄── GET /metrics ── Prometheus

The names of the figures are an interface: they stay. Counters count since this node began to
listen. Figures that are not known yet are not there, rather than zero.
"""

import math
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    Message,
    ModalEstimate,
    StreamGap,
    WindowRejected,
)
from pipeline.nodes.node import NodeStatistics
from pipeline.state.health import Health, NodeHealth
from pipeline.streams import STREAMS
from pipeline.transport.bus import Bus, Inbox
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.errors import InputError

if TYPE_CHECKING:
    from prometheus_client.metrics_core import Metric

LOOPBACK = "127.0.0.1"
LAST_PORT = 65_535
QUANTILE_LEVELS = (
    ("0.05", "p05"),
    ("0.5", "median"),
    ("0.95", "p95"),
)  # `quantile` is for summaries
COUNTED_BY_NODES = ("lost", "recovered", "late", "duplicate", "malformed")

Families = Iterable["Metric"]
Sample = tuple[tuple[str, ...], float]  # values of the labels, the figure


class MetricsNode:
    """A sink that gives the figures at any moment. Any thread may ask.

    clock   → [ns since 1970-01-01 UTC]
    """

    name = "metrics"
    inputs: tuple[type, ...] = tuple(stream.message for stream in STREAMS)

    def __init__(self, clock: Callable[[], int] = time.time_ns) -> None:
        self._clock = clock
        self._health = Health()
        self._asked = threading.Lock()
        self._messages: Counter[tuple[str, ...]] = Counter()  # turbine, message
        self._samples: Counter[tuple[str, ...]] = Counter()  # turbine, unit
        self._gaps: Counter[tuple[str, ...]] = Counter()  # turbine, unit
        self._missing: dict[tuple[str, ...], float] = defaultdict(float)  # turbine, unit → [s]
        self._rejections: Counter[tuple[str, ...]] = Counter()  # turbine, code
        self._blocks: dict[tuple[str, ...], AccelerationBlock] = {}  # newest by turbine, unit
        self._estimates: dict[str, ModalEstimate] = {}  # newest by turbine
        self._posteriors: dict[str, FoundationPosterior] = {}
        self._events: dict[str, FoundationEvent] = {}
        self.parts: list[Callable[[], Families]] = []  # figures of other nodes of this process

    def handle(self, message: Message) -> Iterable[Message]:
        """Take note of a message. Gives nothing back."""
        with self._asked:
            self._health.observe(message, self._clock())
            self._messages[message.turbine, type(message).__name__] += 1
            match message:
                case AccelerationBlock():
                    self._samples[message.turbine, message.unit] += len(message.samples)
                    self._blocks[message.turbine, message.unit] = message
                case StreamGap():
                    self._gaps[message.turbine, message.unit] += 1
                    duration = (message.end_ns - message.start_ns) / NANOSECONDS
                    self._missing[message.turbine, message.unit] += duration
                case WindowRejected():
                    self._rejections[message.turbine, message.code] += 1
                case ModalEstimate():
                    self._estimates[message.turbine] = message
                case FoundationPosterior():
                    self._posteriors[message.turbine] = message
                case FoundationEvent():
                    self._events[message.turbine] = message
        return ()

    @property
    def statistics(self) -> NodeStatistics:
        """It counts nothing of its own."""
        return NodeStatistics()

    def close(self) -> None:
        """Nothing is held."""

    def collect(self) -> Iterator["Metric"]:
        """Every figure known now: what the Prometheus client's registry asks for."""
        with self._asked:
            families = [*self._streams(), *self._nodes(), *self._modes(), *self._foundation()]
        yield from families
        for part in self.parts:
            yield from part()

    def _streams(self) -> Families:
        now_ns = self._clock()
        unit = ("turbine", "unit")
        yield counter(
            "messages", "Messages received.", ("turbine", "message"), self._messages.items()
        )
        yield counter("samples", "Samples a channel received.", unit, self._samples.items())
        yield counter("gaps", "Gaps in the measurements.", unit, self._gaps.items())
        yield counter(
            "missing_seconds", "Measured time that is missing.", unit, self._missing.items()
        )
        yield gauge(
            "lag_seconds",
            "Age of the newest sample by this machine's clock; of a replay, of its recording.",
            unit,
            ((key, (now_ns - each.end_ns) / NANOSECONDS) for key, each in self._blocks.items()),
        )
        yield gauge(
            "sampling_rate_hertz",
            "Sampling rate of the unit.",
            unit,
            ((key, each.sampling_rate) for key, each in self._blocks.items()),
        )
        streams = self._health.streams(now_ns)
        yield gauge(
            "stream_rate_hertz",
            "Messages a second on a key since its first.",
            ("key",),
            (((each.key,), each.rate) for each in streams),
        )
        yield gauge(
            "stream_silence_seconds",
            "Since the last message on a key.",
            ("key",),
            (((each.key,), each.silence) for each in streams),
        )

    def _nodes(self) -> Families:
        nodes = self._health.nodes(self._clock())
        labels = ("turbine", "node")
        yield gauge(
            "node_up",
            "1: the node has spoken lately and not said that it stops.",
            labels,
            ((_of_node(each), float(each.condition == "alive")) for each in nodes),
        )
        yield counter(
            "node_busy_seconds",
            "Time that the node has worked.",
            labels,
            ((_of_node(each), each.status.busy_s) for each in nodes),
        )
        yield counter(
            "node_blocks",
            "Blocks by what became of them, beside those that were simply handled.",
            (*labels, "fate"),
            (
                ((*_of_node(each), fate), float(getattr(each.status, fate)))
                for each in nodes
                for fate in COUNTED_BY_NODES
            ),
        )

    def _modes(self) -> Families:
        labels = ("turbine", "mode")
        modes = [
            ((turbine, mode.name), mode)
            for turbine, estimate in self._estimates.items()
            for mode in estimate.modes
            if mode.name  # without one they are the same series to Prometheus, which drops them
        ]
        yield gauge(
            "first_frequency_hertz",
            "f1, the lowest frequency of the newest window.",
            ("turbine",),
            (((t,), e.modes[0].frequency) for t, e in self._estimates.items() if e.modes),
        )
        yield gauge(
            "mode_frequency_hertz",
            "Frequencies of the newest window.",
            labels,
            ((key, mode.frequency) for key, mode in modes),
        )
        yield gauge(
            "mode_frequency_std_hertz",
            "Their standard deviations.",
            labels,
            ((key, mode.frequency_std) for key, mode in modes),
        )
        yield gauge(
            "mode_damping_ratio",
            "Damping ratios of the newest window.",
            labels,
            ((key, mode.damping_ratio) for key, mode in modes),
        )
        yield counter(
            "windows_rejected",
            "Windows that were not used, by the reason's code.",
            ("turbine", "code"),
            self._rejections.items(),
        )

    def _foundation(self) -> Families:
        posteriors = self._posteriors.items()
        yield gauge(
            "stiffness_ratio",
            "Quantiles of k11, k22, k12 over their nominal values.",
            ("turbine", "spring", "level"),
            (
                ((turbine, p.name, level), getattr(p, field) / p.nominal)
                for turbine, posterior in posteriors
                for p in posterior.parameters[:3]
                for level, field in QUANTILE_LEVELS
            ),
        )
        yield gauge(
            "stiffness",
            "Medians of k11, k22, k12 in the unit of the label.",
            ("turbine", "spring", "unit"),
            (
                ((turbine, p.name, p.unit), p.median)
                for turbine, posterior in posteriors
                for p in posterior.parameters[:3]
            ),
        )
        for name, text, figure in (
            ("posterior_windows", "Windows that entered the posterior.", _n_windows),
            ("posterior_trusted", "0: the data contradict the model.", _trusted),
            ("posterior_effective_draws", "Smallest effective sample size.", _ess),
            ("change_probability", "That the modes have changed since the last event.", _change),
        ):
            values = (((turbine,), figure(each)) for turbine, each in posteriors)
            yield gauge(name, text, ("turbine",), values)
        yield counter(
            "events",
            "Changes of the structure that were told.",
            ("turbine",),
            (
                ((turbine,), float(self._messages[turbine, FoundationEvent.__name__]))
                for turbine in self._posteriors
            ),
        )
        yield gauge(
            "event_timestamp_seconds",
            "When the newest change was noticed.",
            ("turbine", "kind"),
            (((t, event.kind), event.time_ns / NANOSECONDS) for t, event in self._events.items()),
        )


def _of_node(health: NodeHealth) -> tuple[str, str]:
    return health.status.turbine, health.status.node


def _n_windows(posterior: FoundationPosterior) -> float:
    return float(posterior.n_windows)


def _trusted(posterior: FoundationPosterior) -> float:
    return float(posterior.trusted)


def _ess(posterior: FoundationPosterior) -> float:
    return posterior.ess


def _change(posterior: FoundationPosterior) -> float:
    return posterior.change_probability


def gauge(name: str, text: str, labels: tuple[str, ...], values: Iterable[Sample]) -> "Metric":
    from prometheus_client.core import GaugeMetricFamily

    return _filled(GaugeMetricFamily(f"pilewatch_{name}", text, labels=labels), values)


def counter(
    name: str, text: str, labels: tuple[str, ...], values: Iterable[tuple[Any, float]]
) -> "Metric":
    from prometheus_client.core import CounterMetricFamily

    return _filled(CounterMetricFamily(f"pilewatch_{name}", text, labels=labels), values)


def _filled(family: Any, values: Iterable[Sample]) -> "Metric":
    for labels, value in values:
        if not math.isnan(value):
            family.add_metric(labels, value)
    return family


def listened(desk: MetricsNode, bus: Bus, stopping: threading.Event) -> None:
    """Give the desk every message until `stopping` is set. Nothing is published: who may only read
    may do this."""
    inbox = Inbox()
    subscription = bus.subscribe(desk.inputs, inbox)
    while not stopping.is_set():
        message = inbox.get(timeout=0.2)
        if message is not None:
            desk.handle(message)
    subscription.close()


@contextmanager
def served(desk: MetricsNode, port: int, address: str = LOOPBACK) -> Iterator[int]:
    """The desk's figures over HTTP under /metrics; gives the port, which 0 leaves to the system.

    Raises InputError where the port is taken or the extra `metrics` is missing.
    """
    require_prometheus()
    from prometheus_client import CollectorRegistry, start_http_server

    if not 0 <= port <= LAST_PORT:
        raise InputError(f"{port} is no port for the figures; ports are 0 (any) to {LAST_PORT}")

    registry = CollectorRegistry()
    registry.register(desk)  # a Collector by its method
    try:
        server, thread = start_http_server(port, addr=address, registry=registry)
    except OSError as error:
        raise InputError(
            f"figures cannot be served at {address}:{port}: {error.strerror or error}"
        ) from error
    try:
        yield int(server.server_port)
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def require_prometheus() -> None:
    """Raises InputError where the client library is missing."""
    try:
        import prometheus_client  # noqa: F401
    except ImportError:
        raise InputError(
            "figures for Prometheus need the extra `metrics`: pip install 'pilewatch[metrics]'"
        ) from None
