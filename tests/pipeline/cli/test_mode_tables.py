"""Figures of modes as tables show them: units, signs, counts, and what is not there."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.table import Table

from pipeline.cli.tables.modes import (
    identified_modes_table,
    model_modes_table,
    nearest_modes_table,
    refused_table,
    structure_tables,
)
from pipeline.cli.tables.posteriors import misfit_table
from pipeline.messages import ModePair, RefusedMode
from pipeline.offline.identify_file import RefusedCandidate
from pipeline.offline.model_modes import NearestMode, model_modes
from pipeline.oma.cross_check import CrossCheck
from pipeline.state.run_modes import CombinedMode

PAIR = ModePair("m1", "3", 0.16, 0.001, 0.15, 0.987, False, misfit=-1.26, information=0.42)


def mode(name: str, **changes: Any) -> CombinedMode:
    return CombinedMode(
        name, 0.16, 0.001, 0.0123, 0.0045, (1.0,), 7, **({"pair_id": "", "quality": 1.0} | changes)
    )


def rows(table: Table) -> list[list[str]]:
    return [
        list(map(str, row)) for row in zip(*(each.cells for each in table.columns), strict=True)
    ]


def test_identified_modes_stand_beside_their_pairs_and_second_estimates_where_there_are_some() -> (
    None
):
    checks = {"3": CrossCheck(0.161, 0.02, 0.0, 0.0)}
    modes = [mode("3", pair=PAIR, pair_id="p"), mode("m2")]
    own = ["0.1600", "0.0010", "1.23", "0.45", "7"]
    assert rows(identified_modes_table(modes, 9, checks)) == [
        ["3 ≈", *own, "0.1500", "0.987", "0.1610", "2.00"],
        ["m2", *own, "", "", "–", "–"],
    ]
    assert rows(identified_modes_table(modes[1:], 9)) == [["m2", *own]]
    assert "9 windows" in str(identified_modes_table(modes, 9).title)
    assert identified_modes_table(modes, 9).caption == (
        "≈ one of two modes that cannot be separated: only their mean is sure"
    )
    assert identified_modes_table(modes[1:], 9).caption is None


def test_windows_of_candidates_that_are_no_modes_are_counted_from_one() -> None:
    refused = RefusedCandidate(0, RefusedMode(0.2, 0.031, "vague", "known to 40 %"))
    assert rows(refused_table([refused])) == [["1", "0.2000", "3.10", "vague", "known to 40 %"]]


def test_a_mode_above_the_models_is_apart_by_a_positive_share() -> None:
    above, below = NearestMode(mode("m1"), "3", 0.15, 0.9), NearestMode(mode("m2"), "4", 0.2, 0.8)
    assert rows(nearest_modes_table([above, below])) == [
        ["m1", "0.1600", "3", "0.1500", "+6.67", "0.900"],
        ["m2", "0.1600", "4", "0.2000", "-20.00", "0.800"],
    ]


def test_the_models_modes_stand_beside_the_published_ones_with_the_difference() -> None:
    found = model_modes()
    shown = {row[0]: row[1:] for row in rows(model_modes_table(found))}
    assert len(shown) == len(found.as_json())
    for each in found.as_json():
        direction, frequency, published, difference, blades = shown[each["name"]]
        assert (direction, frequency) == (each["direction"], f"{each['frequency_hz']:.4f}")
        assert blades == f"{100 * each['blade_energy_share']:.0f} %"
        if each["table1_hz"] is None:
            assert (published, difference) == ("", "")
        else:
            share = float(difference.removesuffix(" %")) / 100
            assert float(published) * (1 + share) == pytest.approx(
                float(frequency), rel=1e-4, abs=1.5e-4
            )


def test_a_structures_modes_have_their_blades_share_in_percent() -> None:
    figures = SimpleNamespace(
        description=SimpleNamespace(title="", name="pole"),
        rows=lambda: [("water depth", "30 m")],
        first=[(0.1573, "FA", 0.256), (1.0, "torsion", 0.0)],
    )
    described, modes = structure_tables(figures)  # type: ignore[arg-type]
    assert rows(described) == [["water depth", "30 m"]]
    assert rows(modes) == [["0.1573", "FA", "26 %"], ["1.0000", "torsion", "0 %"]]


def test_a_misfit_has_the_sign_of_what_was_measured_over_what_the_model_has() -> None:
    low = ModePair("m2", "1", 0.1, 0.001, 0.125, 0.5, True, misfit=2.04, information=0.005)
    posterior = SimpleNamespace(
        pairs=(PAIR, low), paired_share=0.75, reduced_chi_square=np.float64(1.234)
    )
    table = misfit_table(posterior)  # type: ignore[arg-type]
    assert rows(table) == [
        ["1", "0.1000", "0.1250", "-20.00", "+2.0", "0.500", "0 %"],
        ["3", "0.1600", "0.1500", "+6.67", "-1.3", "0.987 –", "42 %"],
    ]
    assert "75 % of the identified modes paired, reduced χ² 1.23" in str(table.caption)
