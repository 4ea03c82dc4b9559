"""What the turbine was doing during a window: which ones may speak of the foundation, and the
nacelle's axes, along which their shapes are compared."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, TypeVar

import numpy as np

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    ModalEstimate,
    Mode,
    QualityWarning,
    WindowRejected,
    rejected_estimate,
)
from pipeline.modal_assurance import normalised_to, renormalised_factor
from pipeline.oma.data_quality.coupled_harmonics import TURNING_ROTOR
from pipeline.oma.data_quality.input_checks import NON_STATIONARY, SILENT_CHANNEL
from pipeline.oma.data_quality.turning_rotor import SLOWEST
from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.layout import SensorLayout, turning_matrix
from sensors.acquisition.scada import ScadaSample
from sensors.arrays import FloatArray
from sensors.directions import mean_direction, turned_from
from sensors.errors import InputError

Known = TypeVar("Known")

OPERATING_STATES = ("parked", "idling", "start", "operating", "stop")
CHANGING = "changing"  # state of a window during which the state or the yaw changed
STEADY_YAW = 2.0  # range of the yaw over a window whose axes are known [deg]
LONGEST_HOLD = 3600.0  # of a value that is not reported again: water tables have one an hour [s]
KEPT_SAMPLES = 10_000  # SCADA samples that are remembered: more than a day at 10 s


@dataclass(frozen=True, slots=True)
class OperationSettings:
    """Which windows may update the foundation."""

    allowed_states: tuple[str, ...] = ("parked", "idling")
    """States whose windows update the foundation. A window of an unknown state is used unless
    it shows a state that is not in the list.
    """
    unusable: ClassVar[tuple[str, ...]] = ("duplicate-channel", "clipped", SILENT_CHANNEL)
    """Codes that spoil the shapes."""
    states_of_code: ClassVar[dict[str, tuple[str, ...]]] = {
        TURNING_ROTOR: ("operating",),
        NON_STATIONARY: ("start", "stop"),
    }
    """States that a window of a code may be of, where nothing reports any."""

    def __post_init__(self) -> None:
        for state in self.allowed_states:
            if state not in OPERATING_STATES:
                raise InputError(
                    f"[operation] allowed_states has {state!r}; "
                    f"states are {', '.join(OPERATING_STATES)}"
                )


class OperationLog:
    """What the controller of one turbine has reported: its latest samples, `kept` of them."""

    def __init__(self, kept: int | None = KEPT_SAMPLES) -> None:
        self._samples: deque[ScadaSample] = deque(maxlen=kept)

    def note(self, sample: ScadaSample) -> None:
        """Remember a sample."""
        self._samples.append(sample)

    def with_conditions(self, estimate: ModalEstimate) -> ModalEstimate:
        """Return the estimate with what the controller reported of its window; unchanged where it
        reported nothing."""
        samples = self._until(estimate.start_ns, estimate.end_ns)
        if not samples:
            return estimate
        begin = estimate.start_ns
        states = list(dict.fromkeys(_known(samples, begin, lambda sample: sample.state)))
        yaws = np.array(_known(samples, begin, lambda sample: sample.yaw))
        mean_yaw = mean_direction(yaws)
        deviations = turned_from(yaws, mean_yaw)
        steady = len(states) <= 1 and (not yaws.size or np.ptp(deviations) <= STEADY_YAW)
        return replace(
            estimate,
            operating_state="".join(states) if steady else CHANGING,
            wind_speed=_mean(_known(samples, begin, lambda sample: sample.wind_speed)),
            rotor_speed=_mean(_known(samples, begin, lambda sample: sample.rotor_speed)),
            yaw=mean_yaw,
            water_level=_mean(_known(samples, begin, lambda sample: sample.water_level)),
        )

    def rotor_speed(self, start_ns: int, end_ns: int, n_samples: int) -> FloatArray | None:
        """Rotor speed at each sample of a window, straight between the controller's samples.

        Parameters
        ----------
        start_ns, end_ns : int
            Window on the sensors' clock [ns since 1970-01-01 UTC].

        Returns
        -------
        ndarray, shape (n_samples,), or None
            Speed [rpm]; None where the controller reports none.
        """
        samples = self._until(start_ns, end_ns)
        known = _known(samples, start_ns, lambda s: s if math.isfinite(s.rotor_speed) else None)
        if not known:
            return None
        step = (end_ns - start_ns) / max(n_samples, 1)
        return np.interp(
            np.arange(n_samples) * step,
            [float(sample.time_ns - start_ns) for sample in known],
            [sample.rotor_speed for sample in known],
        )

    def _until(self, start_ns: int, end_ns: int) -> list[ScadaSample]:
        """Samples of the window and those that may hold when it begins, the earliest first."""
        since = start_ns - round(LONGEST_HOLD * NANOSECONDS)
        recent = [sample for sample in self._samples if since <= sample.time_ns < end_ns]
        return sorted(recent, key=lambda sample: sample.time_ns)


def _known(
    samples: Sequence[ScadaSample],
    start_ns: int,
    quantity: Callable[[ScadaSample], Known | None],
) -> list[Known]:
    """Known values of a quantity in a window, first the one that holds when it begins.

    A controller reports a quantity without the others, and at times does not know it.
    """
    before: list[Known] = []
    inside: list[Known] = []
    for sample in samples:
        value = quantity(sample)
        if value is None or value == "" or value != value:  # NaN alone differs from itself
            continue
        if sample.time_ns <= start_ns:
            before = [value]
        else:
            inside.append(value)
    return before + inside


def _mean(values: Sequence[float]) -> float:
    """Return the mean of the values that the controller knew; NaN if it knew none."""
    return float(np.mean(values)) if values else math.nan


Answer = FoundationEvent | FoundationPosterior | WindowRejected


def usable_estimate(
    estimate: ModalEstimate, settings: OperationSettings, layout: SensorLayout | None
) -> ModalEstimate | WindowRejected:
    """Return the estimate with its shapes along the nacelle's axes, or why it may not speak of the
    foundation.

    Parameters
    ----------
    layout : SensorLayout or None
        Of the sensors, along whose axes the model's shapes are read; None: as the estimate says.
    """
    state, allowed = estimate.operating_state, settings.allowed_states
    if state and state not in allowed:
        reason = (
            f"the turbine was {state}; only {' and '.join(allowed)} windows update the foundation"
        )
        return rejected_estimate(estimate, "operating-state", reason)
    for warning in estimate.warnings:
        if warning.code in settings.unusable:
            return rejected_estimate(estimate, warning.code, f"{warning.text}; not used")
    shown = None if state else _shown_state(estimate, settings)
    if shown is not None:
        reason = (
            f"{shown.text}; nothing reports the turbine's state, and only {' and '.join(allowed)} "
            "windows update the foundation"
        )
        return rejected_estimate(estimate, shown.code, reason)
    if estimate.end_ns <= estimate.start_ns:
        text = "the window ends where it begins: its unit's clock was set"
        return rejected_estimate(estimate, "no-duration", text)
    return estimate if layout is None else in_nacelle_axes(estimate, layout)


def _shown_state(estimate: ModalEstimate, settings: OperationSettings) -> QualityWarning | None:
    """Return what shows that a window of an unknown state is of none that is allowed."""
    warnings = list(estimate.warnings)
    if estimate.rotor_speed >= SLOWEST:  # not where it is unknown
        text = f"the rotor turns at {estimate.rotor_speed:.3g} rpm"
        warnings.insert(0, QualityWarning(TURNING_ROTOR, text))
    for warning in warnings:
        states = settings.states_of_code.get(warning.code)
        if states is not None and not set(states) & set(settings.allowed_states):
            return warning
    return None


def in_nacelle_axes(estimate: ModalEstimate, layout: SensorLayout) -> ModalEstimate:
    """The estimate with its shapes turned from the tower's axes to those of the yawed nacelle.

    Parameters
    ----------
    estimate : ModalEstimate
        Returned as it is where its yaw is 0 or unknown.
    layout : SensorLayout
        Places and directions of the channels.

    Notes
    -----
    Sensors are fixed to the tower while fore-aft follows the nacelle. Two axes at one height span
    the horizontal motion there, whatever their directions; it is read again along the layout's own
    directions after a turn by −yaw.
    """
    if not np.isfinite(estimate.yaw) or abs(math.remainder(estimate.yaw, 360.0)) < 1e-9:
        return estimate
    by_name = {channel.name: channel for channel in layout.channels}
    if not by_name.keys() >= set(estimate.channels):
        return estimate  # the updater refuses channels that the layout does not have
    measured = replace(layout, channels=tuple(by_name[name] for name in estimate.channels))
    turn = turning_matrix(measured, estimate.yaw)
    return replace(estimate, modes=tuple(_turned(mode, turn) for mode in estimate.modes))


def _turned(mode: Mode, turn: FloatArray) -> Mode:
    shape = turn @ mode.shape
    unit = int(np.argmax(np.abs(shape)))
    factor = mode.covariance_factor.copy()
    factor[2:] = renormalised_factor(shape, turn @ mode.covariance_factor[2:], unit)
    return replace(mode, shape=normalised_to(shape, unit), covariance_factor=factor)


def at_its_channels(answer: Answer, estimate: ModalEstimate, channels: Sequence[str]) -> Answer:
    """Return the answer with the model's shapes at the estimate's channels, in their order.

    Parameters
    ----------
    answer : FoundationEvent, FoundationPosterior or WindowRejected
        Only a posterior has shapes.
    estimate : ModalEstimate
        That it answers: of some of the updating's channels, in any order.
    channels : sequence of str
        The updating's, in whose order its shapes are.
    """
    if not isinstance(answer, FoundationPosterior) or estimate.channels == tuple(channels):
        return answer
    columns = [channels.index(name) for name in estimate.channels]
    return replace(answer, model_shapes=answer.model_shapes[:, columns])
