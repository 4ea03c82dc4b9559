"""Figures in the cells of tables."""

import shlex
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from pipeline.cli import main
from pipeline.cli.tables.cells import format_short, format_value, table_of
from pipeline.cli.tables.posteriors import farm_table, figures_tables
from pipeline.cli.tables.recordings import recording_tables, span_line
from pipeline.messages import NodeStatus, ParameterSummary, StreamGap
from pipeline.recording.info import RecordingInfo, UnitInfo
from pipeline.state.phrases import count_noun
from sensors.acquisition.blocks import NANOSECONDS
from sensors.structure.description import shipped_text


@pytest.mark.parametrize(
    ("figure", "text"), [(None, "unknown"), (1.25, "1.2"), (0.0, "0.0"), (float("nan"), "nan")]
)
def test_what_is_not_known_is_said_to_be_unknown(figure: float | None, text: str) -> None:
    assert format_value(figure, ".1f") == text


def test_a_noun_follows_its_count() -> None:
    assert (count_noun(1, "window"), count_noun(2, "window")) == ("1 window", "2 windows")


@pytest.mark.parametrize(
    ("figure", "text"),
    [(None, "unknown"), (-0.00573, "-0.00573"), (81849.0, "81800"), (1.234e7, "1.23e+07")],
)
def test_a_mass_of_tons_needs_no_exponent(figure: float | None, text: str) -> None:
    assert format_short(figure) == text


def test_no_figure_of_the_structure_is_cut_on_a_terminal_of_eighty_columns() -> None:
    """On main before, `8.18e+…` stood there, of an interval `2.11e+03 to 2.33e+…`."""
    mass = {"median": 81849.0, "p05": -210_400.0, "p95": 233_300.0, "unit": "kg"}
    gain = {"median": -0.00573, "p05": -0.00773, "p95": 0.00557, "unit": "deg", "contraction": 1.0}
    figures = {"transition_piece": mass, "nacelle_pitch_inertia": gain, "gain z145-fa": gain}
    text = printed(*figures_tables({"figures": figures}), width=80)
    assert "…" not in text
    assert "-210000 to 233000" in text


def test_no_word_of_a_heading_is_cut_on_a_terminal_of_eighty_columns() -> None:
    """On main before, the status of a session had columns "conditi…" and "recover…"."""
    headings = ("silent [s]", "behind [blocks]", "received", "lost", "recovered")
    table = table_of("nodes", "node", "condition", figures=headings)
    table.columns[0].no_wrap = True  # as of the status: shares of a node differ in the last letters
    table.add_row("identification", "alive", "0.8", "", "1261", "0", "8")
    text = printed(table, width=80)
    assert "…" not in text
    assert all(word in text for heading in headings for word in heading.split())


def test_a_column_is_as_wide_as_the_longest_word_of_its_heading() -> None:
    table = table_of("nodes", "a condition", "", figures=("behind [blocks]",))
    assert [each.min_width for each in table.columns] == [9, 0, 8]


def printed(*tables: Any, width: int = 200) -> str:
    console = Console(width=width, record=True, file=Path("/dev/null").open("w"))  # noqa: SIM115
    for table in tables:
        console.print(table)
    return console.export_text()


def test_a_farms_table_gives_half_of_each_interval_in_percent() -> None:
    spring = ParameterSummary("k11", "N/m", 1e10, 0.98e10, 0.95e10, 1.01e10)
    turbine = SimpleNamespace(
        turbine="t7", pooled=[spring] * 3, outlying=False, outlier_probability=0.02, n_windows=5
    )
    spread = SimpleNamespace(median=0.02, p05=0.01, p95=0.03)
    farm: Any = SimpleNamespace(turbines=[turbine], spread=[spread] * 3, rhat=1.0)
    assert "0.980 ± 3.0" in printed(farm_table(farm))


