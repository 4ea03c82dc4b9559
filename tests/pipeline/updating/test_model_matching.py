"""Which modes are compared is the pairing's affair, and the scenario's where it names them."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.evidence.observations import EstimateRefused
from pipeline.updating.likelihood.likelihood import LikelihoodSettings
from pipeline.updating.likelihood.pairing import PairingSettings
from pipeline.updating.model_matching import FAR_RISE, Matcher, partners_in_water
from pipeline.updating.prior import Prior, UpdatingError
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

    def in_water(self, rises):
        levels = np.array(rises)[:, None]
        modes = self.modal(np.tile(self.nominal, (len(rises), 1)))
        bent = np.exp(-0.009 * levels - 0.001 * levels**2 + 3e-5 * levels**3)
        return replace(
            modes,
            frequencies=modes.frequencies * bent,
            shapes=modes.shapes * (1 + 0.01 * levels[..., None] ** 3),
        )


def matcher(tower=TOWER, **likelihood):
    return Matcher(
        tower,
        Prior(tower.nominal),
        pairing=PairingSettings(search_draws=60, tried=2, refined=1),
        likelihood=LikelihoodSettings(**likelihood),
        generator=np.random.default_rng(1),
    )


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


@pytest.mark.parametrize("mean", [3.0, -2.0, 0.6])
def test_modes_follow_the_water_exactly_where_the_windows_water_stood(mean):
    """A parabola through a metre to either side of the model's level is off there by what the
    cubic makes of it."""
    true = -0.009 * mean - 0.001 * mean**2 + 3e-5 * mean**3
    for mode, partner in enumerate(partners_in_water(BentTower(), mean)):
        slope, curvature = partner.curve
        assert slope * mean + curvature * mean**2 == pytest.approx(true, abs=1e-12)
        scale = 1 + 0.01 * mean**3
        still = partner.shapes[1]
        v1, v2 = (partner.shapes[2] - partner.shapes[0]) / 2, partner.shapes.sum(axis=0) / 2
        v2 = v2 - 1.5 * still
        np.testing.assert_allclose(still + v1 * mean + v2 * mean**2, scale * still, atol=1e-12)
        assert partner.log_frequencies[1] == pytest.approx(
            np.log(TOWER.modal(TOWER.nominal[None]).frequencies[0, mode])
        )


def test_near_water_leaves_modes_on_the_parabola_about_the_models_level():
    near, still = (partners_in_water(BentTower(), mean) for mean in (FAR_RISE, 0.0))
    for one, other in zip(near, still, strict=True):
        np.testing.assert_array_equal(one.log_frequencies, other.log_frequencies)
        assert one.curve[0] == pytest.approx(-0.009 + 3e-5, abs=1e-12)
