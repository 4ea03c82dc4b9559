"""From a message to the web server, through restarts and acknowledgements."""

import json
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.monitoring.alarms.alarm_node import ALARMS_KEY, BOOK, FOLDER, AlarmNode
from pipeline.monitoring.alarms.channels import Webhook
from pipeline.monitoring.alarms.heartbeat import AlarmHeartbeat, Pulse
from pipeline.monitoring.alarms.settings import (
    AlarmError,
    AlarmLogSettings,
    HeartbeatSettings,
    WebhookSettings,
    load_notices,
    notices_settings,
)
from pipeline.monitoring.metrics import delivery_families
from pipeline.run.options import SessionOptions
from pipeline.run.run import run_session
from pipeline.scenario import NO_STRUCTURE, TurbineSettings
from pipeline.sources.recorded_stream import Playback
from pipeline.sources.sources import replayed
from pipeline.transport.zenoh_bus import ZenohBus, free_endpoint, hub
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.errors import InputError
from tests.pipeline.archive.archives import Change, rewritten
from tests.pipeline.example_messages import START_NS, rejection
from tests.pipeline.monitoring.alarms.outside import web_server
from tests.pipeline.monitoring.alarms.test_alarm_rules import EVENT

CLI = CliRunner()


class Clock:
    now_ns = START_NS

    def __call__(self) -> int:
        return self.now_ns


class WithoutTenSeconds(Change):
    """Blocks 10 to 19 never came."""

    def block(self, block: AccelerationBlock) -> AccelerationBlock | None:
        return None if 10 <= block.sequence < 20 else block


def alarm_node_to(url: str, folder: Path, clock: Clock) -> AlarmNode:
    webhook = Webhook("webhook-1", WebhookSettings(url))
    return AlarmNode(folder, AlarmLogSettings(), [webhook], clock)


def test_a_change_reaches_the_webhook_once_over_a_restart(tmp_path: Path) -> None:
    clock = Clock()
    with web_server() as server:
        with closing(alarm_node_to(server.url, tmp_path, clock)) as node:
            node.handle(EVENT)
            node.handle(EVENT)
        with closing(alarm_node_to(server.url, tmp_path, clock)) as node:
            node.handle(EVENT)

    assert [each["occasion"] for each in server.received] == ["raised"]
    (told,) = json.loads((tmp_path / BOOK).read_bytes())
    assert told["count"] == 3


def test_a_notice_of_a_time_without_the_outside_comes_later(tmp_path: Path) -> None:
    clock = Clock()
    with web_server() as server:
        url = server.url
    with closing(alarm_node_to(url, tmp_path, clock)) as node:
        node.handle(EVENT)
    assert node.warnings[0].code == "notices-waiting"

    with web_server(port=server.port) as back:
        alarm_node_to(url, tmp_path, clock).close()

    assert [each["text"] for each in back.received] == ["t1: k22 fell by 10 %"]


def test_an_acknowledged_notice_is_not_reminded_of(tmp_path: Path) -> None:
    clock = Clock()
    with web_server() as server, closing(alarm_node_to(server.url, tmp_path, clock)) as node:
        node.handle(EVENT)
        answer = json.loads(node.answer(b'{"acknowledge": [1, 9], "by": "ada"}'))
        clock.now_ns += 30 * 86_400 * NANOSECONDS
        node.handle(rejection(0))

    assert answer["unknown"] == [9]
    assert answer["notices"][0]["acknowledged_by"] == "ada"
    assert [each["occasion"] for each in server.received] == ["raised"]


def test_pilewatch_ack_asks_the_session_that_runs(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    with (
        web_server() as server,
        closing(alarm_node_to(server.url, tmp_path, Clock())) as node,
        closing(ZenohBus(hub(endpoint))) as bus,
    ):
        node.handle(EVENT)
        bus.answer(f"{ALARMS_KEY}/t1", node.answer)
        listed = CLI.invoke(app, ["ack", "--list", "--connect", endpoint, "--json"])
        done = CLI.invoke(app, ["ack", "1", "--by", "ada", "--connect", endpoint, "--json"])

    assert json.loads(listed.stdout)["notices"][0]["acknowledged_ns"] == 0
    assert json.loads(done.stdout)["notices"][0]["acknowledged_by"] == "ada"


def test_pilewatch_ack_writes_the_file_where_no_session_runs(tmp_path: Path) -> None:
    with web_server() as server:
        node = alarm_node_to(server.url, tmp_path / FOLDER, Clock())
        node.handle(EVENT)
        node.close()

    done = CLI.invoke(app, ["ack", "1", "--by", "ada", "--out", str(tmp_path)])
    table = CLI.invoke(app, ["ack", "--list", "--out", str(tmp_path)])
    wrong = CLI.invoke(app, ["ack", "7", "--out", str(tmp_path)])

    assert done.exit_code == 0
    assert "ada" in table.stdout
    assert "7 is no open alarm" in str(wrong.exception)


def test_a_session_tells_of_its_gap(short_recording: Path, tmp_path: Path) -> None:
    cut = rewritten(short_recording, tmp_path / "cut.mcap", WithoutTenSeconds())
    source = replayed(cut).with_playback(Playback(0.0, 30.0))
    parameters = replace(source.scenario, turbine=TurbineSettings(description=NO_STRUCTURE))
    with web_server() as server:
        table = {"webhook": [{"url": server.url}], "notices": {"shortest_gap": 5.0}}
        options = SessionOptions(
            out=tmp_path / "out",
            way="lock-step",
            rrd=False,
            notices=notices_settings(table, "test"),
        )
        run_session(replace(source, scenario=parameters), options)

    (told,) = server.received
    assert (told["kind"], told["turbine"]) == ("gap", "iea15mw")
    assert told["cause"].startswith("10 s of measurements of unit tower are missing, from ")
    assert told["text"] == f"iea15mw: {told['cause']}"
    assert told["session"] == str(tmp_path / "out")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[notices]\nreminder = 1.0", "names no receiver"),
        ('[[webhook]]\nurl = "example.org"', "it is like https://example.org/hook"),
        ('[[webhook]]\nurl = "https://e.org"\ntoken = "x"', "unknown key 'token'"),
        ('[webhook]\nurl = "https://e.org"', "in two brackets"),
        ('[[mail]]\nhost = "h"\nsender = "a@b"\nrecipients = []', "at least one address"),
        ('[[mqtt]]\nhost = "h"\npassword_environment = "NOT_SET_1"', "not set in the environment"),
        ('[[mqtt]]\nhost = "h"\ntopic = "a/#"', "has no # and no +"),
        ('[[mail]]\nhost = "h"\nsender = "a@b"\nrecipients = ["a@b"]\nport = 465', "tls = true"),
        ('[[webhook]]\nurl = "https://e.org"\nca = "none.pem"', "there is no such file"),
        ('[[heartbeat]]\nurl = "https://e.org"\nperiod = 0.0', "1 to 86400 s"),
        ('[[pager]]\nnumber = "1"', "unknown section 'pager'"),
        ('[notices]\nkinds = ["fire"]\n[[mqtt]]\nhost = "h"', "kinds has 'fire'"),
        ("[[", "not valid TOML"),
    ],
)
def test_a_wrong_file_says_in_one_line_what_would_be_right(
    tmp_path: Path, text: str, says: str
) -> None:
    path = tmp_path / "notices.toml"
    path.write_text(text)

    with pytest.raises(AlarmError, match=says.replace("[", r"\[")) as raised:
        load_notices(path)
    assert "\n" not in str(raised.value)


