"""FoundationUpdater: one more modal estimate, one more posterior of the foundation's springs."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    ModalEstimate,
    RelativeStiffness,
    WindowRejected,
    rejected_estimate,
)
from pipeline.updating.acceptance import refusal
from pipeline.updating.change.detector import ChangeDetector, ChangeState
from pipeline.updating.change.event_message import (
    TrackSensitivity,
    event_of,
    measured_half_way,
    sensitivities_of,
    watched_window,
)
from pipeline.updating.change.random_walk import deviation
from pipeline.updating.change.revised_size import BeforeEvent, relative_change, revised_step
from pipeline.updating.change.sufficient_statistics import Sensitivities, with_tracks_only
from pipeline.updating.checkpoint import CheckpointOwner, decoded_checkpoint, encoded_checkpoint
from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.evidence.observations import EstimateRefused, mode_observations
from pipeline.updating.exact_inference import ExactInference
from pipeline.updating.forward_model import ForwardModel
from pipeline.updating.model_matching import without_partner
from pipeline.updating.population import StiffnessPopulation
from pipeline.updating.posterior_message import posterior_message, relative_stiffness
from pipeline.updating.prior import Prior
from pipeline.updating.settings import UpdatingSettings
from pipeline.updating.state import UpdatingState
from pipeline.updating.structural.alternatives import JointInference
from pipeline.updating.structural.joint_message import UNLABELLED, joint_message, mode_labels
from pipeline.updating.structural.refresh import (
    JointRefresh,
    joint_refresh,
    model_at,
)
from pipeline.updating.structural.water_level import at_model_level
from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray

STATED_EXACT = "exact"  # structure, as a posterior names it
UNSTATED_EXACT = "exact, as recorded before there was a choice"


class FoundationUpdater:
    """Turns modal evidence into a posterior of k11, k22, k12 and σ.

    Every posterior starts from the prior with all the evidence. Yesterday's posterior is never
    today's prior; it only determines where the sampler may start.
    """

    def __init__(
        self,
        forward: ForwardModel,
        layout: SensorLayout,
        settings: UpdatingSettings | None = None,
        *,
        seed: int = 0,
        population: StiffnessPopulation | None = None,
        joint: JointInference | None = None,
    ) -> None:
        """Prepare the updating of one turbine.

        Parameters
        ----------
        forward : ForwardModel
            The structure at this layout's sensors.
        layout : SensorLayout
            Where the sensors are.
        settings : UpdatingSettings, optional
            The defaults where left out.
        seed : int, optional
            The scenario's; with the window's number it decides every random choice, wherever and in
            whatever order nodes run.
        population : StiffnessPopulation, optional
            What a farm's other turbines imply of this one's springs; None: uniform prior.
        joint : JointInference, optional
            Infers the structure's figures with the springs (`joint_inference`, which knows the
            population too); None: the structure is exact.

        Raises
        ------
        UpdatingError
            If the settings name a mode that these sensors do not see, or the population is of
            foundations about another nominal one.
        """
        if population is not None:
            population.require_nominal(forward.nominal)
        self._population = population
        self.settings = settings or UpdatingSettings()
        self._forward = forward
        self._layout = layout
        self._seed = seed
        self._prior = Prior(forward.nominal, self.settings.prior)
        self._inference = joint or ExactInference(
            forward, self._prior, self.settings, seed=seed, population=population
        )
        self._detector = ChangeDetector(self.settings.change)

    def initial_state(self) -> UpdatingState:
        """Nothing seen yet."""
        return UpdatingState(self._no_evidence())

    def _no_evidence(self) -> ModalEvidence:
        return ModalEvidence(
            channels=self._layout.channel_names,
            joint_covariance=self.settings.likelihood.joint_covariance,
        )

    def saved(self, state: UpdatingState) -> bytes:
        """The state as a small file's bytes."""
        return encoded_checkpoint(state, self._owner)

    def restored(self, checkpoint: bytes, *, origin: str = "checkpoint") -> UpdatingState:
        """The state that `saved` wrote.

        Parameters
        ----------
        checkpoint : bytes
            As `saved` returned it.
        origin : str, optional
            Where the bytes came from, for the error.

        Raises
        ------
        CheckpointError
            If it is no checkpoint, damaged, another version's or another turbine's.

        Notes
        -----
        With it the next windows give the same posteriors, bit for bit, that they would have given
        without the interruption.
        """
        return decoded_checkpoint(checkpoint, UpdatingState, self._owner, origin=origin)

    @property
    def _owner(self) -> CheckpointOwner:
        k11, k22, k12 = self._prior.nominal.tolist()
        return CheckpointOwner(self._layout.turbine, self._layout.channel_names, (k11, k22, k12))

    def updated(
        self, state: UpdatingState, estimate: ModalEstimate
    ) -> tuple[UpdatingState, FoundationPosterior | WindowRejected]:
        """State and posterior after one more window; `watched` also reports changes."""
        state, (*_, answer) = self.watched(state, estimate)
        assert not isinstance(answer, FoundationEvent)  # the last one never is
        return state, answer

    def watched(
        self, state: UpdatingState, estimate: ModalEstimate
    ) -> tuple[UpdatingState, tuple[FoundationEvent | FoundationPosterior | WindowRejected, ...]]:
        """State after one more window; an event where the structure has changed, and the posterior.

        Parameters
        ----------
        state : UpdatingState
            After the window before.
        estimate : ModalEstimate
            Of the window.

        Returns
        -------
        state : UpdatingState
            As it was for an estimate that cannot be used.
        messages : tuple of FoundationEvent, FoundationPosterior and WindowRejected
            The posterior is that of the stiffness in this window.

        Notes
        -----
        After an event the evidence starts again with the first window after the change: before and
        after have no stiffness in common.

        An estimate that cannot be used leaves the state as it was, and the answer is a
        WindowRejected: the last good posterior stands. It stands too where the guards refuse the
        new one, but the window's evidence is remembered: later ones may make sense of it.
        """
        try:
            after, event = self._accumulated(state, estimate)
            after, posterior = self._refreshed(after, estimate)
        except EstimateRefused as refused:
            return state, (rejected_estimate(estimate, refused.code, refused.reason),)
        return after, (posterior,) if event is None else (event, posterior)

    def accumulated(
        self, state: UpdatingState, estimate: ModalEstimate
    ) -> tuple[UpdatingState, FoundationEvent | WindowRejected | None]:
        """What `watched` does before its posterior: the window's sums alone, without a posterior.

        Parameters
        ----------
        state : UpdatingState
            After the window before.
        estimate : ModalEstimate
            Of the window.

        Returns
        -------
        state : UpdatingState
            As it was for an estimate that cannot be used.
        message : FoundationEvent, WindowRejected or None
            None where nothing has changed.

        Notes
        -----
        The springs' influence on the frequencies, by which changes are detected, stays that of the
        last posterior in the state.
        """
        try:
            return self._accumulated(state, estimate)
        except EstimateRefused as refused:
            return state, rejected_estimate(estimate, refused.code, refused.reason)

    def refreshed(
        self, state: UpdatingState, estimate: ModalEstimate
    ) -> tuple[UpdatingState, FoundationPosterior | WindowRejected]:
        """The posterior of a state that the estimate's window has entered by `accumulated`.

        The last posterior in the state only determines where the sampler starts.
        """
        try:
            return self._refreshed(state, estimate)
        except EstimateRefused as refused:
            return state, rejected_estimate(estimate, refused.code, refused.reason)

    def _accumulated(
        self, state: UpdatingState, estimate: ModalEstimate
    ) -> tuple[UpdatingState, FoundationEvent | None]:
        seen = mode_observations(estimate, self._layout.channel_names)
        after = state.with_window(estimate, seen, self._rise(estimate))
        change = self._watched(after, estimate)
        if self._unknown_tide_std > 0 and np.isnan(estimate.water_level):
            # every window has a level of its own: the evidence is that of the first windows' water
            after = state.with_window(estimate, seen, change.last_level.level)
        return self._looked_for_change(replace(after, change=change), estimate)

    def _watched(self, state: UpdatingState, estimate: ModalEstimate) -> ChangeState:
        """The detectors' sums with the window that entered the evidence last."""
        unknown = self._unknown_tide_std
        window = watched_window(state.evidence, estimate, self._rise(estimate), unknown)
        remembered = [mode.track for mode in state.evidence.modes]
        change = replace(state.change, sums=with_tracks_only(state.change.sums, remembered))
        return self._detector.updated(change, window, self._sensitivities(change, state))

    def _looked_for_change(
        self, state: UpdatingState, estimate: ModalEstimate
    ) -> tuple[UpdatingState, FoundationEvent | None]:
        """The state that begins again where the structure has changed, and the event."""
        change, known = state.change, self._sensitivities(state.change, state)
        verdict = self._detector.verdict(change, known, window_duration=estimate.duration)
        if not verdict.alarm or state.median is None:
            return state, None
        found = self._detector.change(change, verdict, known)
        found = measured_half_way(
            found,
            change,
            self._detector,
            self._model_before(state, state.median),
            self._prior,
            before=state.median,
            pairs=state.sensitivities,
        )
        event = event_of(
            found, verdict, change, estimate, before=state.median, pairs=state.sensitivities
        )
        restarted = state.restarted(change.sums.starts_ns[found.restart], self._no_evidence())
        if restarted.reference is not None:
            level = self._without_levels(restarted.reference, state)
            restarted = replace(restarted, reference=level)
        earlier = BeforeEvent.of(change.sums, found.candidate, state.sensitivities, state.median)
        after = self._detector.restarted(change, found.restart)
        return replace(restarted, change=after, before_event=earlier), event

    def _without_levels(self, before: ModalEvidence, state: UpdatingState) -> ModalEvidence:
        """The windows before an event at the model's water level, by the modes as they were then.

        Beside the springs after the event a mode that has moved far has no partner. It would keep
        its level while the others lose theirs, and contradict them.
        """
        if isinstance(self._inference, ExactInference) or state.sensor_fault:
            return before
        latest = state.joint[0]
        level = at_model_level(before, self._inference.fit_of(latest.name), latest.u)
        modes = [
            there
            if there is mode
            else replace(there, level_information=np.zeros_like(there.level_information))
            for mode, there in zip(before.modes, level.modes, strict=True)
        ]
        return replace(level, modes=tuple(modes))

    def _sensitivities(self, change: ChangeState, state: UpdatingState) -> Sensitivities:
        """Of the tracks in the sums, by the state's last posterior."""
        known = sensitivities_of(change.sums.tracks, state.sensitivities)
        return replace(known, rough=state.is_rough, level_std=self._level_std(state))

    def _level_std(self, state: UpdatingState) -> float:
        """Of levels that follow from the modes [m]; 0 where all are reported."""
        return state.evidence.unknown_level_share * self._unknown_tide_std

    @property
    def _unknown_tide_std(self) -> float:
        """Of a water level that nothing reports, from window to window [m]; 0 where the structure
        is exact."""
        if isinstance(self._inference, ExactInference):
            return 0.0
        return self._inference.prior.tide_std

    def _model_before(self, state: UpdatingState, median: FloatArray) -> ForwardModel:
        """The structure that the last posterior found, its modes followed from there."""
        if isinstance(self._inference, ExactInference) or not state.joint:
            return self._forward.following(self._prior.stiffness(median))
        latest = state.joint[0]
        return model_at(self._inference.fit_of(latest.name), latest.u, self._layout)

    def _refreshed(
        self, state: UpdatingState, estimate: ModalEstimate
    ) -> tuple[UpdatingState, FoundationPosterior | WindowRejected]:
        if isinstance(self._inference, ExactInference):
            return self._refreshed_exactly(self._inference, state, estimate)
        return self._refreshed_jointly(self._inference, state, estimate)

    def _refreshed_exactly(
        self, exact: ExactInference, state: UpdatingState, estimate: ModalEstimate
    ) -> tuple[UpdatingState, FoundationPosterior | WindowRejected]:
        """The springs alone."""
        match = exact.matched(state)
        against = refusal(match.pairing.paired_share, match.pairing.cost, self.settings.guards)
        if against is not None:
            return state, rejected_estimate(estimate, against.code, against.text)
        found = exact.refreshed(match, state, estimate.window)
        posterior = posterior_message(
            estimate,
            match,
            found.draws,
            found.representative,
            now=self._in_this_window(found.draws.flat[:, [0, 1, 2, -1]], state.change, estimate),
            prior=self._prior,
            guards=self.settings.guards,
        )
        after = replace(
            state,
            # contiguous, as a checkpoint gives it back: BLAS may round by layout
            ensemble=np.ascontiguousarray(found.draws.ensemble),
            median=found.representative[:3],
            sensitivities=found.sensitivities,
        )
        return after, replace(
            posterior,
            structure=STATED_EXACT if self.settings.structure.stated else UNSTATED_EXACT,
            population=self._population_name,
            change_probability=self._change_probability(state, estimate.duration),
            relative=_relative_to_earlier(after, self._level_std(after)),
        )

    def _refreshed_jointly(
        self, joint: JointInference, state: UpdatingState, estimate: ModalEstimate
    ) -> tuple[UpdatingState, FoundationPosterior | WindowRejected]:
        """Springs and figures together, from where the last window left them."""
        found = joint_refresh(
            joint,
            state.evidence,
            state.joint,
            np.random.default_rng([self._seed, estimate.window]),
            guards=self.settings.guards,
            reference=state.reference,
            last_fault=state.sensor_fault,
            searched_windows=state.searched_windows,
        )
        if found is None:
            raise without_partner(len(state.evidence.modes))
        if found.refusal is not None:
            return state, rejected_estimate(estimate, found.refusal.code, found.refusal.text)
        fit, u = found.best.fit, found.best.peak.u
        model = model_at(fit, u, self._layout)
        posterior = joint_message(
            estimate,
            found,
            model,
            now=self._in_this_window(found.draws, state.change, estimate),
            prior=self._prior,
            guards=self.settings.guards,
            reference_ns=state.reference_ns,
        )
        after = replace(
            state,
            median=fit.coordinates.springs(u) / fit.coordinates.nominal,
            sensitivities=_joint_sensitivities(found, mode_labels(found, model)),
            joint=found.warm_starts,
            sensor_fault="" if found.fault is None else found.fault.name,
            searched_windows=found.searched_windows,
        )
        change = self._change_probability(after, estimate.duration)
        return after, replace(
            posterior, population=self._population_name, change_probability=change
        )

    @property
    def _population_name(self) -> str:
        return "" if self._population is None else self._population.name

    def _change_probability(self, state: UpdatingState, duration: float) -> float:
        """That the modes have changed since the last event, by windows of that duration [s]."""
        known = self._sensitivities(state.change, state)
        verdict = self._detector.verdict(state.change, known, window_duration=duration)
        return float(verdict.probability)

    def _in_this_window(
        self, common: FloatArray, change: ChangeState, estimate: ModalEstimate
    ) -> FloatArray:
        """(n_draws, 4) draws of the stiffness in the estimate's window and of σ.

        The windows together speak of their mean stiffness; to it comes what this window's differs
        from it by. A draw that the prior does not allow then stays as it was.
        """
        generator = np.random.default_rng([self._seed, estimate.window, 1])
        now = common.copy()
        now[:, :3] += deviation(change.walk).draws(len(now), generator)
        return np.where(self._prior.supports(now[:, :3])[:, None], now, common)

    def _rise(self, estimate: ModalEstimate) -> float:
        """Of the water above the model's in the window [m]; 0 where the level is not known."""
        return float(np.nan_to_num(estimate.water_level - self._forward.water_level))


