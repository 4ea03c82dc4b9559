"""`pilewatch notices FILE --test`: one message a channel, one ping a heartbeat, no alarm."""

import json
import socket
import time
from pathlib import Path

from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.monitoring.alarms.channel_check import checked_channels
from pipeline.monitoring.alarms.settings import AlarmSettings, HeartbeatSettings, WebhookSettings
from tests.pipeline.monitoring.alarms.outside import web_server
from tests.pipeline.monitoring.alarms.test_channels import MESSAGE


def test_a_test_message_has_all_that_an_alarms_has_and_says_that_nothing_is_wrong(
    tmp_path: Path,
) -> None:
    before_ns = time.time_ns()
    with web_server() as server:
        settings = AlarmSettings(webhook=(WebhookSettings(server.url),))
        (checked,) = checked_channels(settings, tmp_path)
    (message,) = server.received
    assert message.keys() == MESSAGE.keys()
    assert (message["occasion"], message["kind"], message["turbine"]) == ("test", "test", "session")
    assert (message["id"], message["count"], message["acknowledged"]) == (0, 1, False)
    assert before_ns <= message["serial"] == message["first_ns"] == message["last_ns"]
    assert (message["host"], message["session"]) == (socket.gethostname(), str(tmp_path))
    assert message["text"] == f"session: {message['cause']}"
    assert "nothing is wrong" in message["cause"]
    assert (checked.channel, checked.place) == ("webhook-1", server.url.removesuffix("/hook"))
    assert checked.problem == ""
    assert 0 <= checked.seconds < 10


def test_every_heartbeat_gets_a_ping_of_no_open_alarm_and_what_fails_has_its_reason(
    tmp_path: Path,
) -> None:
    with web_server(503) as server:
        beats = (HeartbeatSettings(server.url), HeartbeatSettings(server.url))
        failed, arrived = checked_channels(AlarmSettings(heartbeat=beats), tmp_path)
    assert [failed.channel, arrived.channel] == ["heartbeat-1", "heartbeat-2"]
    assert "answered 503" in failed.problem
    assert arrived.problem == ""
    (ping,) = server.received
    assert ping["open"] == 0
    assert ping["session"] == str(tmp_path)


def test_the_command_fails_where_a_channel_does_and_prints_each_result(tmp_path: Path) -> None:
    file = tmp_path / "notices.toml"
    with web_server(503) as server:
        file.write_text(f'[[webhook]]\nurl = "{server.url}"\n' * 2)
        checked = CliRunner().invoke(app, ["notices", str(file), "--json"])
        asked = ["notices", str(file), "--test", "--json", "--out", str(tmp_path)]
        tested = CliRunner().invoke(app, asked)
    assert json.loads(checked.stdout) == {"file": str(file), "channels": 2}
    first, second = json.loads(tested.stdout)
    assert ("503" in first["problem"], second["problem"]) == (True, "")
    assert tested.exit_code != 0
    assert len(server.received) == 1
