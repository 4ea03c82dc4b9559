"""FoundationUpdater: one more modal estimate, one more posterior of the foundation's springs."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    ModalEstimate,
    ModePair,
    ParameterSummary,
    WindowRejected,
)
from pipeline.updating.change import (
    ChangeDetector,
    ChangeSettings,
    ChangeState,
    with_tracks_only,
)
from pipeline.updating.checkpoint import (
    CheckpointOwner,
    decoded_checkpoint,
    encoded_checkpoint,
)
from pipeline.updating.density import StiffnessDensity
from pipeline.updating.events import (
    TrackSensitivity,
    event_of,
    sensitivity_rows,
    watched_window,
)
from pipeline.updating.evidence import EstimateRefused, ModalEvidence, Sighting, diagonal
from pipeline.updating.evidence import sightings as sightings_of
from pipeline.updating.forward_model import FloatArray, ForwardModel, ModesOfStiffness
from pipeline.updating.guards import Fit, GuardSettings, contradictions, reduced_chi_square
from pipeline.updating.honesty import (
    contraction,
    misfit_doubts,
    mode_information,
    predictive_misfits,
    unidentified_doubts,
)
from pipeline.updating.laplace import Peak, laplace_peak
from pipeline.updating.likelihood import (
    LikelihoodSettings,
    ModalLikelihood,
    Observation,
    observations,
)
from pipeline.updating.pairing import (
    DIFFERENCE,
    Pairing,
    PairingSearch,
    PairingSettings,
    PairingTargets,
    macs,
)
from pipeline.updating.prior import (
    PARAMETER_NAMES,
    PARAMETER_UNITS,
    Prior,
    PriorSettings,
    modal_where_supported,
)
from pipeline.updating.sampler import SamplerSettings
from pipeline.updating.samplers import SamplingSettings, sampler_of
from pipeline.updating.sampling import PosteriorDraws, Target
from sensors.layout import SensorLayout

RECENT_WINDOWS = 36  # that are kept one by one: six hours of ten minutes
CHECKED_DRAWS = 50  # of the posterior, for its predictions of each mode
MOST_DRAWS = 1000  # in a FoundationPosterior


@dataclass(frozen=True, slots=True)
class UpdatingSettings:
    """Section [updating] of a scenario."""

    prior: PriorSettings = field(default_factory=PriorSettings)
    pairing: PairingSettings = field(default_factory=PairingSettings)
    likelihood: LikelihoodSettings = field(default_factory=LikelihoodSettings)
    sampling: SamplingSettings = field(default_factory=SamplingSettings)
    sampler: SamplerSettings = field(default_factory=SamplerSettings)  # emcee's
    guards: GuardSettings = field(default_factory=GuardSettings)
    change: ChangeSettings = field(default_factory=ChangeSettings)


@dataclass(frozen=True, slots=True, eq=False)
class RecentWindow:
    """What one of the last windows saw, small enough to be kept."""

    start_ns: int
    duration: float  # [s]
    weight: float  # hop / window duration [-]
    sightings: tuple[Sighting, ...]


@dataclass(frozen=True, slots=True, eq=False)
class UpdatingState:
    """All that is remembered between windows; its size doesn't grow with their number."""

    evidence: ModalEvidence
    ensemble: FloatArray | None = None  # (n, 3) ratios drawn from the last posterior
    median: FloatArray | None = None  # (3,) ratios, of the last posterior
    change: ChangeState = field(default_factory=ChangeState)
    recent: tuple[RecentWindow, ...] = ()  # from which the evidence is begun anew after a change
    sensitivities: tuple[TrackSensitivity, ...] = ()  # of the last posterior's pairs


