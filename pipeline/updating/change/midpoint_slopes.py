"""How large a change was, by the model half way through it.

A step of the modes' ln f is read as a change of the springs, κ, by the slopes S = ∂ ln f / ∂ ratio.
A tenth of k22 changes the slopes by a tenth and more, so that those from before the change would
report it as twelve percent. The mean of the slopes before and after makes

    ln f(r + κ) − ln f(r) = ½ (S(r) + S(r + κ)) κ

right to the third order in κ (the trapezoidal rule along the way). κ is on both sides: a few
rounds of it settle.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.updating.change.detector import Change, ChangeDetector, ChangeState
from pipeline.updating.change.event_message import TrackSensitivity, sensitivities_of
from pipeline.updating.forward_model import ForwardModel
from pipeline.updating.likelihood.pairing import DIFFERENCE
from pipeline.updating.prior import Prior
from sensors.arrays import FloatArray

ROUNDS = 4  # of measuring a change again; each makes the error some ten times smaller


def stiffness_slopes(modes: ForwardModel, prior: Prior, ratios: FloatArray) -> FloatArray:
    """S = ∂ ln f / ∂ ratio of every mode of the model at (3,) ratios, (m, 3); NaN where the
    structure cannot stand."""
    points = ratios + DIFFERENCE * np.vstack([np.zeros(3), np.eye(3)])
    logs = np.log(modes.modal(prior.stiffness(points)).frequencies)
    return np.asarray((logs[1:] - logs[0]).T / DIFFERENCE)


def measured_half_way(
    found: Change,
    state: ChangeState,
    detector: ChangeDetector,
    modes: ForwardModel,
    prior: Prior,
    *,
    before: FloatArray,
    pairs: Sequence[TrackSensitivity],
) -> Change:
    """The change, measured by the mean of the slopes before and after it.

    found     as measured by the slopes before it
    modes     followed from the stiffness before, so that labels mean the same on both sides
    before    (3,) ratios k / nominal before it
    pairs     which tracks are which modes of the model, with the slopes there

    The answer is the one by the slopes before where no structure could stand after the change.
    """
    there = stiffness_slopes(modes, prior, before)
    for _ in range(ROUNDS):
        after = before + found.step.ratios
        if not prior.supports(after):
            break
        turned = (stiffness_slopes(modes, prior, after) - there) / 2
        half_way = [
            replace(each, slopes=each.slopes + turned[modes.labels.index(each.model)])
            for each in pairs
        ]
        if not all(np.all(np.isfinite(each.slopes)) for each in half_way):
            break
        known = sensitivities_of(state.sums.tracks, half_way)
        found = detector.remeasured(state, found, known)
    return found
