"""What Prometheus reads is what the messages said, in the form that it asks for."""

import shutil
import socket
import subprocess
import threading
import urllib.request
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families

from pipeline.messages import FoundationEvent, StreamGap
from pipeline.monitoring.alarms.outbox import DeliveryState
from pipeline.monitoring.metrics import MetricsNode, delivery_families, served
from pipeline.run.options import SessionOptions
from pipeline.run.run import run_session
from pipeline.runtime.node_thread import listened
from pipeline.scenario import NO_STRUCTURE, TurbineSettings
from pipeline.sources.recorded_stream import Playback
from pipeline.sources.sources import replayed
from pipeline.transport.zenoh_bus import ZenohBus, ZenohSettings, free_endpoint, hub
from sensors.acquisition.blocks import AccelerationBlock
from sensors.errors import InputError
from tests.pipeline.example_messages import START_NS, block, rejection, status
from tests.pipeline.updating.test_state import estimate_of, updater_of

SECOND = 10**9  # [ns]
NO_TURBINE = TurbineSettings(description=NO_STRUCTURE)

Figures = dict[tuple[str, ...], float]


class Clock:
    now_ns = START_NS

    def __call__(self) -> int:
        return self.now_ns


@pytest.fixture(scope="module")
def node() -> MetricsNode:
    """After five blocks, a gap of 4 s, a window, its posterior and a node's status."""
    clock = Clock()
    node = MetricsNode(clock)
    for sequence in range(5):
        clock.now_ns = START_NS + (sequence + 1) * SECOND
        node.handle(block(sequence))
    node.handle(StreamGap("t1", "tower", "s", START_NS, START_NS + 4 * SECOND, 3, 4))
    node.handle(status("recorder", last_sequence=2, lost=3))
    node.handle(rejection(0))
    updater = updater_of()
    node.handle(estimate_of(0))
    node.handle(updater.updated(updater.initial_state(), estimate_of(0))[1])
    clock.now_ns += 2 * SECOND
    delivery = DeliveryState("webhook-1", 1, 2, 0, 0, 1, 5.0, START_NS, "away")
    node.parts.append(lambda: delivery_families([delivery]))
    return node


@pytest.fixture(scope="module")
def scraped(node: MetricsNode) -> Figures:
    """Its figures over HTTP."""
    return figures(node)


def figures(desk: MetricsNode) -> Figures:
    """(name, values of its labels in alphabetical order of their names) → figure."""
    with served(desk, 0) as port:
        return read(port)


def read(port: int) -> Figures:
    page = urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=5).read()
    return {
        (sample.name, *(value for _, value in sorted(sample.labels.items()))): sample.value
        for family in text_string_to_metric_families(page.decode())
        for sample in family.samples
    }


def test_counters_count_what_came(scraped: Figures) -> None:
    assert scraped["pilewatch_messages_total", "AccelerationBlock", "t1"] == 5
    assert scraped["pilewatch_samples_total", "t1", "tower"] == 200
    assert scraped["pilewatch_gaps_total", "t1", "tower"] == 1
    assert scraped["pilewatch_missing_seconds_total", "t1", "tower"] == 4.0
    assert scraped["pilewatch_windows_rejected_total", "gap", "t1"] == 1


def test_lag_and_rates_are_of_the_newest_block(scraped: Figures) -> None:
    key = "pilewatch/t1/tower/acceleration"

    assert scraped["pilewatch_lag_seconds", "t1", "tower"] == pytest.approx(2.0)
    assert scraped["pilewatch_stream_rate_hertz", key] == pytest.approx(1.0)
    assert scraped["pilewatch_stream_silence_seconds", key] == pytest.approx(2.0)
    assert scraped["pilewatch_sampling_rate_hertz", "t1", "tower"] == 40.0


def test_nodes_are_up_and_say_what_they_lost(scraped: Figures) -> None:
    assert scraped["pilewatch_node_up", "recorder", "t1"] == 1
    assert scraped["pilewatch_node_blocks_total", "lost", "recorder", "t1"] == 3


def test_modes_and_springs_are_the_newest_windows(scraped: Figures) -> None:
    estimate = estimate_of(0)
    updater = updater_of()
    posterior = updater.updated(updater.initial_state(), estimate)[1]
    k22 = posterior.parameter("k22")  # type: ignore[union-attr]
    turbine = estimate.turbine

    assert scraped["pilewatch_first_frequency_hertz", turbine] == estimate.modes[0].frequency
    ratio = scraped["pilewatch_stiffness_ratio", "0.95", "k22", turbine]
    assert ratio == pytest.approx(k22.p95 / k22.nominal, rel=1e-12)
    assert scraped["pilewatch_stiffness", "k22", turbine, k22.unit] == k22.median
    assert scraped["pilewatch_posterior_trusted", turbine] == 1
    assert 0.0 <= scraped["pilewatch_change_probability", turbine] <= 1.0
    assert scraped["pilewatch_events_total", turbine] == 0