class FoundationUpdater:
    """Turns modal evidence into a posterior of k11, k22, k12 and σ.

    Every posterior starts from the prior with all the evidence. Yesterday's posterior is never
    today's prior; it only says where the sampler may start.
    """

    def __init__(
        self,
        forward: ForwardModel,
        layout: SensorLayout,
        settings: UpdatingSettings | None = None,
        *,
        seed: int = 0,
    ) -> None:
        """forward: the structure at this layout's sensors. seed: the scenario's; with the window's
        number it decides every random choice, wherever and in whatever order nodes run.

        Raises UpdatingError.
        """
        self.settings = settings or UpdatingSettings()
        self._forward = forward
        self._layout = layout
        self._seed = seed
        self._prior = Prior(forward.nominal, self.settings.prior)
        self._sampler = sampler_of(self.settings.sampling, self.settings.sampler)
        self._detector = ChangeDetector(self.settings.change)
        self._reach = float(np.max(forward.modal(self._prior.nominal[None]).frequencies))
        self._search = PairingSearch(
            forward, self._prior, self.settings.pairing, np.random.default_rng(seed)
        )

    def initial_state(self) -> UpdatingState:
        """Nothing seen yet."""
        return UpdatingState(self._no_evidence(), change=self._detector.initial_state())

    def _no_evidence(self) -> ModalEvidence:
        return ModalEvidence(
            channels=self._layout.channel_names,
            joint_covariance=self.settings.likelihood.joint_covariance,
        )

    def saved(self, state: UpdatingState) -> bytes:
        """The state as a small file's bytes."""
        return encoded_checkpoint(state, self._owner)

    def restored(self, checkpoint: bytes, *, origin: str = "checkpoint") -> UpdatingState:
        """The state that `saved` wrote: with it the next windows give the same posteriors, bit for
        bit, that they would have given without the interruption.

        origin   where the bytes came from, for the error

        Raises CheckpointError: no checkpoint, damaged, another version's or another turbine's.
        """
        return decoded_checkpoint(checkpoint, UpdatingState, self._owner, origin=origin)

    @property
    def _owner(self) -> CheckpointOwner:
        k11, k22, k12 = self._prior.nominal.tolist()
        return CheckpointOwner(self._layout.turbine, self._layout.channel_names, (k11, k22, k12))

    def updated(
        self, state: UpdatingState, estimate: ModalEstimate
    ) -> tuple[UpdatingState, FoundationPosterior | WindowRejected]:
        """State and posterior after one more window; `watched` also tells of changes."""
        state, (*_, answer) = self.watched(state, estimate)
        assert not isinstance(answer, FoundationEvent)  # the last one never is
        return state, answer

    def watched(
        self, state: UpdatingState, estimate: ModalEstimate
    ) -> tuple[UpdatingState, tuple[FoundationEvent | FoundationPosterior | WindowRejected, ...]]:
        """State after one more window; an event where the structure has changed, and the posterior.

        After an event the evidence begins anew with the first window after the change: before and
        after have no stiffness in common.

        An estimate that cannot be used leaves the state as it was, and the answer is a
        WindowRejected: the last good posterior stands.
        """
        try:
            seen = sightings_of(estimate, self._layout.channel_names)
            evidence = state.evidence.with_sightings(seen, estimate.weight, estimate.duration)
            after = replace(state, evidence=evidence, recent=_with_recent(state, estimate, seen))
            after, event = self._looked_for_change(after, estimate)
            after, posterior = self._refreshed(after, estimate)
        except EstimateRefused as refusal:
            return state, (_rejected(estimate, refusal),)
        return after, (posterior,) if event is None else (event, posterior)

    def _looked_for_change(
        self, state: UpdatingState, estimate: ModalEstimate
    ) -> tuple[UpdatingState, FoundationEvent | None]:
        """The detectors' sums with one more window, and what they say."""
        window = watched_window(state.evidence, estimate)
        change = with_tracks_only(state.change, [mode.track for mode in state.evidence.modes])
        change = self._detector.updated(
            change, window, sensitivity_rows(change.tracks, state.sensitivities)
        )
        rows = sensitivity_rows(change.tracks, state.sensitivities)
        verdict = self._detector.verdict(change, rows, window_duration=estimate.duration)
        if not verdict.alarm or state.median is None:
            return replace(state, change=change), None
        found = self._detector.change(change, verdict, rows)
        event = event_of(
            found, verdict, change, estimate, before=state.median, pairs=state.sensitivities
        )
        start = change.starts_ns[found.restart]
        return replace(
            state,
            change=self._detector.restarted(change, found.restart),
            evidence=self._evidence_since(state, start),
            recent=tuple(each for each in state.recent if each.start_ns >= start),
        ), event

    def _evidence_since(self, state: UpdatingState, start_ns: int) -> ModalEvidence:
        """The evidence of the recent windows alone that began at that time or later; their modes
        keep the tracks they had."""
        evidence = replace(self._no_evidence(), n_tracks=state.evidence.n_tracks)
        for window in state.recent:
            if window.start_ns >= start_ns:
                evidence = evidence.with_sightings(window.sightings, window.weight, window.duration)
        return evidence.with_tracks_of(state.evidence)

    def _refreshed(
        self, state: UpdatingState, estimate: ModalEstimate
    ) -> tuple[UpdatingState, FoundationPosterior]:
        generator = np.random.default_rng([self._seed, estimate.window])
        match = self._matched(state, estimate)
        density = StiffnessDensity(match.likelihood, match.forward, self._prior, generator)
        target = Target(
            log_density=density,
            prior_draws=density.prior_draws,
            log_prior_volume=density.log_prior_volume,
            peak=match.peak,
            ensemble=state.ensemble,
        )
        draws = self._sampler(target, generator)
        median = self._representative(draws)
        posterior = self._message(estimate, state.evidence, match, draws, median)
        # contiguous, as a checkpoint gives it back: BLAS may round by layout
        ensemble = np.ascontiguousarray(draws.ensemble)
        sensitivities = self._sensitivities(state.evidence, match, median)
        return (
            replace(state, ensemble=ensemble, median=median, sensitivities=sensitivities),
            posterior,
        )

    def _sensitivities(
        self, evidence: ModalEvidence, match: "_Match", median: FloatArray
    ) -> tuple[TrackSensitivity, ...]:
        """∂ ln f / ∂ ratio at the median of every paired mode's track."""
        points = median + DIFFERENCE * np.vstack([np.zeros(3), np.eye(3)])
        logs = np.log(match.all_modes.modal(self._prior.stiffness(points)).frequencies)
        slopes = (logs[1:] - logs[0]).T / DIFFERENCE  # (n_model, 3)
        found = {
            evidence.modes[each.identified].track: TrackSensitivity(
                track=evidence.modes[each.identified].track,
                model=match.all_modes.labels[each.model_modes[0]],
                slopes=slopes[list(each.model_modes)].mean(axis=0),
            )
            for each in match.used
        }
        return tuple(each for each in found.values() if np.all(np.isfinite(each.slopes)))

    def _matched(self, state: UpdatingState, estimate: ModalEstimate) -> "_Match":
        """Pairing, likelihood and its peak; the pairing is made once more at the peak."""
        evidence = state.evidence
        targets = PairingTargets.of(evidence.modes, evidence.n_windows, reach=self._reach)
        pairing = self._search.best(targets, state.median)
        match = self._match(evidence, pairing)
        again = self._search.refined(targets, match.peak.ratios)
        if again.model_modes != pairing.model_modes and again.total_cost <= pairing.total_cost:
            match = self._match(evidence, again)
        paired = {each.identified for each in match.used}
        if not any(evidence.modes[number].last_window == evidence.n_windows for number in paired):
            raise EstimateRefused(
                "no-paired-mode",
                f"none of the {len(estimate.modes)} identified modes is a mode of the model",
            )
        return match

    def _match(self, evidence: ModalEvidence, pairing: Pairing) -> "_Match":
        local = self._forward.following(self._prior.stiffness(pairing.ratios))
        frequencies = local.modal(self._prior.stiffness(pairing.ratios[None])).frequencies[0]
        used = observations(evidence, pairing, frequencies, self.settings.likelihood)
        if not used:
            raise EstimateRefused(
                "no-paired-mode",
                f"none of the {len(evidence.modes)} identified modes is a mode of the model",
            )
        columns = sorted({mode for each in used for mode in each.model_modes})
        forward = local.subset([local.labels[mode] for mode in columns])
        likelihood = ModalLikelihood(
            evidence,
            used,
            model_columns=columns,
            settings=self.settings.likelihood,
            highest_sigma=self.settings.prior.highest_sigma,
        )
        peak = laplace_peak(likelihood, forward, self._prior, pairing.ratios)
        return _Match(pairing, used, likelihood, local, forward, peak)

    def _representative(self, draws: PosteriorDraws) -> FloatArray:
        """(3,) the median of each ratio; where these three cannot stand together, the draw
        nearest to them."""
        flat = draws.flat[:, :3]
        median = np.median(flat, axis=0)
        supported, modes = modal_where_supported(self._forward, self._prior, median[None])
        if supported[0] and modes is not None and modes.admissible[0]:
            return median
        distances = (((flat - median) / flat.std(axis=0)) ** 2).sum(axis=1)
        return flat[int(np.argmin(distances))]

    def _message(
        self,
        estimate: ModalEstimate,
        evidence: ModalEvidence,
        match: "_Match",
        draws: PosteriorDraws,
        median: FloatArray,
    ) -> FoundationPosterior:
        modes = match.all_modes.modal(self._prior.stiffness(median[None]))
        misfits = _misfits(match, self._prior.stiffness(median[None]))
        fit = Fit(
            reduced_chi_square=reduced_chi_square(misfits),
            paired_share=match.pairing.paired_share,
            pairing_cost=match.pairing.cost,
        )
        parameters = self._summaries(draws)
        pairs = _pairs(evidence, match, modes, _mode_check(match, self._prior, draws))
        against = contradictions(fit, self.settings.guards)
        return FoundationPosterior(
            turbine=estimate.turbine,
            window=estimate.window,
            time_ns=estimate.end_ns,
            n_windows=evidence.n_windows,
            parameters=parameters,
            correlation=np.asarray(np.corrcoef(draws.flat[:, :3].T)),
            draws=self._thinned(draws),
            pairs=pairs,
            model_labels=tuple(match.all_modes.labels),
            model_frequencies=modes.frequencies[0],
            model_shapes=_largest_component_one(modes.shapes[0]),
            sampler=draws.sampler,
            ess=draws.ess,
            rhat=draws.rhat,
            autocorrelation_time=draws.autocorrelation_time,
            reduced_chi_square=fit.reduced_chi_square,
            paired_share=fit.paired_share,
            pairing_cost=fit.pairing_cost,
            trusted=not against,
            warnings=(
                *against,
                *draws.doubts,
                *misfit_doubts(pairs, self.settings.guards),
                *unidentified_doubts(parameters, self.settings.guards),
            ),
        )

    def _summaries(self, draws: PosteriorDraws) -> tuple[ParameterSummary, ...]:
        """Quantiles of every draw, k in its own unit."""
        values = draws.flat * np.append(self._prior.nominal, 1.0)
        bounds = self.settings.prior
        extents = [bounds.highest_ratio - bounds.lowest_ratio] * 3 + [bounds.highest_sigma]
        quantiles = np.sort(np.quantile(values, [0.05, 0.5, 0.95], axis=0), axis=0)
        return tuple(
            ParameterSummary(
                name=name,
                unit=unit,
                nominal=float(nominal),
                median=float(median),
                p05=float(low),
                p95=float(high),
                contraction=contraction((high - low) / abs(nominal), extent),
            )
            for name, unit, nominal, extent, (low, median, high) in zip(
                (*PARAMETER_NAMES, "sigma"),
                (*PARAMETER_UNITS, "-"),
                (*self._prior.nominal, 1.0),
                extents,
                quantiles.T,
                strict=True,
            )
        )

    def _thinned(self, draws: PosteriorDraws) -> FloatArray:
        """(n <= 1000, 4) draws spread evenly over all, k in their units."""
        flat = draws.flat
        chosen = np.linspace(0, len(flat) - 1, min(MOST_DRAWS, len(flat))).round().astype(int)
        return flat[chosen] * np.append(self._prior.nominal, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class _Match:
    """Evidence tied to the model: what is compared with what, and how well it can fit."""

    pairing: Pairing
    used: tuple[Observation, ...]
    likelihood: ModalLikelihood
    all_modes: ForwardModel  # every visible mode, followed from the pairing's stiffness
    forward: ForwardModel  # only those that the likelihood asks for
    peak: Peak


def _misfits(match: _Match, theta: FloatArray) -> FloatArray:
    """(n_observations,) model minus identified frequency at theta, (1, 3), in standard deviations
    at σ = 0; floor and neighbours' gaps included."""
    rows = match.likelihood.frequency_components
    errors = match.likelihood.errors(match.forward.modal(theta))[0, rows]
    return np.asarray(errors / np.sqrt(np.diag(match.likelihood.measurement_covariance)[rows]))


def _pairs(
    evidence: ModalEvidence, match: _Match, modes: ModesOfStiffness, check: "_ModeCheck"
) -> tuple[ModePair, ...]:
    mac = macs(PairingTargets.of(evidence.modes, evidence.n_windows), modes.shapes)[0]
    return tuple(
        ModePair(
            identified=evidence.modes[each.identified].name,
            model=match.all_modes.labels[each.model_modes[0]],
            frequency=evidence.modes[each.identified].frequency,
            frequency_std=evidence.modes[each.identified].frequency_std,
            model_frequency=float(modes.frequencies[0, each.model_modes[0]]),
            mac=float(mac[each.identified, each.model_modes[0]]),
            shape_used=each.shape_used,
            misfit=float(check.misfits[number]),
            information=float(check.information[number]),
        )
        for number, each in enumerate(match.used)
    )


@dataclass(frozen=True, slots=True, eq=False)
class _ModeCheck:
    """What each observation contributes, and how badly it fits."""

    misfits: FloatArray  # (n_observations,) posterior predictive [standard deviations]
    information: FloatArray  # (n_observations,) share


def _mode_check(match: _Match, prior: Prior, draws: PosteriorDraws) -> _ModeCheck:
    flat = draws.flat[np.linspace(0, len(draws.flat) - 1, CHECKED_DRAWS).round().astype(int)]
    rows = match.likelihood.frequency_components
    modes = match.forward.modal(prior.stiffness(flat[:, :3]))
    variances = np.diag(match.likelihood.measurement_covariance)[rows]
    misfits = predictive_misfits(
        match.likelihood.errors(modes)[:, rows],
        variances,
        np.outer(flat[:, 3] ** 2, match.likelihood.reference[rows]),
    )
    points = match.peak.ratios + DIFFERENCE * np.vstack([np.zeros(3), np.eye(3)])
    errors = match.likelihood.errors(match.forward.modal(prior.stiffness(points)))
    everything = np.diag(match.likelihood.measurement_covariance)
    everything = everything + np.median(flat[:, 3]) ** 2 * match.likelihood.reference
    information = mode_information(
        (errors[1:] - errors[0]).T / DIFFERENCE,
        1 / everything,
        (np.searchsorted(rows, np.arange(errors.shape[1]), side="right") - 1).tolist(),
    )
    return _ModeCheck(misfits, information)


def _largest_component_one(shapes: FloatArray) -> FloatArray:
    """(n_model, n_channels) with each shape's largest component 1."""
    largest = np.argmax(np.abs(shapes), axis=1)[:, None]
    return shapes / np.take_along_axis(shapes, largest, axis=1)


def _with_recent(
    state: UpdatingState, estimate: ModalEstimate, seen: Sequence[Sighting]
) -> tuple[RecentWindow, ...]:
    """The last windows one by one. Where correlations aren't used, variances are all that is
    kept of a covariance."""
    if not state.evidence.joint_covariance:
        seen = [diagonal(sighting) for sighting in seen]
    latest = RecentWindow(estimate.start_ns, estimate.duration, estimate.weight, tuple(seen))
    return (*state.recent, latest)[-RECENT_WINDOWS:]


def _rejected(estimate: ModalEstimate, refusal: EstimateRefused) -> WindowRejected:
    return WindowRejected(
        turbine=estimate.turbine,
        window=estimate.window,
        start_ns=estimate.start_ns,
        end_ns=estimate.end_ns,
        code=refusal.code,
        reason=refusal.reason,
    )
