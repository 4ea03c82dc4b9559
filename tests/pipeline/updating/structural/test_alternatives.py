"""Structures are weighed by what was thought of them before and by how they explain the data."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from pipeline.updating.structural.alternatives import Alternative, JointInference


def weights_of(
    costs: dict[str, float],
    probabilities: dict[str, float],
    *,
    priors: dict[str, float] | None = None,
    degrees: int = 40,
    compared: dict[str, int] | None = None,
) -> list[float]:
    """Of structures whose fits end at these costs, of which so much is the figures' prior.

    compared   degrees of freedom of each; all the same by default
    """
    found = [
        (
            Alternative(name, probabilities[name]),
            SimpleNamespace(
                is_rough=False,
                judged=lambda *_, cost=cost: (cost, 0.0),
                coordinates=SimpleNamespace(
                    prior_cost=lambda _, name=name: (priors or {}).get(name, 0.0)
                ),
            ),
            SimpleNamespace(
                u=None, relative_cost=cost / degrees, degrees=(compared or {}).get(name, degrees)
            ),
            SimpleNamespace(likeliest_sigma=0.0),
        )
        for name, cost in costs.items()
    ]
    nothing = cast(Any, None)
    inference = JointInference(
        (), structure=nothing, layout=nothing, prior=nothing, highest_sigma=0.1
    )
    return inference._weights(cast(Any, found), nothing)


def test_structures_that_explain_the_data_alike_keep_their_prior_probabilities() -> None:
    assert weights_of({"dry": 40.0, "flooded": 40.0}, {"dry": 0.9, "flooded": 0.1}) == (
        pytest.approx([0.9, 0.1])
    )


def test_a_cost_of_two_more_is_a_factor_of_e() -> None:
    dry, flooded = weights_of({"dry": 40.0, "flooded": 42.0}, {"dry": 0.5, "flooded": 0.5})
    assert dry / flooded == pytest.approx(2.718281828)


def test_where_modes_err_by_more_than_they_state_a_figure_far_from_its_prior_does_not_win() -> None:
    """Costs 80 and 76 at 40 degrees: a misfit of 72 and 34, a prior of 8 and 42. φ = 1.9."""
    dry, flooded = weights_of(
        {"dry": 80.0, "flooded": 76.0},
        {"dry": 0.5, "flooded": 0.5},
        priors={"dry": 8.0, "flooded": 42.0},
    )
    assert dry / flooded == pytest.approx(np.exp(((34 - 72) / 1.9 + 42 - 8) / 2))


def test_what_is_left_out_of_the_comparison_does_not_count_as_a_gain() -> None:
    """A shape of eight components that one structure does not compare saves it eight by chance."""
    whole, part = weights_of(
        {"whole": 40.0, "part": 32.0},
        {"whole": 0.5, "part": 0.5},
        compared={"whole": 40, "part": 32},
    )
    assert whole == pytest.approx(part)


def test_of_the_structures_those_stay_whose_support_is_like_ones_or_as_described() -> None:
    nothing = cast(Any, None)
    every = [
        Alternative("", 0.4),
        Alternative("reduced blades", 0.2),
        Alternative("flooded", 0.2, "flooded"),
        Alternative("flooded, reduced blades", 0.1, "flooded"),
        Alternative("scoured", 0.1, "scoured"),
    ]
    inference = JointInference(
        [(each, nothing) for each in every],
        structure=nothing,
        layout=nothing,
        prior=nothing,
        highest_sigma=0.1,
    )
    assert [each for each, _ in inference.with_support_of(every[3]).fits] == every[:4]
    assert [each for each, _ in inference.with_support_of(every[1]).fits] == every[:2]
