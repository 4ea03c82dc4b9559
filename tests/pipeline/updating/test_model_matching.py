"""Which modes are compared is the pairing's affair, and the scenario's where it names them."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.evidence.observations import EstimateRefused
from pipeline.updating.exact_inference import ExactInference
from pipeline.updating.likelihood.likelihood import LikelihoodSettings
from pipeline.updating.likelihood.pairing import PairingSettings
from pipeline.updating.model_matching import Matcher, rise_of_comparison
from pipeline.updating.prior import Prior, UpdatingError
from pipeline.updating.settings import UpdatingSettings
from pipeline.updating.state import UpdatingState
from tests.pipeline.updating.small_tower import LAYOUT, LinearTower, drawn_estimate

TOWER = LinearTower()
TRUTH = np.array([1.1, 0.9, 0.95])


@dataclass(frozen=True)
class SteepTower(LinearTower):
    """Its water's effect doubles for an eighth more stiffness."""

    water: tuple[float, float] = (-0.006, -0.001)
    followed_from: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def following(self, theta_reference):
        return replace(self, followed_from=tuple(theta_reference / self.nominal))

    def in_water(self, rises):
        steeper = 1 + 8 * (np.mean(self.followed_from) - 1)
        slope, curvature = steeper * self.water[0], steeper * self.water[1]
        levels = np.array(rises)[:, None]
        modes = self.modal(np.tile(self.followed_from, (len(rises), 1)) * self.nominal)
        return replace(
            modes, frequencies=modes.frequencies * np.exp(slope * levels + curvature * levels**2)
        )


@dataclass(frozen=True)
class BentTower(LinearTower):
    """Its modes follow the water on a cubic."""

    def _in_level(self, levels):
        return np.exp(-0.009 * levels - 0.001 * levels**2 + 2e-4 * levels**3)


def matcher(tower=TOWER, **likelihood):
    return Matcher(
        tower,
        Prior(tower.nominal),
        pairing=PairingSettings(search_draws=60, tried=2, refined=1),
        likelihood=LikelihoodSettings(**likelihood),
        generator=np.random.default_rng(1),
    )


def exact(tower):
    settings = UpdatingSettings(pairing=PairingSettings(search_draws=60, tried=2, refined=1))
    return ExactInference(tower, Prior(tower.nominal), settings, seed=1, population=None)


def evidence_of(n_windows):
    evidence = ModalEvidence(channels=LAYOUT.channel_names)
    generator = np.random.default_rng(2)
    for window in range(n_windows):
        estimate = drawn_estimate(TRUTH, generator, window=window, tower=TOWER)
        evidence = evidence.with_estimate(estimate)
    return evidence


def test_only_the_named_modes_are_compared_though_all_are_paired():
    match = matcher(modes=("2", "5")).matched(evidence_of(2))
    assert match.pairing.model_modes == (0, 1, 2, 3, 4, 5)
    assert match.forward.labels == ("2", "5")
    assert [each.identified for each in match.used] == [1, 4]


def test_a_mode_that_the_model_does_not_have_is_refused_by_its_name():
    with pytest.raises(UpdatingError, match=r"'12'.*1, 2, 3"):
        matcher(modes=("2", "12"))


def test_a_last_window_without_any_partner_is_refused_whatever_the_earlier_ones_said():
    evidence = evidence_of(2)
    gone = [replace(mode, last_window=1) for mode in evidence.modes]
    with pytest.raises(EstimateRefused, match="none of the 0 identified modes"):
        matcher().matched(replace(evidence, modes=tuple(gone)))


def test_what_is_compared_is_decided_at_the_peak_wherever_the_search_ended(monkeypatch):
    """A neighbour is nearer than shapes may be at one end of the search, not at the peak: draws
    of the search must not decide whether a shape counts."""
    matching, evidence = matcher(), evidence_of(2)
    peak = matching.matched(evidence).peak.ratios
    far = np.array([0.8, 0.7, 0.7])
    there, at_peak = (_gaps(TOWER.modal((ratios * TOWER.nominal)[None])) for ratios in (far, peak))
    moved = int(np.argmax(np.abs(there - at_peak)))
    monkeypatch.setattr(LikelihoodSettings, "shape_mixing", (there[moved] + at_peak[moved]) / 2)
    monkeypatch.setattr(LikelihoodSettings, "mixing_mac", 0.0)
    found = matching._search.best(matching._targets(evidence), np.ones(3))
    used = [
        matching._match(evidence, replace(found, ratios=start)).used[moved].shape_used
        for start in (far, peak)
    ]
    assert used[0] == used[1] == (at_peak[moved] > there[moved])


