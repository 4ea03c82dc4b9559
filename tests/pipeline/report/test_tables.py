"""Cells of the report's tables, as a reader meets them."""

from types import SimpleNamespace
from typing import Any

import pytest

from pipeline.messages import ModePair, ParameterSummary, QualityWarning
from pipeline.report.html import TextTable
from pipeline.report.pictures.samples import ChannelStatistics
from pipeline.report.tables import (
    _remark,
    figures_table,
    modes_table,
    rejected_table,
    springs_table,
    warnings_table,
    without_blank_columns,
)
from pipeline.state.run_modes import CombinedMode
from tests.pipeline.example_messages import rejection
from tests.pipeline.report.example_session import posterior


def test_a_figure_that_a_rough_model_widens_is_not_narrowed_and_nothing_is_0() -> None:
    growth = ParameterSummary("marine_growth", "m", 0.0, 0.02, 5.9e-9, 0.1508, contraction=-1.65)
    heading = ParameterSummary("heading 41 m", "deg", 0.0, 0.27, -2.8, 3.3, contraction=0.074)
    old = ParameterSummary("rna_mass", "-", 1.0, 1.0, 0.9, 1.1)  # as recorded before it was told
    record: Any = SimpleNamespace(
        state=SimpleNamespace(posterior=SimpleNamespace(figures=(growth, heading, old)))
    )
    rows = figures_table(record).rows
    assert [row[2] for row in rows] == ["0 to 0.1508", "-2.8 to 3.3", "0.9 to 1.1"]
    assert [row[4] for row in rows] == ["0.0", "7.4", ""]


def cells(table: TextTable) -> list[tuple[str, ...]]:
    return list(table.rows)


def test_a_column_without_a_value_is_left_out_and_sentences_keep_their_column() -> None:
    table = TextTable("t", ("a", "b", "c"), (("1", "", "x"), ("", "", "y")), words=(1, 2))
    assert without_blank_columns(table) == TextTable(
        "t", ("a", "c"), (("1", "x"), ("", "y")), words=(1,)
    )


def test_modes_have_figures_of_the_model_where_they_are_paired_and_nothing_where_not() -> None:
    pair = ModePair("m1", "3", 0.16, 0.001, 0.15, 0.987, False, misfit=-1.26, information=0.42)
    known = CombinedMode("3", 0.16, 0.001, 0.0123, 0.0045, (1.0,), 7, "p", 1.0, pair)
    nan = float("nan")
    bare = CombinedMode("m2", 0.2, nan, 0.01, nan, (1.0,), 1, "", 1.0)
    record: Any = SimpleNamespace(state=SimpleNamespace(modes=[known, bare]))
    assert cells(modes_table(record)) == [
        ("3 ≈", "0.1600", "0.0010", "1.23", "0.45", "7", "0.1500", "0.987 –", "-1.3", "42 %"),
        ("m2", "0.2000", "", "1.00", "", "1", "", "", "", ""),
    ]
    without: Any = SimpleNamespace(state=SimpleNamespace(modes=[bare]))
    assert modes_table(without).head == ("mode", "f [Hz]", "ζ [%]", "windows")


def test_springs_are_over_nominal_with_the_truth_where_it_is_known() -> None:
    state: Any = SimpleNamespace(posterior=posterior(0, k22=0.9), truth=None)
    record: Any = SimpleNamespace(state=state)
    bare = springs_table(record)
    assert "truth" not in bare.head
    assert [row[0] for row in bare.rows] == ["k11", "k22", "k12", "σ"]
    assert bare.rows[1][1:3] == ("0.9000", "0.8910 to 0.9090")
    assert bare.rows[1][-1] == "99.4"  # narrowed by [%]
    nominal = {each.name: each.nominal for each in posterior(0).parameters}
    state.truth = SimpleNamespace(
        k11=1.1 * nominal["k11"], k22=0.95 * nominal["k22"], k12=nominal["k12"]
    )
    assert [row[3] for row in springs_table(record).rows] == ["1.1000", "0.9500", "1.0000", ""]


@pytest.mark.parametrize(("number", "note"), [(60, ""), (61, " (the last 60 of 61)")])
def test_of_many_rows_the_newest_sixty_are_shown_and_the_rest_counted(
    number: int, note: str
) -> None:
    table = rejected_table([rejection(window) for window in range(number)])
    assert table.title == f"Rejected windows{note}"
    assert len(table.rows) == 60
    assert table.rows[-1][1:] == ("10 min", "gap", "gap of 0.4 s in tower")
    warnings = [QualityWarning(f"code-{n}", "text") for n in range(number)]
    record: Any = SimpleNamespace(state=SimpleNamespace(warnings=warnings))
    shown = warnings_table(record)
    assert (shown.rows[0][0], len(shown.rows)) == ("code-0", 60)
    assert shown.title == ("Warnings" if number == 60 else "Warnings (the first 60 of 61)")


@pytest.mark.parametrize(
    ("deviation", "missing", "remark"),
    [
        (1.0, 0.0, ""),
        (1.0, 0.999, ""),
        (float("nan"), 1.0, "no sample"),
        (1e-6, 0.0, "constant: measures nothing"),
        (1.1e-6, 0.0, ""),
        (0.0, 0.0, "constant: measures nothing"),
    ],
)
def test_a_channel_that_measures_nothing_is_remarked(
    deviation: float, missing: float, remark: str
) -> None:
    """Beside one whose deviation is 1."""
    assert _remark(ChannelStatistics(deviation, 1.0, missing), 1.0) == remark
