"""The rules of the command line, kept for every command: one word a thing, JSON where it ends."""

import json
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from scipy.signal import lfilter

from pipeline.cli import app, main

WITHOUT_JSON = {
    "node": "runs until it is stopped; its results are messages",
    "metrics": "serves Prometheus until it is stopped",
    "show": "draws",
}
# command line in a folder with short.mcap and session.mcap → keys of what it prints
QUERIES: tuple[tuple[str, set[str]], ...] = (
    ("new two.csv -o made --sampling-rate 20", {"recording", "channels", "sampling_rate_hz"}),
    ("report session.mcap", {"turbines"}),
    ("simulate --list", {"name", "title", "duration_s"}),
    ("simulate --describe parked", {"name", "toml"}),
    ("simulate parked --duration 5 -o five.mcap", {"file", "size_bytes"}),
    ("import named.csv -o named.mcap", {"file", "size_bytes"}),
    ("info short.mcap", {"channels", "duration_s"}),
    ("salvage short.mcap -o again.mcap", {"file", "recovered"}),
    ("export short.mcap --csv", {"file", "rows"}),
    ("identify two.csv --sampling-rate 20", {"modes", "windows"}),
    ("modes", {"modes"}),
    ("certificates keys --viewer a", {"new", "written"}),
)


def commands() -> dict[str, Any]:
    return dict(typer.main.get_command(app).commands)  # type: ignore[attr-defined]


def options() -> Iterator[tuple[str, Any]]:
    """Command and option, for all of them."""
    for name, command in commands().items():
        for parameter in command.params:
            if parameter.param_type_name == "option":
                yield name, parameter


def test_every_command_that_ends_prints_json_if_asked() -> None:
    with_json = {name for name, option in options() if "--json" in option.opts}
    assert set(commands()) - with_json == set(WITHOUT_JSON)


def test_every_option_and_command_has_a_help_text() -> None:
    assert [name for name, command in commands().items() if not command.help] == []
    assert [(name, option.name) for name, option in options() if not option.help] == []


def test_an_option_has_one_type_in_all_commands() -> None:
    kinds: dict[str, set[str]] = defaultdict(set)
    for _, option in options():
        for word in option.opts:
            kinds[word].add(str(option.bare_type()).removeprefix("list[").removesuffix("]"))
    assert {word: found for word, found in kinds.items() if len(found) > 1} == {}


def test_a_short_letter_has_one_long_word() -> None:
    words: dict[str, set[str]] = defaultdict(set)
    for _, option in options():
        for letter in (each for each in option.opts if len(each) == 2):
            words[letter] |= {each for each in option.opts if len(each) > 2}
    assert {letter: found for letter, found in words.items() if len(found) > 1} == {}


def test_options_are_words_with_hyphens() -> None:
    for name, option in options():
        for word in option.opts:
            assert word == word.lower(), (name, word)
            assert "_" not in word, (name, word)


@pytest.fixture
def folder(
    tmp_path: Path,
    short_recording: Path,
    short_session: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> Path:
    """The working folder: a recording, a session and two tables of one mode."""
    monkeypatch.chdir(tmp_path)
    Path("short.mcap").symlink_to(short_recording)
    Path("session.mcap").symlink_to(short_session)
    noise = np.random.default_rng(7).standard_normal((6000, 2))
    table = lfilter([1.0], [1.0, -1.6, 0.98], noise, axis=0)  # one mode at a tenth of the rate
    for name, header in (("two", "a,b"), ("named", "z80-fa,z80-ss")):
        np.savetxt(f"{name}.csv", table, delimiter=",", header=header, comments="")
    return tmp_path


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(("line", "keys"), QUERIES, ids=[line for line, _ in QUERIES])
def test_what_a_command_finds_is_json(
    line: str,
    keys: set[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    rate = ["--sampling-rate", "20"] if line.startswith("import") else []
    monkeypatch.setattr(sys, "argv", ["pilewatch", *line.split(), *rate, "--json"])
    with pytest.raises(SystemExit) as ended:
        main()
    printed = capsys.readouterr()
    assert ended.value.code in (0, None), printed.err
    found = json.loads(printed.out)
    first = found[0] if isinstance(found, list) else found
    assert keys <= set(first)


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("simulate --list", ["parked", "bad-sensors", "tide"]),
        ("simulate --describe parked", ["[simulation]", "seed"]),
        ("info short.mcap", ["AccelerationBlock", "tower", "240"]),
        ("salvage short.mcap -o again.mcap", ["again.mcap: ", "complete chunk"]),
        ("export short.mcap --csv", [".csv", "rows"]),
        ("certificates keys --viewer a", ["keys"]),
    ],
)
def test_what_a_command_finds_is_words_where_no_json_is_asked_for(
    line: str,
    words: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr(sys, "argv", ["pilewatch", *line.split()])
    with pytest.raises(SystemExit) as ended:
        main()
    printed = capsys.readouterr()
    assert ended.value.code in (0, None), printed.err
    assert [word for word in words if word not in printed.out] == []
