"""A short session as it would be recorded: modes, posteriors, a change, a gap, warnings."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    FoundationTruth,
    FrequencyShift,
    Message,
    ModalEstimate,
    Mode,
    ModePair,
    ParameterSummary,
    QualityWarning,
    StiffnessChange,
    StreamGap,
)
from pipeline.recording.writer import Recorder
from sensors.acquisition.blocks import NANOSECONDS
from tests.pipeline.example_messages import LAYOUT, START_NS, block, rejection, status

WINDOW_NS = 600 * NANOSECONDS
NOMINAL = {"k11": 0.098e11, "k22": 8.238e11, "k12": 0.678e11}  # [foundation-updating] Eq. 12
UNITS = {"k11": "N/m", "k22": "N·m/rad", "k12": "N/rad"}
FREQUENCIES = (0.16, 0.63, 1.1, 1.83, 2.57)  # [Hz]
N_CHANNELS = len(LAYOUT.channels)


def estimate(window: int, *, turbine: str = "t1", drop: float = 0.0) -> ModalEstimate:
    """Five modes of a window, lower by the share `drop`."""
    generator = np.random.default_rng(window)
    return ModalEstimate(
        turbine=turbine,
        window=window,
        start_ns=START_NS + window * WINDOW_NS,
        end_ns=START_NS + (window + 1) * WINDOW_NS,
        layout_id=LAYOUT.layout_id,
        channels=LAYOUT.channel_names,
        modes=tuple(
            Mode(
                name=f"m{number}",
                frequency=f * (1 - drop) * (1 + 1e-3 * generator.standard_normal()),
                frequency_std=1e-3 * f,
                damping_ratio=0.01,
                damping_ratio_std=0.001,
                shape=generator.uniform(0.1, 1.0, N_CHANNELS),
                covariance_factor=np.full((2 + N_CHANNELS, 3), 0.01),
                n_block_columns=3,
            )
            for number, f in enumerate(FREQUENCIES, start=1)
        ),
    )


def posterior(
    window: int,
    *,
    turbine: str = "t1",
    k22: float = 1.0,
    trusted: bool = True,
    warnings: tuple[QualityWarning, ...] = (),
) -> FoundationPosterior:
    """A posterior about nominal, k22 at that ratio; its draws from seed 5."""
    ratios = {"k11": 1.0, "k22": k22, "k12": 1.0}
    draws = np.random.default_rng(5).normal(1.0, 0.006, (400, 4))
    draws[:, 1] *= k22
    draws[:, 3] = np.abs(draws[:, 3] - 1)
    springs = tuple(
        ParameterSummary(
            name, UNITS[name], nominal=NOMINAL[name], median=ratios[name] * NOMINAL[name],
            p05=0.99 * ratios[name] * NOMINAL[name], p95=1.01 * ratios[name] * NOMINAL[name],
            contraction=0.994,
        )
        for name in NOMINAL
    )  # fmt: skip
    sigma = ParameterSummary("sigma", "-", 1.0, 1e-4, 1e-5, 4e-4, 0.996)
    return FoundationPosterior(
        turbine=turbine,
        window=window,
        time_ns=START_NS + (window + 1) * WINDOW_NS,
        n_windows=window + 1,
        parameters=(*springs, sigma),
        correlation=np.eye(3),
        draws=draws * np.array([*NOMINAL.values(), 1.0]),
        pairs=tuple(
            ModePair(f"m{n}", str(n), f, 1e-3 * f, f, 0.99, True, 0.3, 0.2)
            for n, f in enumerate(FREQUENCIES, start=1)
        ),
        model_labels=tuple(str(n) for n in range(1, 6)),
        model_frequencies=np.array(FREQUENCIES),
        model_shapes=np.ones((5, N_CHANNELS)),
        sampler="importance",
        ess=1100.0,
        rhat=1.002,
        autocorrelation_time=float("nan"),
        reduced_chi_square=0.8,
        paired_share=1.0,
        pairing_cost=0.4,
        trusted=trusted,
        warnings=warnings,
    )


def event(kind: str = "foundation", *, window: int = 3, turbine: str = "t1") -> FoundationEvent:
    """k22 has fallen by 9 % [6, 12] between two windows; modes have fallen with it."""
    since_ns = START_NS + window * WINDOW_NS
    changes = (
        StiffnessChange("k11", -0.01, -0.04, 0.02, -0.01, 0.01),
        StiffnessChange("k22", -0.09, -0.12, -0.06, -0.09, 0.02),
        StiffnessChange("k12", 0.03, 0.01, 0.05, 0.03, 0.01),
    )
    return FoundationEvent(
        turbine=turbine,
        window=window,
        time_ns=since_ns + WINDOW_NS,
        kind=kind,
        probability=0.998,
        since_ns=since_ns,
        since_earliest_ns=since_ns - WINDOW_NS,
        since_latest_ns=since_ns + WINDOW_NS,
        changes=() if kind == "modal-drift" else changes,
        shifts=(FrequencyShift("3", 1.1, -0.012, 0.001), FrequencyShift("", 2.57, 0.001, 0.001)),
        text="the structure is not what it was",
    )


def session(turbine: str = "t1") -> list[Message]:
    """An hour: three windows, a change, three more, one rejected, a gap, what the nodes say."""
    layout = replace(LAYOUT, turbine=turbine)
    truth = FoundationTruth(turbine, START_NS, **NOMINAL)
    messages: list[Message] = [
        layout,
        truth,
        block(0, turbine=turbine),
        block(3599, turbine=turbine),
        StreamGap(
            turbine, "tower", "session-1", START_NS + NANOSECONDS, START_NS + 5 * NANOSECONDS, 1, 4
        ),
    ]
    for window in range(6):
        drop = 0.0 if window < 3 else 0.01
        messages.append(estimate(window, turbine=turbine, drop=drop))
        if window == 3:
            messages.append(event(turbine=turbine))
            k22 = 0.91 * NOMINAL["k22"]
            messages.append(replace(truth, k22=k22, time_ns=START_NS + 3 * WINDOW_NS))
        ratio = 1.0 if window < 3 else 0.912
        messages.append(posterior(window, turbine=turbine, k22=ratio))
    messages.append(rejection(6, turbine=turbine))
    messages.append(replace(status("recorder", last_sequence=3599), turbine=turbine))
    return messages


def recorded(path: Path, messages: list[Message], **metadata: dict[str, str]) -> Path:
    """A recording of these messages."""
    recorder = Recorder(path, metadata=metadata, clock=None)
    for message in messages:
        recorder.handle(message)
    recorder.close()
    return path
