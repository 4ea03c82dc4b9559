"""What the turbine was doing during a window, and which windows may speak of the foundation."""

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from pipeline.messages import ModalEstimate, WindowRejected, rejected_estimate
from sensors.acquisition.scada import ScadaSample
from sensors.arrays import FloatArray
from sensors.errors import InputError

OPERATING_STATES = ("parked", "idling", "start", "operating", "stop")
CHANGING = "changing"  # state of a window during which the state or the yaw changed
STEADY_YAW = 2.0  # range of the yaw over a window whose axes are known [deg]
KEPT_SAMPLES = 10_000  # SCADA samples that are remembered: more than a day at 10 s


@dataclass(frozen=True, slots=True)
class OperationSettings:
    """Which windows may update the foundation."""

    allowed_states: tuple[str, ...] = ("parked", "idling")  # "" (unknown) always may
    unusable: ClassVar[tuple[str, ...]] = ("duplicate-channel", "clipped")
    """Codes that spoil the shapes."""

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
        """The estimate with what the controller reported of its window; unchanged where it
        reported nothing."""
        samples = self._during(estimate.start_ns, estimate.end_ns)
        if not samples:
            return estimate
        states = list(dict.fromkeys(sample.state for sample in samples))
        yaws = np.array([sample.yaw for sample in samples])
        known = yaws[np.isfinite(yaws)]
        steady = len(states) == 1 and (not known.size or np.ptp(known) <= STEADY_YAW)
        return replace(
            estimate,
            operating_state=states[0] if steady else CHANGING,
            wind_speed=float(np.mean([sample.wind_speed for sample in samples])),
            rotor_speed=float(np.mean([sample.rotor_speed for sample in samples])),
            yaw=float(np.mean(yaws)),
            water_level=float(np.mean([sample.water_level for sample in samples])),
        )

    def rotor_speed(self, start_ns: int, end_ns: int, n_samples: int) -> FloatArray | None:
        """Rotor speed at each sample of a window, straight between the controller's samples.

        Parameters
        ----------
        start_ns, end_ns : int
            Window on the sensors' clock [ns since 1970-01-01 UTC].
        n_samples : int

        Returns
        -------
        ndarray, shape (n_samples,), or None
            Speed [rpm]; None where the controller reports none.
        """
        known = [s for s in self._during(start_ns, end_ns) if math.isfinite(s.rotor_speed)]
        if not known:
            return None
        step = (end_ns - start_ns) / max(n_samples, 1)
        return np.interp(
            np.arange(n_samples) * step,
            [float(sample.time_ns - start_ns) for sample in known],
            [sample.rotor_speed for sample in known],
        )

    def _during(self, start_ns: int, end_ns: int) -> list[ScadaSample]:
        """Samples of the window, and the one that holds when it begins."""
        known = self._samples
        before = [sample for sample in known if sample.time_ns <= start_ns]
        inside = [sample for sample in known if start_ns < sample.time_ns < end_ns]
        return before[-1:] + inside


def refusal_by_operation(
    estimate: ModalEstimate, settings: OperationSettings
) -> WindowRejected | None:
    """Why an estimate may not speak of the foundation; None: it may."""
    state, allowed = estimate.operating_state, settings.allowed_states
    if state and state not in allowed:
        reason = (
            f"the turbine was {state}; only {' and '.join(allowed)} windows update the foundation"
        )
        return rejected_estimate(estimate, "operating-state", reason)
    for doubt in estimate.warnings:
        if doubt.code in settings.unusable:
            return rejected_estimate(estimate, doubt.code, f"{doubt.text}; not used")
    return None
