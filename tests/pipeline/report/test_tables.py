"""Cells of the report's tables, as a reader meets them."""

from types import SimpleNamespace
from typing import Any

from pipeline.messages import ParameterSummary
from pipeline.report.tables import figures_table


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
