"""Dashboard and alert rules on a real Prometheus; skipped where it is not installed."""

import json
import re
import shutil
import subprocess
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from pipeline.messages import FoundationPosterior, ModalEstimate
from pipeline.monitoring.alarms.outbox import DeliveryState
from pipeline.monitoring.metrics import MetricsNode, delivery_families, served
from pipeline.recording.reader import read_messages
from pipeline.transport.zenoh_bus import free_endpoint
from tests.docs.conftest import script
from tests.pipeline.example_messages import START_NS, block, rejection, status
from tests.pipeline.report.example_session import session

pytest.importorskip("prometheus_client", reason="the extra `metrics` is not installed")

FOLDER = Path(__file__).parents[2] / "docs" / "operations"
SECOND = 10**9  # [ns]
# alert → series that raise it (name, values in promtool's notation), minutes until then
RAISED = {
    "PilewatchGone": ('up{job="pilewatch",instance="a"}', "0x10", 5),
    "PilewatchUnitSilent": ('pilewatch_lag_seconds{turbine="t",unit="u"}', "400x30", 10),
    "PilewatchSamplesMissing": (
        'pilewatch_missing_seconds_total{turbine="t",unit="u"}', "0+10x60", 50,
    ),
    "PilewatchNodeDown": ('pilewatch_node_up{turbine="t",node="updating"}', "0x10", 5),
    "PilewatchWindowsRejected": (
        'pilewatch_windows_rejected_total{turbine="t",code="gap"}', "0+1x60", 50,
    ),
    "PilewatchNotTrusted": ('pilewatch_posterior_trusted{turbine="t"}', "0x100", 70),
    "PilewatchChangeLikely": ('pilewatch_change_probability{turbine="t"}', "0.95x10", 5),
    "PilewatchChanged": ('pilewatch_events_total{turbine="t"}', "0x5 1x10", 10),
    "PilewatchAlarmsUndelivered": ('pilewatch_alarm_age_seconds{channel="mail"}', "1000x10", 5),
}  # fmt: skip


def tool(name: str) -> str:
    """Path of a program, or skip."""
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"{name} is not installed (Debian's package prometheus has it)")
    return found


