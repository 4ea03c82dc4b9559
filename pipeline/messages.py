"""The messages between nodes. Small frozen types; every field has its unit.

Times are those of the sensor clock, in nanoseconds since 1970-01-01 UTC, unless a field states
otherwise. `streams.py` defines on which key each type travels; `transport/codec.py` how it is
written.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.scada import ScadaSample
from sensors.arrays import FloatArray

HALF_INTERVAL = 1.6449  # of the normal distribution's central 90 %, in standard deviations
UNCERTAIN_STRUCTURE = "uncertain"  # structure of a posterior whose figures are inferred as well


@dataclass(frozen=True, slots=True)
class QualityWarning:
    """A reservation about a result that is still given; codes are stable, texts are for people."""

    code: str
    """Stable name, such as "non-stationary", "clipped" or "harmonic"."""
    text: str
    """One sentence with the quantity, its unit and what it means."""


@dataclass(frozen=True, slots=True, eq=False)
class Mode:
    """One identified mode of the tower, complex-normalised (Eq. 11: largest component = 1).

    `covariance_factor` F, (2 + n_channels, n_columns), has the rows frequency [Hz], damping ratio
    [-], then the shape's components [-]; F Fᵀ is their joint covariance. Its first
    `n_block_columns` columns belong to the time blocks of the window, the same for every mode of
    the estimate, so that products across modes give the covariance between modes; the further
    columns are the mode's own (the spread over model orders).
    """

    name: str
    """Name that stays with the mode from window to window; "" while untracked."""
    frequency: float
    """Undamped natural frequency f [Hz]."""
    frequency_std: float
    """Standard deviation of the frequency [Hz]."""
    damping_ratio: float
    """Damping ratio ζ, share of critical [-]."""
    damping_ratio_std: float
    """Standard deviation of the damping ratio [-]."""
    shape: FloatArray
    """Shape φ in the channel order of the estimate, (n_channels,) [-]."""
    covariance_factor: FloatArray
    """Factor F of the covariance F Fᵀ of (f, ζ, φ), (2 + n_channels, n_columns)."""
    n_block_columns: int
    """Columns of F common to all modes of the estimate."""
    phase_collinearity: float = 1.0
    """MPC of the complex shape, 1 = all channels in phase [-]."""
    presence: float = 1.0
    """Share of the model orders in which the mode was stable [-]."""
    quality: float = 1.0
    """From 0 (doubtful) to 1 (sure) [-]."""
    pair_id: str = ""
    """Two modes that cannot be separated share one id; else ""."""

    @property
    def half_bandwidth(self) -> float:
        """ζ f [Hz]"""
        return self.damping_ratio * self.frequency

    @property
    def unit_component(self) -> int:
        """Index of the shape's component that the normalisation sets to 1."""
        return int(np.argmax(np.abs(self.shape)))

    @property
    def covariance(self) -> FloatArray:
        """(2 + n_channels, 2 + n_channels), joint covariance of f [Hz], ζ [-], φ [-]."""
        return self.covariance_factor @ self.covariance_factor.T

    @property
    def shape_std(self) -> FloatArray:
        """(n_channels,) [-]; zero for the unit component."""
        return np.linalg.norm(self.covariance_factor[2:], axis=1)

    def refused(self, code: str, text: str) -> "RefusedMode":
        """Return the mode as one that is not reported, and why."""
        return RefusedMode(self.frequency, self.damping_ratio, code, text)

    def with_factor(self, factor: FloatArray) -> "Mode":
        """Return the mode with that covariance factor and the stds of f and ζ that follow."""
        frequency_std, damping_std = np.linalg.norm(factor[:2], axis=1)
        return replace(
            self,
            covariance_factor=factor,
            frequency_std=float(frequency_std),
            damping_ratio_std=float(damping_std),
        )

    def with_frequency_spread(self, spread: float) -> "Mode":
        """Return the mode with one more column of its factor: a spread of its frequency [Hz]."""
        column = np.zeros((len(self.covariance_factor), 1))
        column[0] = spread
        return replace(
            self,
            covariance_factor=np.hstack([self.covariance_factor, column]),
            frequency_std=float(np.hypot(self.frequency_std, spread)),
        )


@dataclass(frozen=True, slots=True)
class UnitOrigin:
    """Where a window begins in one acquisition unit's own count of samples: no clock can move it.

    A window's identity is its turbine and the origins of its units.
    """

    unit: str
    """Acquisition unit id."""
    session: str
    """Session of the unit's blocks."""
    boot: int
    """Starts of the unit under that session's name before this one."""
    first_sample: int
    """First sample of the window since the start of the unit."""


