"""A session's figures for Prometheus: `pilewatch run --metrics PORT`, `pilewatch metrics`.

every message ──► [metrics] ◄── GET /metrics ── Prometheus

The names of the figures are an interface: they stay. Counters count since this node began to
listen. Figures that are not known yet are not there, rather than zero.
"""

import logging
import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from pipeline.messages import FoundationEvent
from pipeline.monitoring.state_sink import StateSink
from pipeline.state.run_state import RunState
from sensors.acquisition.blocks import NANOSECONDS
from sensors.constants import HIGHEST_PORT, LOOPBACK
from sensors.errors import InputError
from sensors.extras import import_extra

if TYPE_CHECKING:
    from prometheus_client.metrics_core import Metric

    from pipeline.monitoring.alarms.outbox import DeliveryState

logger = logging.getLogger(__name__)

QUANTILE_LEVELS = (("0.05", "p05"), ("0.5", "median"), ("0.95", "p95"))  # of a label `level`
COUNTED_BY_NODES = ("lost", "recovered", "late", "duplicate", "malformed")
DELIVERY_OUTCOMES = ("delivered", "failed", "refused", "dropped")

Families = Iterable["Metric"]
Sample = tuple[tuple[str, ...], float]  # values of the labels, the figure


class MetricsNode(StateSink):
    """A sink that gives the figures at any moment. Any thread may ask.

    Parameters
    ----------
    clock : callable, optional
        → [ns since 1970-01-01 UTC].
    """

    name = "metrics"

    def __init__(self, clock: Callable[[], int] = time.time_ns) -> None:
        super().__init__(kept=1, clock=clock)
        self.parts: list[Callable[[], Families]] = []  # figures of other nodes of this process

    def collect(self) -> Iterator["Metric"]:
        """Yield every figure known now: what the Prometheus client's registry asks for."""
        with self._asked() as (run, now_ns):
            families = list(run_families(run, now_ns))
        yield from families
        for part in self.parts:
            yield from part()


def run_families(run: RunState, now_ns: int) -> Families:
    """Return the figures of a run at a moment of the listener's clock [ns]."""
    yield from _streams(run, now_ns)
    yield from _nodes(run, now_ns)
    yield from _modes(run)
    yield from _foundation(run)


def _streams(run: RunState, now_ns: int) -> Families:
    units = [
        ((turbine, name), each)
        for turbine, state in run.turbines.items()
        for name, each in state.units.items()
    ]
    received_units = [(key, each) for key, each in units if each.end_ns is not None]
    short = [(key, each) for key, each in units if each.gaps]
    received = [
        ((turbine, message), count)
        for turbine, state in run.turbines.items()
        for message, count in state.received.items()
    ]
    yield counter("messages", "Messages received.", ("turbine", "message"), received)
    unit = ("turbine", "unit")
    samples = [(key, each.samples) for key, each in received_units]
    yield counter("samples", "Samples a channel received.", unit, samples)
    gaps = [(key, each.gaps) for key, each in short]
    yield counter("gaps", "Gaps in the measurements.", unit, gaps)
    missing = [(key, each.missing_ns / NANOSECONDS) for key, each in short]
    yield counter("missing_seconds", "Measured time that is missing.", unit, missing)
    lags = [(key, (now_ns - (each.end_ns or 0)) / NANOSECONDS) for key, each in received_units]
    text = "Age of the newest sample by this machine's clock; of a replay, of its recording."
    yield gauge("lag_seconds", text, unit, lags)
    rates = [(key, each.sampling_rate) for key, each in received_units]
    yield gauge("sampling_rate_hertz", "Sampling rate of the unit.", unit, rates)
    streams = run.health.streams(now_ns)
    for name, text, field in (
        ("stream_rate_hertz", "Messages a second on a key since its first.", "rate"),
        ("stream_silence_seconds", "Since the last message on a key.", "silence"),
    ):
        yield gauge(name, text, ("key",), (((e.key,), getattr(e, field)) for e in streams))


def _nodes(run: RunState, now_ns: int) -> Families:
    labels = ("turbine", "node")
    nodes = [((e.status.turbine, e.status.node), e) for e in run.health.nodes(now_ns)]
    up = "1: the node has spoken lately and not said that it stops."
    alive = [(key, float(each.condition == "alive")) for key, each in nodes]
    yield gauge("node_up", up, labels, alive)
    busy = [(key, each.status.busy_s) for key, each in nodes]
    yield counter("node_busy_seconds", "Time that the node has worked.", labels, busy)
    fates = [
        ((*key, fate), float(getattr(each.status, fate)))
        for key, each in nodes
        for fate in COUNTED_BY_NODES
    ]
    text = "Blocks by what became of them, beside those that were simply handled."
    yield counter("node_blocks", text, (*labels, "fate"), fates)


