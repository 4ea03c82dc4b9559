"""The figures of summary.json."""

import json
from dataclasses import replace

import numpy as np
import pytest

from pipeline.cli.tables.posteriors import figures_tables, posterior_table
from pipeline.messages import FoundationPosterior, FoundationTruth, ParameterSummary
from pipeline.state.posterior_json import (
    empty_summary,
    plus_minus,
    posterior_summary,
    widest_half_width,
)

POSTERIOR = FoundationPosterior(
    turbine="small",
    window=5,
    time_ns=0,
    n_windows=6,
    parameters=(
        ParameterSummary("k11", "N/m", 1e10, 1.1e10, 1.0e10, 1.2e10),
        ParameterSummary("k22", "N·m/rad", 8e11, 8e11, 7.2e11, 8.8e11),
        ParameterSummary("k12", "N/rad", -7e10, -7e10, -7.7e10, -6.3e10),
        ParameterSummary("sigma", "-", 1.0, 0.001, 0.0, 0.003),
    ),
    correlation=np.eye(3),
    draws=np.zeros((1, 4)),
    pairs=(),
    model_labels=(),
    model_frequencies=np.zeros(0),
    model_shapes=np.zeros((0, 8)),
    sampler="emcee",
    ess=1234.0,
    rhat=float("nan"),
    autocorrelation_time=2.0,
    reduced_chi_square=1.0,
    paired_share=1.0,
    pairing_cost=0.5,
)
TRUTH = FoundationTruth("small", 0, k11=1.05e10, k22=9e11, k12=-7e10)


def test_ratios_are_to_nominal_and_in_rising_order_for_a_negative_coupling_too():
    k12 = posterior_summary(POSTERIOR)["k12"]
    assert (k12["ratio_p05"], k12["ratio_median"], k12["ratio_p95"]) == pytest.approx(
        (0.9, 1.0, 1.1)
    )


def test_the_widest_interval_is_over_its_own_median_not_over_nominal():
    assert widest_half_width(POSTERIOR) == pytest.approx(0.1)
    k11, k22, *others = POSTERIOR.parameters
    soft = replace(k22, median=4e11, p05=3.4e11, p95=4.8e11)  # half of nominal
    assert widest_half_width(replace(POSTERIOR, parameters=(k11, soft, *others))) == pytest.approx(
        0.7 / 4
    )


def test_the_truth_is_a_ratio_where_it_is_known_and_null_where_not():
    assert posterior_summary(POSTERIOR, TRUTH)["k11"]["truth_ratio"] == pytest.approx(1.05)
    assert posterior_summary(POSTERIOR)["k11"]["truth_ratio"] is None


def test_the_summary_is_valid_json_with_null_for_what_is_unknown():
    text = json.dumps(posterior_summary(POSTERIOR), allow_nan=False)
    assert json.loads(text)["rhat"] is None


def test_a_session_without_a_posterior_has_the_same_keys():
    assert _keys(empty_summary()) == _keys(posterior_summary(POSTERIOR))


def _keys(summary):
    return {
        name: sorted(value) if isinstance(value, dict) else None for name, value in summary.items()
    }


def test_how_probable_a_change_is_stands_in_it_and_is_unknown_without_a_posterior():
    posterior = replace(POSTERIOR, change_probability=0.25)
    assert posterior_summary(posterior)["change_probability"] == 0.25
    assert empty_summary()["change_probability"] is None


def test_figures_of_the_structure_that_are_uncertain_stand_beside_the_springs():
    mass = ParameterSummary("rna_mass", "-", 1.0, 1.02, 1.0, 1.04, contraction=0.6)
    posterior = replace(POSTERIOR, figures=(mass,))
    summary = posterior_summary(posterior) | {"windows": 6, "sampler": "importance", "rhat": 1.0}
    assert summary["figures"] == {
        "rna_mass": {"unit": "-", "median": 1.02, "p05": 1.0, "p95": 1.04, "contraction": 0.6}
    }
    assert posterior_summary(POSTERIOR)["figures"] == empty_summary()["figures"] == {}
    names = list(posterior_table(summary).columns[0].cells)
    assert names == ["k11", "k22", "k12", "σ"]
    (figures,) = figures_tables(summary)
    assert [list(column.cells) for column in figures.columns] == [
        ["RNA mass"],
        ["1.02"],
        ["1 to 1.04"],
        ["-"],
        ["60"],
    ]
    wider = {"rna_mass": summary["figures"]["rna_mass"] | {"contraction": -0.2}}
    assert list(figures_tables(summary | {"figures": wider})[0].columns[-1].cells) == ["0"]
    assert not figures_tables(summary | {"figures": {}})


def test_ratios_are_to_nominal_not_to_the_median():
    """k11's median lies a tenth above nominal: its interval is 1.0 to 1.2 of nominal."""
    k11 = posterior_summary(POSTERIOR)["k11"]
    assert (k11["ratio_p05"], k11["ratio_median"], k11["ratio_p95"]) == pytest.approx(
        (1.0, 1.1, 1.2)
    )
    for name in ("median", "p05", "p95"):
        assert k11[name] == pytest.approx(k11[f"ratio_{name}"] * 1e10)


def test_sigma_has_its_median_below_its_bound():
    assert posterior_summary(POSTERIOR)["sigma"] == {"median": 0.001, "p95": 0.003}


def test_a_wide_posterior_is_its_interval_and_no_plus_minus() -> None:
    narrow = ParameterSummary("k11", "N/m", 1e10, 1.1e10, 1.0e10, 1.2e10)
    assert plus_minus(narrow) == "1.100 ± 0.100"
    wide = ParameterSummary("k22", "N·m/rad", 8e11, 12e11, 4e11, 40e11)
    assert plus_minus(wide) == "0.50 to 5.00"