@dataclass(frozen=True, slots=True, eq=False)
class ModalEstimate:
    """The modes identified in one window, lowest frequency first."""

    turbine: str
    window: int
    """Windows since the session's start, rejected ones counted, from 0."""
    start_ns: int
    end_ns: int
    layout_id: str
    channels: tuple[str, ...]
    """Names of the channels that the shapes' components belong to."""
    modes: tuple[Mode, ...]
    weight: float = 1.0
    """Hop over window length: how much of the window is new [-]."""
    warnings: tuple[QualityWarning, ...] = ()
    operating_state: str = ""
    """State of the whole window by SCADA, see ScadaSample; "" unknown."""
    wind_speed: float = float("nan")
    """Mean wind speed by SCADA [m/s]; NaN: not known."""
    rotor_speed: float = float("nan")
    """Mean speed of the rotor [rpm]; NaN: not known."""
    yaw: float = float("nan")
    """Mean direction of the nacelle, from the tower's x axis towards y [deg]; NaN: not known."""
    water_level: float = float("nan")
    """Mean level above the mean water level [m]; NaN: not known."""
    origins: tuple[UnitOrigin, ...] = ()
    """Identity of the window; none in older recordings."""

    @property
    def duration(self) -> float:
        """[s]"""
        return (self.end_ns - self.start_ns) / NANOSECONDS


@dataclass(frozen=True, slots=True)
class RefusedMode:
    """What looked like a mode in a window and is not reported."""

    frequency: float
    """Frequency f [Hz]."""
    damping_ratio: float
    """Damping ratio ζ [-]."""
    code: str
    """Stable name of the reason."""
    text: str
    """One sentence with the figure that decided."""


@dataclass(frozen=True, slots=True, eq=False)
class StabilisationDiagram:
    """Poles of an identified window that came back over the model orders; for people to look at.

    Where such a pole stands at the same frequency in most orders, there is a mode.
    """

    turbine: str
    window: int
    """Number of the window, that of its ModalEstimate."""
    start_ns: int
    end_ns: int
    orders: NDArray[np.float32]
    """Model order of each pole, (n_poles,) [-]."""
    bands: NDArray[np.float32]
    """Frequency band in which each pole was identified, slowest 0, (n_poles,) [-]."""
    frequencies: NDArray[np.float32]
    """Frequency of each pole, (n_poles,) [Hz]."""
    frequency_stds: NDArray[np.float32]
    """Standard deviation of each frequency, (n_poles,) [Hz]."""
    damping_ratios: NDArray[np.float32]
    """Damping ratio of each pole, (n_poles,) [-]."""
    refused: tuple[RefusedMode, ...] = ()
    """Modes that were refused, in order of frequency."""


@dataclass(frozen=True, slots=True)
class WindowRejected:
    """A window that was not identified, or an estimate that was not used, and why."""

    turbine: str
    window: int
    start_ns: int
    end_ns: int
    code: str
    """Stable name of the reason: "gap", "nan", "constant", …"""
    reason: str
    """The reason in words: "gap of 0.4 s in unit tower at 12.0 s"."""
    origins: tuple[UnitOrigin, ...] = ()
    """Identity of the window."""
    windows_before: int = 0
    """Windows right before it that lie in the same gap: this rejects them too."""


def without_covariances(estimate: ModalEstimate) -> ModalEstimate:
    """Return the estimate without its modes' covariance factors, by far its largest part.

    The empty ones are arrays of their own: a slice would keep the whole factor in memory.
    """
    modes = tuple(
        replace(
            mode, covariance_factor=np.empty((len(mode.covariance_factor), 0)), n_block_columns=0
        )
        for mode in estimate.modes
    )
    return replace(estimate, modes=modes)


def rejected_estimate(estimate: ModalEstimate, code: str, reason: str) -> WindowRejected:
    """Return the window of an estimate that is not used."""
    return WindowRejected(
        turbine=estimate.turbine,
        window=estimate.window,
        start_ns=estimate.start_ns,
        end_ns=estimate.end_ns,
        code=code,
        reason=reason,
        origins=estimate.origins,
    )


def same_window(one: ModalEstimate | WindowRejected, other: ModalEstimate | WindowRejected) -> bool:
    """Whether two answers are of one window: by its identity, in older recordings by its start."""
    if one.origins and other.origins:
        return (one.turbine, one.origins) == (other.turbine, other.origins)
    return (one.turbine, one.start_ns) == (other.turbine, other.start_ns)