def test_every_alert_is_raised_by_its_figures_and_by_no_others(tmp_path: Path) -> None:
    promtool = tool("promtool")
    tests = [
        {
            "interval": "1m",
            "input_series": [{"series": series, "values": values}],
            "promql_expr_test": [
                {
                    "expr": 'count(ALERTS{alertstate="firing"}) by (alertname)',
                    "eval_time": f"{minutes}m",
                    "exp_samples": [{"labels": f'{{alertname="{alert}"}}', "value": 1}],
                }
            ],
        }
        for alert, (series, values, minutes) in RAISED.items()
    ]
    file = tmp_path / "test.yml"  # JSON is YAML
    file.write_text(json.dumps({"rule_files": [str(FOLDER / "alerts.yml")], "tests": tests}))
    checked = subprocess.run(
        [promtool, "test", "rules", str(file)], capture_output=True, text=True, check=False
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr


def test_the_rule_of_the_page_is_raised_by_a_spring_that_stays_low(tmp_path: Path) -> None:
    promtool = tool("promtool")
    page = (FOLDER.parent / "pages" / "operating.md").read_text("utf-8")
    (rule,) = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    (tmp_path / "rule.yml").write_text(rule)
    series = 'pilewatch_stiffness_ratio{turbine="t",spring="k22",level="0.5"}'
    firing = {
        "expr": 'count(ALERTS{alertstate="firing"}) by (alertname)',
        "eval_time": "70m",
        "exp_samples": [{"labels": '{alertname="RotationalStiffnessLow"}', "value": 1}],
    }
    tests = [
        {
            "interval": "1m",
            "input_series": [{"series": series, "values": f"{ratio}x90"}],
            "promql_expr_test": [firing | {"exp_samples": samples}],
        }
        for ratio, samples in ((0.94, firing["exp_samples"]), (0.96, []))
    ]
    file = tmp_path / "test.yml"
    file.write_text(json.dumps({"rule_files": ["rule.yml"], "tests": tests}))
    checked = subprocess.run(
        [promtool, "test", "rules", str(file)], capture_output=True, text=True, check=False
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr


def test_every_alert_has_its_test() -> None:
    text = (FOLDER / "alerts.yml").read_text()
    assert {line.split()[-1] for line in text.splitlines() if "- alert:" in line} == set(RAISED)


@pytest.fixture(scope="module")
def prometheus(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of a Prometheus that scrapes the figures of a recorded session."""
    program, place = tool("prometheus"), tmp_path_factory.mktemp("prometheus")
    with served(node_of_a_session(), 0) as metrics_port:
        text = (FOLDER / "prometheus.yml").read_text()
        text = text.replace("127.0.0.1:9464", f"127.0.0.1:{metrics_port}")
        text = text.replace("interval: 15s", "interval: 100ms")
        (place / "prometheus.yml").write_text(text)
        shutil.copy(FOLDER / "alerts.yml", place)
        address = free_endpoint().removeprefix("tcp/")
        options = ["--config.file=prometheus.yml", "--storage.tsdb.path=data"]
        command = [program, *options, f"--web.listen-address={address}", "--log.level=error"]
        with running(command, place):
            wait_for(f"http://{address}", "count(up == 1)")
            wait_for(f"http://{address}", "rate(pilewatch_samples_total[5m])")
            yield f"http://{address}"


@contextmanager
def running(command: list[str], place: Path) -> Iterator[None]:
    process = subprocess.Popen(command, cwd=place)
    try:
        yield
    finally:
        process.terminate()
        process.wait(10)


def node_of_a_session() -> MetricsNode:
    """The metrics after a session with modes, posteriors, a change, a gap and a rejection."""
    node = MetricsNode(lambda: START_NS + 3601 * SECOND)
    for message in (*session(), rejection(7), replace(status("identification"), turbine="t1")):
        node.handle(message)
    node.handle(block(3600))
    delivery = DeliveryState("webhook-1", 1, 2, 0, 0, 1, 5.0, START_NS, "away")
    node.parts.append(lambda: delivery_families([delivery]))
    return node


def asked(address: str, query: str) -> list[Any]:
    """Result of an instant query; raises where Prometheus refuses it."""
    url = f"{address}/api/v1/query?{urllib.parse.urlencode({'query': query})}"
    with closing(urllib.request.urlopen(url, timeout=5)) as answer:
        found = json.load(answer)
    assert found["status"] == "success", found
    return list(found["data"]["result"])


def wait_for(address: str, query: str) -> None:
    """Return when a query has a result."""
    ends = time.monotonic() + 20
    while time.monotonic() < ends:
        try:
            if asked(address, query):
                return
        except (urllib.error.URLError, ConnectionError):
            pass
        time.sleep(0.1)
    raise TimeoutError(query)


def test_every_panel_of_the_dashboard_has_figures(prometheus: str) -> None:
    dashboard = json.loads((FOLDER / "grafana.json").read_text())
    queries = [target["expr"] for panel in dashboard["panels"] for target in panel["targets"]]
    empty = [each for each in queries if not asked(prometheus, each.replace("$turbine", ".*"))]
    assert empty == []
    assert len(dashboard["panels"]) >= 15


def test_no_sample_of_a_scrape_is_refused(prometheus: str) -> None:
    wait_for(prometheus, "scrape_samples_scraped > 0")
    scraped = 'scrape_samples_scraped{job="pilewatch"}'
    kept = 'scrape_samples_post_metric_relabeling{job="pilewatch"}'
    assert asked(prometheus, f"{scraped} == {kept}")
    page = asked(prometheus, 'count({__name__=~"pilewatch_.*"})')
    everything = asked(prometheus, scraped)
    assert float(page[0]["value"][1]) <= float(everything[0]["value"][1])
    with closing(urllib.request.urlopen(f"{prometheus}/api/v1/targets", timeout=5)) as answer:
        (target,) = json.load(answer)["data"]["activeTargets"]
    assert target["lastError"] == ""


def test_what_is_stored_is_what_the_scripts_write() -> None:
    dashboard = json.loads((FOLDER / "grafana.json").read_text("utf-8"))
    layout = json.loads((FOLDER / "foxglove.json").read_text("utf-8"))
    assert script("dashboard", FOLDER).dashboard() == dashboard
    assert script("foxglove", FOLDER).layout() == layout


def test_every_path_of_foxgloves_layout_leads_to_a_figure_of_a_recording(
    short_session: Path,
) -> None:
    messages = {"foundation-posterior": FoundationPosterior, "modal-estimate": ModalEstimate}
    for topic, field in chain.from_iterable(script("foxglove", FOLDER).PLOTS.values()):
        newest = list(read_messages(short_session, (messages[topic],)))[-1]
        place: Any = newest
        for name, index in re.findall(r"(\w+)(?:\[(\d+)\])?", field):
            place = getattr(place, name)
            place = place[int(index)] if index else place
        assert isinstance(place, float), (topic, field)
    with short_session.open("rb") as file:
        topics = {channel.topic for channel in make_reader(file).get_summary().channels.values()}
    assert {f"pilewatch/iea15mw/{topic}" for topic in messages} <= topics
