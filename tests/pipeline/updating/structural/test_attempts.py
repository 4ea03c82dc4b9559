"""Which tolerance of the pairing a refresh takes where none pairs enough modes."""

from types import SimpleNamespace
from typing import Any, cast

from pipeline.updating.acceptance import AcceptanceSettings
from pipeline.updating.structural.refresh import _Attempt


def attempt(paired_share: float, cost: float) -> _Attempt:
    pairing = SimpleNamespace(paired_share=paired_share, cost=cost)
    peak = SimpleNamespace(comparison=SimpleNamespace(pairing=pairing))
    result = SimpleNamespace(best=SimpleNamespace(peak=peak))
    return _Attempt(cast(Any, result), cast(Any, None))


def test_an_answer_comes_before_a_refusal_that_pairs_more() -> None:
    guards = AcceptanceSettings()
    answered, refused = attempt(0.6, 0.1), attempt(0.7, 2 * guards.refused_cost)
    assert answered.refusal(guards) is None
    assert refused.refusal(guards) is not None
    assert max(refused, answered, key=lambda each: each.rank(guards)) is answered


def test_of_answers_the_one_that_pairs_most_is_taken() -> None:
    guards = AcceptanceSettings()
    few, more = attempt(0.55, 0.1), attempt(0.7, 0.1)
    assert max(few, more, key=lambda each: each.rank(guards)) is more