@dataclass(frozen=True, slots=True)
class ModePair:
    """An identified mode and the model mode it was taken for."""

    identified: str
    """Name of the identified mode."""
    model: str
    """Label of the model mode: "1" to "11" are Table 1's, then the other visible ones."""
    frequency: float
    """Frequency of the identified mode [Hz]."""
    frequency_std: float
    """Standard deviation of the identified frequency [Hz]."""
    model_frequency: float
    """Frequency of the model mode at the posterior's median [Hz]."""
    mac: float
    """Modal assurance criterion of the two shapes [-]."""
    shape_used: bool
    """Whether the shape entered the likelihood; False: the frequency alone."""
    misfit: float = float("nan")
    """Difference of the frequencies in standard deviations of the posterior's prediction [-]."""
    information: float = float("nan")
    """The mode's share of what all modes tell of the springs [-]."""


@dataclass(frozen=True, slots=True)
class ParameterSummary:
    """Marginal posterior of one parameter, or of a figure of the structure that is uncertain."""

    name: str
    """Key: "k11", "k22", "k12", "sigma"; of the structure "rna_mass", …"""
    unit: str
    nominal: float
    """The turbine description's value [unit]; 1 for sigma and for factors."""
    median: float
    """Median [unit]."""
    p05: float
    """5 % quantile [unit]."""
    p95: float
    """95 % quantile [unit]."""
    contraction: float = float("nan")
    """1 − interval / the prior's; 0: nothing was learned [-]."""


@dataclass(frozen=True, slots=True)
class FigureShare:
    """What one uncertain figure of the structure adds to each spring's uncertainty."""

    name: str
    """Key of the figure, or "measurement": what is left."""
    k11: float
    """Share of the variance of ln k11 [-]."""
    k22: float
    """Share of the variance of ln k22 [-]."""
    k12: float


@dataclass(frozen=True, slots=True)
class FigureError:
    """What an error of the description makes of the springs' estimates.

    Of one standard deviation of the figure's prior, as ln (true / estimated) of each spring;
    turbines of one description have it in common.
    """

    name: str
    """Key of the figure, "water_level", or "systematic k11": identification and mesh."""
    k11: float
    """Error of ln k11 [-]."""
    k22: float
    """Error of ln k22 [-]."""
    k12: float
    """Error of ln k12 [-]."""


@dataclass(frozen=True, slots=True)
class StructureAlternative:
    """One of several structures that no figure leads between: flooded or not, …"""

    name: str
    probability: float
    """Probability given the data [-]."""


@dataclass(frozen=True, slots=True)
class RelativeStiffness:
    """A stiffness over that of a reference period; errors of the structure cancel."""

    name: str
    """The spring: "k11", "k22" or "k12"."""
    median: float
    """Median of the ratio [-]."""
    p05: float
    """5 % quantile of the ratio [-]."""
    p95: float
    """95 % quantile of the ratio [-]."""
    reference_ns: int
    """End of the reference period [ns since 1970-01-01 UTC]."""


@dataclass(frozen=True, slots=True, eq=False)
class FoundationPosterior:
    """Posterior of the foundation's coupled springs given all accepted windows so far."""

    turbine: str
    window: int
    """Number of the last window that entered."""
    time_ns: int
    """End of that window [ns since 1970-01-01 UTC]."""
    n_windows: int
    """Number of windows that entered."""
    parameters: tuple[ParameterSummary, ...]
    """Summaries of k11, k22, k12 and σ; the springs are at the lower end of the described tubes."""
    correlation: FloatArray
    """Correlation of k11, k22 and k12, (3, 3) [-]."""
    draws: FloatArray
    """At most 1000 of the draws, (n_draws, 4): k11 [N/m], k22 [N·m/rad], k12 [N/rad], σ [-]."""
    pairs: tuple[ModePair, ...]
    model_labels: tuple[str, ...]
    """Labels of all model modes that the sensors can see."""
    model_frequencies: FloatArray
    """Their frequencies at the median, (n_labels,) [Hz]."""
    model_shapes: FloatArray
    """Their shapes at the median, (n_labels, n_channels) [-].

    A column for each channel of the last window's ModalEstimate, in its order. The largest
    component is 1; it may be of a channel that the estimate lacks."""
    sampler: str
    """Name of the sampler: "laplace", "importance", "emcee", …"""
    ess: float
    """Smallest effective sample size over the parameters."""
    rhat: float
    """Largest split-R̂ over the parameters."""
    autocorrelation_time: float
    """Largest τ over the parameters [steps]; NaN: there is no chain."""
    reduced_chi_square: float
    """Reduced χ² of the paired frequencies at σ = 0 [-]."""
    paired_share: float
    """Share of the identified modes that have a model mode [-]."""
    pairing_cost: float
    """Mean pairing cost of an identified mode [-]."""
    trusted: bool = True
    """Whether no check contradicts the posterior; False: published all the same."""
    warnings: tuple[QualityWarning, ...] = ()
    population: str = ""
    """Name of the farm's prior that it began with; "": that of a turbine alone."""
    figures: tuple[ParameterSummary, ...] = ()
    """Summaries of the structure's parameters that are uncertain as well."""
    change_probability: float = 0.0
    """Probability that the modes have changed since the last event [-]."""
    structure: str = ""
    """"exact" or "uncertain"; "" in messages from before there was a choice."""
    budget: tuple[FigureShare, ...] = ()
    """Shares of the springs' variance; none for an exact structure."""
    alternatives: tuple[StructureAlternative, ...] = ()
    """Alternatives of the description, likeliest first."""
    unpredicted_share: float = 0.0
    """Share of the modes that the others do not predict [-]."""
    relative: tuple[RelativeStiffness, ...] = ()
    """Springs relative to the period before the last event; () where none is known."""
    figure_errors: tuple[FigureError, ...] = ()
    """Errors that the description's figures make; none for an exact structure."""
    origins: tuple[UnitOrigin, ...] = ()
    """Identity of the last window that entered."""

    def parameter(self, name: str) -> ParameterSummary:
        """Return the parameter of that name; KeyError where there is none."""
        for summary in self.parameters:
            if summary.name == name:
                return summary
        raise KeyError(name)