def _modes(run: RunState) -> Families:
    estimates = [
        (turbine, state.estimate) for turbine, state in run.turbines.items() if state.estimate
    ]
    lowest = [((turbine,), each.modes[0].frequency) for turbine, each in estimates if each.modes]
    text = "f1, the lowest frequency of the newest window."
    yield gauge("first_frequency_hertz", text, ("turbine",), lowest)
    modes = [
        ((turbine, mode.name), mode)
        for turbine, estimate in estimates
        for mode in estimate.modes
        if mode.name  # else one series to Prometheus, which drops all but the first
    ]
    for name, text, field in (
        ("mode_frequency_hertz", "Frequencies of the newest window.", "frequency"),
        ("mode_frequency_std_hertz", "Their standard deviations.", "frequency_std"),
        ("mode_damping_ratio", "Damping ratios of the newest window.", "damping_ratio"),
    ):
        values = [(key, getattr(mode, field)) for key, mode in modes]
        yield gauge(name, text, ("turbine", "mode"), values)
    rejected = [
        ((turbine, code), count)
        for turbine, state in run.turbines.items()
        for code, count in state.rejections.items()
    ]
    text = "Windows that were not used, by the reason's code."
    yield counter("windows_rejected", text, ("turbine", "code"), rejected)


def _foundation(run: RunState) -> Families:
    posteriors = [
        (turbine, state.posterior) for turbine, state in run.turbines.items() if state.posterior
    ]
    springs = [(turbine, each) for turbine, last in posteriors for each in last.parameters[:3]]
    ratios = [
        ((turbine, each.name, level), getattr(each, field) / each.nominal)
        for turbine, each in springs
        for level, field in QUANTILE_LEVELS
    ]
    text = "Quantiles of k11, k22, k12 over their nominal values."
    yield gauge("stiffness_ratio", text, ("turbine", "spring", "level"), ratios)
    medians = [((turbine, each.name, each.unit), each.median) for turbine, each in springs]
    text = "Medians of k11, k22, k12 in the unit of the label."
    yield gauge("stiffness", text, ("turbine", "spring", "unit"), medians)
    for name, text, field in (
        ("posterior_windows", "Windows that entered the posterior.", "n_windows"),
        ("posterior_trusted", "0: the data contradict the model.", "trusted"),
        ("posterior_effective_draws", "Smallest effective sample size.", "ess"),
        (
            *("change_probability", "That the modes have changed since the last event."),
            "change_probability",
        ),
    ):
        values = [((turbine,), float(getattr(each, field))) for turbine, each in posteriors]
        yield gauge(name, text, ("turbine",), values)
    events = [
        ((turbine,), float(run.turbine(turbine).received[FoundationEvent.__name__]))
        for turbine, _ in posteriors
    ]
    yield counter("events", "Changes of the structure that were told.", ("turbine",), events)
    latest = [
        ((turbine, state.events[-1].kind), state.events[-1].time_ns / NANOSECONDS)
        for turbine, state in run.turbines.items()
        if state.events
    ]
    text = "When the newest change was noticed."
    yield gauge("event_timestamp_seconds", text, ("turbine", "kind"), latest)


def delivery_families(states: "Sequence[DeliveryState]") -> Families:
    """Return what became of alarm messages, by channel."""
    outcomes = [
        ((each.channel, outcome), float(getattr(each, outcome)))
        for each in states
        for outcome in DELIVERY_OUTCOMES
    ]
    text = "Alarm messages by outcome; failed: attempts."
    yield counter("alarm_deliveries", text, ("channel", "outcome"), outcomes)
    waiting = [((each.channel,), float(each.waiting)) for each in states]
    text = "Alarm messages that wait for delivery."
    yield gauge("alarm_waiting", text, ("channel",), waiting)
    ages = [((each.channel,), each.age) for each in states]
    text = "How long the oldest waiting alarm message has waited."
    yield gauge("alarm_age_seconds", text, ("channel",), ages)
    confirmed = [((each.channel,), each.last_ns / NANOSECONDS) for each in states if each.last_ns]
    text = "When an alarm message was last confirmed."
    yield gauge("alarm_delivered_timestamp_seconds", text, ("channel",), confirmed)


def gauge(name: str, text: str, labels: tuple[str, ...], values: Iterable[Sample]) -> "Metric":
    """Return a gauge `pilewatch_name` with a value for each set of labels."""
    from prometheus_client.core import GaugeMetricFamily

    return _filled(GaugeMetricFamily(f"pilewatch_{name}", text, labels=labels), values)


def counter(
    name: str, text: str, labels: tuple[str, ...], values: Iterable[tuple[Any, float]]
) -> "Metric":
    """Return a counter `pilewatch_name` with a value for each set of labels."""
    from prometheus_client.core import CounterMetricFamily

    return _filled(CounterMetricFamily(f"pilewatch_{name}", text, labels=labels), values)


def _filled(family: Any, values: Iterable[Sample]) -> "Metric":
    for labels, value in values:
        if not math.isnan(value):
            family.add_metric(labels, value)
    return family


@contextmanager
def served(
    node: MetricsNode, port: int, address: str = LOOPBACK, *, option: str = "--port"
) -> Iterator[int]:
    """The node's figures over HTTP under /metrics; gives the port, which 0 leaves to the system.

    Raises InputError where the port is taken or is none, as `option` gives it, or where the extra
    `metrics` is missing.
    """
    import_extra("prometheus_client", "metrics", "figures for Prometheus")
    from prometheus_client import CollectorRegistry, start_http_server

    if not 0 <= port <= HIGHEST_PORT:
        raise InputError(f"{option} is {port}; a port is 0 (any free one) to {HIGHEST_PORT}")

    registry = CollectorRegistry()
    registry.register(node)  # a Collector by its method
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