def test_what_is_not_known_is_not_there() -> None:
    desk = MetricsNode(Clock())
    desk.handle(block(0))

    found = {name for name, *_ in figures(desk)}

    assert "pilewatch_samples_total" in found
    assert "pilewatch_stream_rate_hertz" not in found  # one message has no rate
    assert "pilewatch_stiffness" not in found


def test_a_port_that_is_taken_is_one_line() -> None:
    with (
        served(MetricsNode(), 0) as port,
        pytest.raises(InputError, match=f"127.0.0.1:{port}: Address already in use"),
        served(MetricsNode(), port),
    ):
        pass


def test_a_session_that_runs_elsewhere_can_be_listened_to(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pipeline.runtime.node_thread.SILENT_SESSION", 0.1)
    endpoint = free_endpoint()
    desk, stopping = MetricsNode(), threading.Event()
    reader_settings = ZenohSettings(mode="client", connect=(endpoint,))
    with closing(ZenohBus(hub(endpoint))) as session, closing(ZenohBus(reader_settings)) as reader:
        listening = threading.Thread(
            target=listened,
            args=(desk, reader, stopping),
            kwargs={"where": endpoint},
        )
        listening.start()
        while "does a session run there" not in caplog.text:
            assert listening.is_alive()
        for sequence in range(3):
            session.publish(block(sequence))
        while figures(desk).get(("pilewatch_samples_total", "t1", "tower"), 0.0) != 120:
            assert listening.is_alive()
        stopping.set()
        listening.join()


def test_a_lock_step_session_serves_its_figures(short_recording: Path, tmp_path: Path) -> None:
    """Asked when the source has given its last block."""
    seen: list[Figures] = []
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    source = replayed(short_recording).with_playback(Playback(0.0, 30.0))
    source = replace(source, scenario=replace(source.scenario, turbine=NO_TURBINE))

    def ask(asked: AccelerationBlock) -> None:
        if asked.sequence == 29:
            seen.append(read(port))

    options = SessionOptions(out=tmp_path, way="lock-step", rrd=False, metrics=port)
    run_session(source, options, report=ask)

    (last,) = seen
    assert last["pilewatch_messages_total", "AccelerationBlock", "iea15mw"] == 30


def test_an_event_has_the_time_at_which_it_was_noticed_not_that_of_the_change() -> None:
    """A scrape counts how long ago a person could have known."""
    noticed, since = START_NS + 3600 * SECOND, START_NS
    event = FoundationEvent(
        "t1", 6, noticed, "foundation", 0.9, since, since, since, changes=(), shifts=(), text="k22"
    )
    desk = MetricsNode(Clock())
    desk.handle(event)
    assert (
        figures(desk)["pilewatch_event_timestamp_seconds", "foundation", "t1"] == noticed / SECOND
    )


def test_only_summaries_may_have_quantiles_and_only_histograms_bounds(node: MetricsNode) -> None:
    labels = {name for family in node.collect() for each in family.samples for name in each.labels}

    assert labels & {"quantile", "le"} == set()


@pytest.mark.skipif(shutil.which("promtool") is None, reason="promtool is not installed")
def test_promtool_finds_nothing_wrong_with_the_figures(node: MetricsNode) -> None:
    with served(node, 0) as port:
        page = urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=5).read()
    checked = subprocess.run(["promtool", "check", "metrics"], input=page, capture_output=True)

    assert (checked.returncode, checked.stdout + checked.stderr) == (0, b"")


def test_the_deliveries_of_alarms_are_among_the_figures(scraped: Figures) -> None:
    assert scraped["pilewatch_alarm_deliveries_total", "webhook-1", "failed"] == 2
    assert scraped["pilewatch_alarm_age_seconds", "webhook-1"] == 5.0


def test_names_that_are_made_up_do_not_grow_the_page() -> None:
    node = MetricsNode(clock=lambda: START_NS)

    def lines() -> int:
        return sum(len(family.samples) for family in node.collect())

    for number in range(50):
        node.handle(block(number))
    sizes = []
    for number in range(6000):
        name = f"forged-{number}"
        node.handle(replace(rejection(0), turbine=name, code=name))
        node.handle(replace(rejection(0), code=name))
        node.handle(replace(status(name), turbine="t1"))
        if number in (5500, 5999):
            sizes.append(lines())
    assert sizes[1] <= 1.01 * sizes[0]
    samples = [s for family in node.collect() for s in family.samples if "samples" in s.name]
    assert [s.labels["turbine"] for s in samples] == ["t1"]


def test_moments_of_alarms_are_seconds_since_1970(scraped: Figures) -> None:
    moment = scraped["pilewatch_alarm_delivered_timestamp_seconds", "webhook-1"]
    assert moment == pytest.approx(START_NS / SECOND)
    assert scraped["pilewatch_alarm_age_seconds", "webhook-1"] == 5.0