@dataclass(frozen=True, slots=True)
class PooledPosterior:
    """A turbine's springs given its own measurements and those of the other turbines alike."""

    turbine: str
    window: int
    """Number of the window whose FoundationPosterior entered."""
    time_ns: int
    """End of that window [ns since 1970-01-01 UTC]."""
    n_turbines: int
    """Number of turbines that were pooled, this one included."""
    parameters: tuple[ParameterSummary, ...]
    """Summaries of k11, k22 and k12."""
    outlier_probability: float
    """Probability that this turbine is unlike the others [-]."""
    text: str
    """One sentence for people."""


@dataclass(frozen=True, slots=True)
class StiffnessChange:
    """By how much one stiffness has changed, as a share of what it was before."""

    name: str
    """The spring: "k11", "k22" or "k12"."""
    median: float
    """Median of the change, a share of what the spring was [-]."""
    p05: float
    """5 % quantile of the change [-]."""
    p95: float
    """95 % quantile of the change [-]."""
    random_walk: float
    """The same change by a stiffness that walks from window to window [-]."""
    random_walk_std: float
    """Its standard deviation [-]."""


@dataclass(frozen=True, slots=True)
class FrequencyShift:
    """By how much one mode's frequency has changed, water level and the like taken out."""

    model: str
    """Label of the model mode it is paired with; "" for none."""
    frequency: float
    """Frequency before the change [Hz]."""
    change: float
    """Change of the frequency, a share of it [-]."""
    change_std: float
    """Standard deviation of the change [-]."""


@dataclass(frozen=True, slots=True)
class FoundationEvent:
    """The structure is no longer what it was: its foundation, or something else in its modes."""

    turbine: str
    window: int
    """Number of the window in which it was noticed."""
    time_ns: int
    """End of that window [ns since 1970-01-01 UTC]."""
    kind: str
    """"foundation": the stiffness explains it; "modal-drift": it does not; "undecided"."""
    probability: float
    """Probability that there was a change at all [-]."""
    since_ns: int
    """Start of the first window after the change, most probably."""
    since_earliest_ns: int
    """5 % quantile of `since_ns`."""
    since_latest_ns: int
    """95 % quantile of `since_ns`."""
    changes: tuple[StiffnessChange, ...]
    """Changes of k11, k22 and k12; none for a modal drift."""
    shifts: tuple[FrequencyShift, ...]
    """Shifts of all modes seen before and after."""
    text: str
    """One sentence for people."""
    origins: tuple[UnitOrigin, ...] = ()
    """Identity of the window in which it was noticed."""


@dataclass(frozen=True, slots=True)
class FoundationTruth:
    """The true stiffness of a simulated turbine. No node that estimates ever takes it."""

    turbine: str
    time_ns: int
    """Time from which the springs hold [ns since 1970-01-01 UTC]."""
    k11: float
    """Lateral spring [N/m]."""
    k22: float
    """Rotational spring [N·m/rad]."""
    k12: float
    """Coupling spring [N/rad]."""