def test_a_damaged_book_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / BOOK).write_text("[{]")

    with pytest.raises(InputError, match="move it away"):
        AlarmNode(tmp_path, AlarmLogSettings(), [])
    assert (tmp_path / BOOK).read_text() == "[{]"


def test_a_channel_that_does_not_deliver_is_an_alarm_by_another_channel(tmp_path: Path) -> None:
    clock = Clock()
    with web_server() as server:
        away = Webhook("webhook-2", WebhookSettings("http://127.0.0.1:9/"))
        well = Webhook("webhook-1", WebhookSettings(server.url))
        with closing(AlarmNode(tmp_path, AlarmLogSettings(), [well, away], clock)) as node:
            node.handle(EVENT)
            wait_for(lambda: any(each.problem for each in node.delivery_states))
            clock.now_ns += 301 * NANOSECONDS
            node.handle(rejection(0))
            wait_for(lambda: len(server.received) == 2)

    assert [each["kind"] for each in server.received] == ["change", "delivery"]
    assert server.received[1]["text"] == (
        "session: 1 alarm messages wait for webhook-2: http://127.0.0.1:9: Connection refused"
    )


def test_a_heartbeat_is_sent_while_the_session_lives_and_ends_when_it_hangs() -> None:
    clock, heard_ns = Clock(), START_NS
    with web_server() as server:
        settings = HeartbeatSettings(server.url)
        heartbeat = AlarmHeartbeat(settings, lambda: Pulse(heard_ns, 2), {"host": "h"}, clock)
        heartbeat.ping()
        clock.now_ns += 61 * NANOSECONDS
        heartbeat.ping()

    assert [(each["host"], each["open"]) for each in server.received] == [("h", 2)]
    assert heartbeat.problem == "no ping: no message was handled for more than 60 s"


def test_a_session_sends_its_heartbeat_at_once(tmp_path: Path) -> None:
    with web_server() as server:
        beats = [HeartbeatSettings(server.url)]
        with closing(AlarmNode(tmp_path, AlarmLogSettings(), [], heartbeats=beats)):
            wait_for(lambda: bool(server.received))

    assert server.received[0]["session"] == str(tmp_path.parent)


def test_notices_test_sends_a_message_by_every_channel(tmp_path: Path) -> None:
    file = tmp_path / "notices.toml"
    with web_server() as server:
        file.write_text(
            f'[[webhook]]\nurl = "{server.url}"\n[[heartbeat]]\nurl = "{server.url}"\n'
            '[[webhook]]\nurl = "http://127.0.0.1:9/x"\n'
        )
        checked = CLI.invoke(app, ["notices", str(file)])
        done = CLI.invoke(app, ["notices", str(file), "--test", "--json"])

    assert checked.exit_code == 0
    results = json.loads(done.stdout)
    assert [(each["channel"], each["problem"]) for each in results] == [
        ("webhook-1", ""),
        ("webhook-2", "http://127.0.0.1:9: Connection refused"),
        ("heartbeat-1", ""),
    ]
    assert "no test message arrived by webhook-2" in str(done.exception)
    assert server.received[0]["occasion"] == "test"


def test_the_deliveries_are_figures_for_prometheus(tmp_path: Path) -> None:
    with web_server() as server:
        with closing(alarm_node_to(server.url, tmp_path, Clock())) as node:
            node.handle(EVENT)
        families = {each.name: each for each in delivery_families(node.delivery_states)}

    outcomes = {
        each.labels["outcome"]: each.value
        for each in families["pilewatch_alarm_deliveries"].samples
    }
    assert outcomes == {"delivered": 1.0, "failed": 0.0, "refused": 0.0, "dropped": 0.0}
    assert families["pilewatch_alarm_age_seconds"].samples[0].value == 0.0


def wait_for(holds: Callable[[], bool]) -> None:
    """Until another thread has done it."""
    deadline = time.monotonic() + 20
    while not holds() and time.monotonic() < deadline:
        time.sleep(0.005)
    assert holds()