def _joint_sensitivities(
    found: JointRefresh, labels: Sequence[str]
) -> tuple[TrackSensitivity, ...]:
    """How every paired mode's track depends on springs and water, at the joint peak."""
    fit, peak = found.best.fit, found.best.peak
    modes = peak.comparison.linearisation
    by_theta = np.linalg.inv(fit.coordinates.slopes(peak.u)[:3, :3])
    slopes = modes.log_frequency_slopes[:, :3] @ by_theta * fit.coordinates.nominal
    moved = found.evidence.level_varied or found.evidence.n_unknown_levels > 0
    water = [each.curve for each in fit.partners_in_water(peak.u, modes)] if moved else None
    known = [each for each in peak.comparison.used if labels[each.model_modes[0]] != UNLABELLED]
    chosen = found.evidence.one_a_track(each.identified for each in known)
    return tuple(
        TrackSensitivity(
            track=found.evidence.modes[each.identified].track,
            model=labels[each.model_modes[0]],
            slopes=slopes[list(each.model_modes)].mean(axis=0),
            water=np.zeros(2) if water is None else water[each.model_modes[0]],
        )
        for each in known
        if each.identified in chosen
    )


def _relative_to_earlier(state: UpdatingState, level_std: float) -> tuple[RelativeStiffness, ...]:
    """Springs over those before the last event, by all windows since.

    level_std   of levels that follow from the modes [m]
    """
    earlier = state.before_event
    if earlier is None:
        return ()
    step = revised_step(
        earlier,
        state.change.sums,
        state.sensitivities,
        rough=state.is_rough,
        level_std=level_std,
    )
    if step is None:
        return ()
    return relative_stiffness(*relative_change(earlier, step), earlier.end_ns)
