"""What looked like a mode and is not reported: every column of the diagram has a name."""

import numpy as np

from pipeline.oma.identification import identify
from tests.benchmarks.close_modes import pair


def test_columns_of_poles_are_modes_or_refused_with_a_reason() -> None:
    record = pair(60_001, 0.01)
    found = identify(record.samples[:3000], record.sampling_rate)
    named = [*(m.frequency for m in found.modes), *(r.frequency for r in found.refused)]
    for poles in found.diagrams:
        for frequency in poles.frequencies:
            near = np.abs(poles.frequencies / frequency - 1) <= 0.005
            orders = len(np.unique(poles.orders[near]))
            is_named = np.abs(np.array(named) / frequency - 1).min() <= 0.02
            assert is_named or orders < max(2, 0.6 * len(np.unique(poles.orders)))


def test_each_refusal_has_a_code_and_a_sentence_with_a_figure() -> None:
    refused = [
        each
        for seed in range(60_001, 60_006)
        for each in identify(pair(seed, 0.005).samples[:4000], 20.0).refused
    ]
    assert refused
    for each in refused:
        assert each.code.isidentifier()
        assert each.code == "harmonic" or any(letter.isdigit() for letter in each.text)
