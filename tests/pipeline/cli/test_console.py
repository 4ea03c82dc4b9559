"""What is printed, and how it is folded; untrusted text is no markup."""

import json
import logging
import sys
import threading
from importlib.metadata import PackageNotFoundError
from io import StringIO
from pathlib import Path

import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st
from rich.text import Text

from pipeline.cli import ConsoleHandler, main, print_version
from pipeline.cli.console import (
    LineConsole,
    LogConsole,
    View,
    escape_markup,
    stderr,
    zenoh_settings,
)
from sensors.errors import InputError


@given(st.text(alphabet=r"\[]/ab"))
def test_no_text_is_markup_whatever_it_holds(text: str) -> None:
    """Of backslashes before a bracket rich may print one more."""
    printed = Text.from_markup(escape_markup(text))
    assert printed.plain.replace("\\", "") == text.replace("\\", "")
    assert not printed.spans


@pytest.mark.parametrize(
    "endpoint",
    ["tcp/host", "tcp/127.0.0.1:99999", "tcp/:7447", "127.0.0.1:7447", "tcp/a:b", "", "x", "udp/"],
)
@pytest.mark.parametrize("option", ["listen", "connect"])
def test_what_is_no_endpoint_is_refused_with_its_option(option: str, endpoint: str) -> None:
    given = {"listen": None, "connect": None} | {option: ["tcp/a:1", endpoint]}
    with pytest.raises(InputError, match=f"--{option} {endpoint}: no endpoint"):
        zenoh_settings("peer", config=None, **given)


def test_endpoints_of_every_protocol_are_taken() -> None:
    several = ["tcp/[::1]:7447", "tls/a.example:0", "udp/a:1?x=1#iface=eth0", "unixpipe//tmp/a"]
    assert zenoh_settings("peer", several, None, None).listen == tuple(several)


def test_a_file_of_zenohs_sets_the_mode_and_no_option_besides() -> None:
    file = Path("zenoh.json5")
    assert zenoh_settings("peer", None, None, file).config_file == file
    assert zenoh_settings("client", None, ["tcp/a:1"], None).connect == ("tcp/a:1",)
    with pytest.raises(InputError, match="--mode client and --zenoh-config"):
        zenoh_settings("client", None, None, file)


def test_a_long_sentence_is_one_line_where_the_output_is_no_terminal() -> None:
    written = StringIO()
    LineConsole(file=written, width=40).print("word " * 40)
    LineConsole(file=written, width=40, force_terminal=True).print("word " * 40)
    first, *rest = written.getvalue().splitlines()
    assert first.count("word") == 40
    assert len(rest) > 1


def test_lines_of_json_have_a_level_and_no_bar_between_them() -> None:
    written = StringIO()
    console = LogConsole(file=written, width=40, force_terminal=True)
    console.json_lines = True
    console.print("[bold red]pilewatch:[/] " + escape_markup("no [oma] key " + "word " * 40))
    console.print("[yellow]beware[/]")
    console.print("nothing [special]", markup=False)
    lines = [json.loads(line) for line in written.getvalue().splitlines()]
    assert [line["level"] for line in lines] == ["error", "warning", "info"]
    assert lines[0]["message"].startswith("no [oma] key word")
    assert lines[2]["message"] == "nothing [special]"
    assert not console.is_terminal


def test_a_log_is_json_where_the_option_or_the_environment_asks(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(stderr, "json_lines", False)
    monkeypatch.setenv("PILEWATCH_LOG_FORMAT", "json")
    monkeypatch.setattr("sys.argv", ["pilewatch", "info", "nothing.mcap"])
    with pytest.raises(SystemExit, match="2"):
        main()
    try:
        raise ValueError("inside")
    except ValueError:
        record = logging.LogRecord("node", logging.ERROR, "", 0, "%s lost", ("t1",), None)
        record.exc_info = sys.exc_info()
    ConsoleHandler().emit(record)
    first, second = map(json.loads, capsys.readouterr().err.splitlines())
    assert first["level"] == "error"
    assert first["message"].startswith("cannot read the recording nothing.mcap")
    assert (second["logger"], second["message"]) == ("node", "t1 lost")
    assert "ValueError: inside" in second["exception"]
    assert set(first) == {"time", "level", "logger", "message"}


def test_a_tower_unit_states_its_version(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def of_the_edge(name: str) -> str:
        if name != "pilewatch-edge":
            raise PackageNotFoundError(name)
        return "1.2.3"

    monkeypatch.setattr("pipeline.cli.version", of_the_edge)
    with pytest.raises(typer.Exit):
        print_version(True)
    assert capsys.readouterr().out == "pilewatch-edge 1.2.3\n"


@pytest.mark.parametrize(
    ("page", "ended", "waits"),
    [("http://a", False, True), ("", False, False), ("http://a", True, False)],
)
def test_a_served_page_stays_until_the_session_is_stopped(
    page: str, ended: bool, waits: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    stopping = threading.Event()
    if ended:
        stopping.set()
    waiting = threading.Thread(target=View(None, page).wait, args=(stopping,))
    waiting.start()
    waiting.join(0.05 if waits else 10.0)
    assert waiting.is_alive() is waits
    stopping.set()
    waiting.join(10.0)
    assert ("The page stays at http://a until Ctrl-C." in capsys.readouterr().err) is waits