def test_a_recordings_table_gives_the_seconds_that_are_missing() -> None:
    missing = (
        StreamGap("t1", "tower", "s", 1 * NANOSECONDS, 3 * NANOSECONDS, 1, 2),
        StreamGap("t1", "tower", "s", 7 * NANOSECONDS, 8 * NANOSECONDS, 7, 1),
    )
    unit = UnitInfo(
        *("t1", "tower", "s", 40.0, 8, 10, 0, 13 * NANOSECONDS, missing, "four-levels"),
        first_sample=0,
        next_sample=520,
        first_sequence=0,
        last_sequence=12,
        missing=((40, 120), (280, 320)),
        in_order=True,
    )
    info = RecordingInfo(Path("a.mcap"), 100, {}, (), (unit,), (), ())
    assert "2 (3.0 s)" in printed(*recording_tables(info))


@pytest.mark.parametrize(
    ("start", "line"),
    [
        (1_740_787_200, "2025-03-01 00:00:00.000 to 2025-03-01 00:00:13.500 UTC"),
        (0, "0.000 s to 13.500 s of a clock without a date"),
    ],
)
def test_the_span_of_a_recording_is_that_of_all_units_in_utc(start: int, line: str) -> None:
    def unit(name: str, begin: float, end: float) -> UnitInfo:
        times = (int((start + each) * NANOSECONDS) for each in (begin, end))
        return UnitInfo("t1", name, "s", 40.0, 8, 10, *times, ())

    units = (unit("foot", 1, 13.5), unit("top", 0, 12))
    info = RecordingInfo(Path("a.mcap"), 100, {}, (), units, (), ())
    assert span_line(info) == f"samples = {line}"
    assert span_line(RecordingInfo(Path("a.mcap"), 100, {}, (), (), (), ())) == ""


@pytest.mark.parametrize(("last", "text"), [(-1, ""), (0, "0"), (7, "7")])
def test_a_node_that_has_taken_the_first_block_has_its_number_0(last: int, text: str) -> None:
    status = NodeStatus("t1", "updating", 0, "running", last_sequence=last)
    info = RecordingInfo(Path("a.mcap"), 100, {}, (), (), (), (status,))
    *_, nodes = recording_tables(info)
    assert list(nodes.columns[2].cells) == [text]


def test_brackets_in_a_title_a_heading_or_a_cell_are_no_markup() -> None:
    table = table_of("WTG [/b]", "key [old]", figures=("f [Hz]",))
    table.add_row("[red]a[/]", "1")
    console = Console(width=80)
    with console.capture() as captured:
        console.print(table)
    for text in ("WTG [/b]", "key [old]", "f [Hz]", "[red]a[/]"):
        assert text in captured.get()


BRACKETS = (  # command line, what it prints
    ("describe '[b].toml'", "WTG [/b]"),
    ("modes --structure '[b].toml'", "WTG [/b]"),
    ("info 'a [old].mcap'", "a [old].mcap"),
    ("salvage 'a [old].mcap' -o 'b [x].mcap'", "b [x].mcap:"),
    ("export 'a [old].mcap' -o 'e [x]' --csv", "e [x]/"),
    ("import '[c].csv' -o 'd [x].mcap' --sampling-rate 20", "d [x].mcap:"),
    ("new '[c].csv' -o 'n [x]' --sampling-rate 20", "Written: n [x]/layout.toml"),
)


@pytest.mark.parametrize(("line", "text"), BRACKETS, ids=[line for line, _ in BRACKETS])
def test_names_and_titles_with_brackets_are_printed_as_they_are(
    line: str,
    text: str,
    short_recording: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    title = "IEA 15 MW reference turbine, monopile, parked"
    described = shipped_text("iea15mw_monopile")
    assert title in described
    Path("[b].toml").write_text(described.replace(title, "WTG [/b]"))
    Path("a [old].mcap").write_bytes(short_recording.read_bytes())
    samples = np.random.default_rng(3).standard_normal((400, 2))
    np.savetxt("[c].csv", samples, delimiter=",", header="z20-fa,z40-fa", comments="")
    monkeypatch.setattr(sys, "argv", ["pilewatch", *shlex.split(line)])
    with pytest.raises(SystemExit) as ended:
        main()
    printed = capsys.readouterr()
    assert ended.value.code in (0, None), printed.err
    assert text in printed.out