@dataclass(frozen=True, slots=True)
class StreamGap:
    """Blocks that were published but never arrived, or were never sent."""

    turbine: str
    unit: str
    session: str
    start_ns: int
    """Time at which the missing samples begin [ns since 1970-01-01 UTC]."""
    end_ns: int
    """Time at which samples resume [ns since 1970-01-01 UTC]."""
    first_sequence: int
    """Number of the first missing block."""
    n_blocks: int

    @property
    def duration(self) -> float:
        """[s]"""
        return (self.end_ns - self.start_ns) / NANOSECONDS


@dataclass(frozen=True, slots=True)
class StreamEnd:
    """The source has no more blocks (a replay or simulation has come to its end)."""

    turbine: str
    unit: str
    session: str
    time_ns: int
    """End of the last block [ns since 1970-01-01 UTC]."""
    n_blocks: int
    """Number of blocks published in all."""


@dataclass(frozen=True, slots=True)
class BlockRange:
    """Blocks of one session that follow each other."""

    first: int
    """Number of the first block."""
    end: int
    """One past the number of the last block."""
    earliest_ns: int
    """Earliest `start_ns` of them."""
    latest_ns: int
    """Latest `start_ns` of them."""

    def has(self, sequence: int, start_ns: int) -> bool:
        """Whether a block is one of them: its stamp distinguishes starts under one name."""
        return self.first <= sequence < self.end and self.earliest_ns <= start_ns <= self.latest_ns


@dataclass(frozen=True, slots=True)
class RecordedUntil:
    """Acknowledgement of a recorder: these blocks of a unit are on its disk, synced."""

    turbine: str
    unit: str
    session: str
    time_ns: int
    """Time by the clock of the recorder's machine [ns since 1970-01-01 UTC]."""
    ranges: tuple[BlockRange, ...]
    """Ranges of recorded blocks, in order; of many the latest."""

    def has(self, sequence: int, start_ns: int) -> bool:
        """Whether a block is on disk."""
        return any(each.has(sequence, start_ns) for each in self.ranges)


FEED_MESSAGE = "FeedMessage"  # what a feed counts as received: its instrument's messages


@dataclass(frozen=True, slots=True)
class MessageCount:
    """How many messages of one type a node took or gave."""

    message: str
    """Name of the type, such as "ModalEstimate"."""
    count: int


def message_counts(counts: Mapping[str, int]) -> tuple[MessageCount, ...]:
    """Return the counts as they travel, in alphabetical order."""
    return tuple(MessageCount(name, count) for name, count in sorted(counts.items()))


@dataclass(frozen=True, slots=True)
class NodeStatus:
    """What a node reports of itself: when it starts, regularly, and when it stops."""

    turbine: str
    node: str
    time_ns: int
    """Time by the clock of the machine that the node runs on [ns since 1970-01-01 UTC]."""
    state: str
    """State: "ready", "running" or "stopped"."""
    last_sequence: int
    """Number of the last AccelerationBlock handled; -1 before the first."""
    received: tuple[MessageCount, ...] = ()
    published: tuple[MessageCount, ...] = ()
    lost: int = 0
    """Number of acceleration blocks that never came."""
    late: int = 0
    """Number of blocks that came too late to be used."""
    duplicate: int = 0
    """Number of blocks that came twice."""
    busy_s: float = 0.0
    """Time spent in handling messages [s]."""
    warnings: tuple[QualityWarning, ...] = field(default=())
    malformed: int = 0
    """Number of messages that were dropped: forged, oversized, broken."""
    recovered: int = 0
    """Number of blocks that came when their link was back, from where they were kept."""
    recorded: int = 0
    """Of a recorder: number of blocks in its recording, those of its earlier parts too."""
    refused: tuple[MessageCount, ...] = ()
    """Number of blocks that were not used, by the reason's code."""

    @property
    def has_blocks(self) -> bool:
        """Whether the node has taken a block, or reports that blocks were lost on the way to it."""
        name = AccelerationBlock.__name__
        return self.lost > 0 or any(each.message == name and each.count for each in self.received)

    def is_of(self, kind: str) -> bool:
        """Whether the node has that name, or is a share of one that has: "updating-1-of-2"."""
        return self.node == kind or self.node.startswith(f"{kind}-")


Message = (
    AccelerationBlock
    | SensorLayout
    | ScadaSample
    | ModalEstimate
    | StabilisationDiagram
    | WindowRejected
    | FoundationPosterior
    | PooledPosterior
    | FoundationEvent
    | FoundationTruth
    | StreamGap
    | StreamEnd
    | RecordedUntil
    | NodeStatus
)