def _gaps(modes):
    """Relative distance of every mode to its nearest neighbour."""
    frequencies = modes.frequencies[0]
    gaps = np.abs(frequencies[:, None] / frequencies - 1) + 9 * np.eye(len(frequencies))
    return gaps.min(axis=0)


def test_the_water_is_taken_out_at_the_stiffness_that_is_found_without_it():
    """Two windows at a level of 1.5 m, springs 10 % stiffer, frequencies that the water lowers by
    2 %: one part in thirty of it stays at most. At the stiffness of wet windows a fifth would."""
    tower = SteepTower()
    truth = np.full(3, 1.1)
    wet = tower.following(truth * tower.nominal).in_water([1.5]).frequencies[0]
    dry = tower.modal((truth * tower.nominal)[None]).frequencies[0]
    evidence = ModalEvidence(channels=LAYOUT.channel_names)
    for window in range(2):
        generator = np.random.default_rng(3)
        estimate = drawn_estimate(
            truth, generator, window=window, tower=TOWER, frequency_std=1e-4, shape_std=1e-3
        )
        modes = [
            replace(mode, frequency=frequency)
            for mode, frequency in zip(estimate.modes, wet, strict=True)
        ]
        evidence = evidence.with_estimate(replace(estimate, modes=tuple(modes)), rise=1.5)
    match = matcher(tower).matched(evidence)
    assert [mode.frequency for mode in match.evidence.modes] == pytest.approx(dry, rel=0.02 / 30)
    assert match.peak.ratios == pytest.approx(truth, abs=0.005)


def test_water_is_taken_out_no_more_often_than_the_stiffness_moves():
    matching, evidence, rounds = matcher(), evidence_of(2), []
    pairing = matching._search.best(matching._targets(evidence), np.ones(3))
    refined = matching._search.refined

    def noted(*given):
        rounds.append(given)
        return refined(*given)

    matching._search.refined = noted
    matching._out_of_water(evidence, pairing, TOWER.following(pairing.ratios * TOWER.nominal))
    assert 1 <= len(rounds) <= 2


@pytest.mark.parametrize("mean", [3.0, -2.2])
def test_windows_in_far_water_are_compared_with_modes_in_it(mean):
    """A parabola about the description's level is off there by what the cubic makes of it."""
    tower = BentTower()
    evidence = ModalEvidence(channels=LAYOUT.channel_names)
    for window, level in enumerate(mean + np.array([-0.2, 0.0, 0.2])):
        estimate = drawn_estimate(
            TRUTH,
            np.random.default_rng(window),
            window=window,
            tower=tower.with_water_risen(level),
            frequency_std=1e-5,
            shape_std=1e-3,
        )
        evidence = evidence.with_estimate(estimate, rise=level)
    match = exact(tower).matched(UpdatingState(evidence))
    assert match.all_modes.water_level == pytest.approx(mean, abs=0.25)
    assert match.peak.ratios == pytest.approx(TRUTH, abs=5e-4)


@pytest.mark.parametrize(("level", "rise"), [(0.45, 0.0), (-0.5, 0.0), (0.8, 1.0), (-2.7, -2.5)])
def test_near_water_is_compared_at_the_models_level_and_far_water_in_half_metres(level, rise):
    evidence = ModalEvidence(channels=LAYOUT.channel_names)
    estimate = drawn_estimate(TRUTH, np.random.default_rng(1), tower=TOWER)
    assert rise_of_comparison(evidence.with_estimate(estimate, rise=level)) == rise


def test_sensitivities_to_the_water_are_those_at_the_models_level():
    tower = LinearTower(water=(-0.009, -0.001))
    estimate = drawn_estimate(TRUTH, np.random.default_rng(1), tower=tower.with_water_risen(3.0))
    inference = exact(tower)
    evidence = ModalEvidence(channels=LAYOUT.channel_names).with_estimate(estimate, rise=3.0)
    match = inference.matched(UpdatingState(evidence))
    found = inference._sensitivities(evidence, match, match.peak.ratios)
    assert len(found) == 6
    for each in found:
        np.testing.assert_allclose(each.water, [-0.009, -0.001], atol=1e-12)
