"""A session to look at, made up from sensible figures; no simulation, no identification.

The eleven modes are those of the IEA 15 MW monopile at its nominal foundation (frequencies and
shapes of the finite-element model, at 41, 80, 106 and 145 m), the posterior's widths those that six
windows of ten minutes reach. Everything random has the seed 8.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    FoundationTruth,
    Message,
    ModalEstimate,
    Mode,
    ModePair,
    NodeStatus,
    ParameterSummary,
    QualityWarning,
    StabilisationDiagram,
    StiffnessChange,
    StreamGap,
    WindowRejected,
)
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import biaxial_layout
from sensors.structure.description import load_turbine

START_NS = 1_767_225_600 * NANOSECONDS  # 2026-01-01 00:00 UTC
SAMPLING_RATE = 40.0  # [Hz]
WINDOW = 600  # [s]
TURBINE = "iea15mw"
LAYOUT = biaxial_layout(
    "four-levels", turbine=TURBINE, unit="tower", elevations=(41.0, 80.0, 106.0, 145.0)
)
DESCRIPTION = load_turbine("iea15mw_monopile")
TRUE_RATIOS = np.array([1.12, 1.05, 1.04])  # k11, k22, k12 over nominal [-]
UNITS = ("N/m", "N·m/rad", "N/rad")

# name, direction, frequency [Hz], displacement at 41, 80, 106, 145 m, largest component 1 [-]
REFERENCE_MODES = (
    ("1", "SS", 0.15732, (0.1804, 0.3998, 0.6030, 1.0000)),
    ("2", "FA", 0.15861, (0.1811, 0.4010, 0.6043, 1.0000)),
    ("3", "FA", 0.62981, (0.3481, 0.6634, 0.8566, 1.0000)),
    ("4", "SS", 1.07495, (0.6724, 1.0000, 0.9163, 0.0174)),
    ("5", "FA", 1.09969, (0.6827, 1.0000, 0.8937, -0.0574)),
    ("6", "FA", 1.81625, (1.0000, 0.9184, 0.2963, -0.2554)),
    ("7", "FA", 2.59830, (1.0000, 0.0913, -0.9615, -0.3696)),
    ("8", "FA", 3.80026, (-0.3043, 0.7889, 1.0000, 0.0949)),
    ("9", "FA", 5.85868, (-0.6138, -0.5584, 1.0000, 0.2909)),
    ("10", "FA", 10.46902, (-0.6152, 1.0000, -0.4695, -0.1912)),
    ("11", "FA", 12.11870, (0.1745, -0.5104, 1.0000, -0.2068)),
)
DAMPING = 0.008  # [-]


@dataclass(frozen=True)
class Episode:
    """What happens in a made-up session."""

    n_windows: int = 3
    rejected: tuple[int, ...] = ()  # windows that hold a gap
    truth: bool = True
    trusted: bool = True
    block: int = 10  # length of a block [s]
    ahead: bool = False  # identification is done with every window before updating with the first


def session(episode: Episode = Episode()) -> Iterator[Message]:
    """All messages in the order in which a replay gives them."""
    rng = np.random.default_rng(8)
    yield node_status("ready", -1)
    yield LAYOUT
    if episode.truth:
        true = TRUE_RATIOS * DESCRIPTION.nominal
        yield FoundationTruth(TURBINE, START_NS, *map(float, true))
    yield node_status("running", 0)
    n_accepted = 0
    waiting: list[FoundationPosterior] = []
    for window in range(episode.n_windows):
        gap = window in episode.rejected
        yield from window_blocks(window, episode, rng, gap=gap)
        if gap:
            yield rejection(window)
            continue
        n_accepted += 1
        estimate = modal_estimate(window, rng)
        yield estimate
        yield stabilisation_diagram(estimate, rng)
        waiting.append(foundation_posterior(estimate, n_accepted, rng, trusted=episode.trusted))
        if not episode.ahead:
            yield waiting.pop()
    yield from waiting
    yield node_status("stopped", episode.n_windows * WINDOW // episode.block - 1)


def window_blocks(
    window: int, episode: Episode, rng: np.random.Generator, *, gap: bool
) -> Iterator[Message]:
    """The blocks of one window; with a gap, its second minute never comes."""
    first = window * WINDOW // episode.block
    missing = range(first + 60 // episode.block, first + 120 // episode.block) if gap else range(0)
    for sequence in range(first, first + WINDOW // episode.block):
        if sequence not in missing:
            yield acceleration_block(sequence, episode.block, rng)
    if gap:
        start = START_NS + missing.start * episode.block * NANOSECONDS
        end = START_NS + missing.stop * episode.block * NANOSECONDS
        yield StreamGap(TURBINE, "tower", "s1", start, end, missing.start, len(missing))


def acceleration_block(sequence: int, length: int, rng: np.random.Generator) -> AccelerationBlock:
    """Every mode swings with its own phase, plus noise; amplitudes of 2 to 20 mm/s²."""
    first_sample = int(sequence * length * SAMPLING_RATE)
    times = (first_sample + np.arange(int(length * SAMPLING_RATE))) / SAMPLING_RATE
    samples = 0.004 * rng.standard_normal((len(times), len(LAYOUT.channels)))
    for i, (_, _, frequency, _) in enumerate(REFERENCE_MODES):
        envelope = 1.0 + 0.6 * np.sin(2 * np.pi * times / (70.0 + 13.0 * i))
        wave = 0.02 * envelope * np.sin(2 * np.pi * frequency * times + i)
        samples += np.outer(wave, sensor_shape(i))
    return AccelerationBlock(
        TURBINE,
        "tower",
        "s1",
        LAYOUT.layout_id,
        sequence,
        first_sample,
        START_NS + sequence * length * NANOSECONDS,
        SAMPLING_RATE,
        samples.astype(np.float32),
    )


def sensor_shape(i: int) -> np.ndarray:
    """(8,) mode i at the layout's channels: fore-aft × 4, then side-side × 4."""
    _, direction, _, components = REFERENCE_MODES[i]
    still = np.zeros(4)
    return np.concatenate([components, still] if direction == "FA" else [still, components])


def modal_estimate(window: int, rng: np.random.Generator) -> ModalEstimate:
    """Modes 2 to 11 (mode 1 is too near to mode 2 to be found), with errors of their own std."""
    modes = tuple(identified_mode(i, rng) for i in range(1, len(REFERENCE_MODES)))
    end = START_NS + (window + 1) * WINDOW * NANOSECONDS
    return ModalEstimate(
        TURBINE,
        window,
        end - WINDOW * NANOSECONDS,
        end,
        LAYOUT.layout_id,
        LAYOUT.channel_names,
        modes,
        warnings=(QualityWarning("close-modes", "0.157 and 0.159 Hz are nearer than 1/600 s"),),
    )


def stabilisation_diagram(
    estimate: ModalEstimate, rng: np.random.Generator
) -> StabilisationDiagram:
    """Every mode in every second order from 20 to 60; the first four in a slow band too."""
    columns = [
        (mode, band) for band in (0, 1) for mode in estimate.modes[: 4 if band == 0 else None]
    ]
    poles = [
        (
            *(order, band, mode.frequency + mode.frequency_std * rng.standard_normal()),
            *(mode.frequency_std, mode.damping_ratio),
        )
        for mode, band in columns
        for order in range(20, 62, 2)
    ]
    orders, bands, frequencies, stds, dampings = np.array(poles, np.float32).T
    return StabilisationDiagram(
        *(TURBINE, estimate.window, estimate.start_ns, estimate.end_ns),
        *(orders, bands, frequencies, stds, dampings),
    )


def identified_mode(i: int, rng: np.random.Generator) -> Mode:
    """A mode found with the usual uncertainty: std(f)/f = sqrt(ζ / (2π f T))."""
    frequency = REFERENCE_MODES[i][2]
    std = frequency * np.sqrt(DAMPING / (2 * np.pi * frequency * WINDOW))
    shape = sensor_shape(i) + 0.01 * rng.standard_normal(8)
    stds = np.concatenate([[std, 0.1 * DAMPING], np.full(8, 0.01)])
    return Mode(
        name=f"m{i + 1}",
        frequency=frequency + std * rng.standard_normal(),
        frequency_std=std,
        damping_ratio=DAMPING * (1 + 0.1 * rng.standard_normal()),
        damping_ratio_std=0.1 * DAMPING,
        shape=shape / np.abs(shape).max(),
        covariance_factor=np.diag(stds),
        n_block_columns=10,
    )


def foundation_posterior(
    estimate: ModalEstimate, n_windows: int, rng: np.random.Generator, *, trusted: bool = True
) -> FoundationPosterior:
    """Draws round the truth that narrow with the windows, positively correlated."""
    stds = np.array([0.011, 0.018, 0.022]) / np.sqrt(n_windows)
    correlation = np.array([[1.0, 0.8, 0.75], [0.8, 1.0, 0.95], [0.75, 0.95, 1.0]])
    covariance = correlation * np.outer(stds, stds)
    centre = rng.multivariate_normal(TRUE_RATIOS, covariance)
    draws = np.empty((800, 4))
    draws[:, :3] = rng.multivariate_normal(centre, covariance, size=800) * DESCRIPTION.nominal
    draws[:, 3] = np.abs(rng.normal(0.0, 0.004 / np.sqrt(n_windows), size=800))
    return FoundationPosterior(
        turbine=TURBINE,
        window=estimate.window,
        time_ns=estimate.end_ns,
        n_windows=n_windows,
        parameters=summaries(draws),
        correlation=correlation,
        draws=draws,
        pairs=tuple(pair(mode) for mode in estimate.modes),
        model_labels=tuple(name for name, *_ in REFERENCE_MODES),
        model_frequencies=np.array([frequency for _, _, frequency, _ in REFERENCE_MODES]),
        model_shapes=np.array([sensor_shape(i) for i in range(len(REFERENCE_MODES))]),
        sampler="emcee",
        ess=900.0,
        rhat=1.004,
        autocorrelation_time=6.2,
        reduced_chi_square=1.1,
        paired_share=0.91,
        pairing_cost=1.4,
        trusted=trusted,
    )


def summaries(draws: np.ndarray) -> tuple[ParameterSummary, ...]:
    """Quantiles of the draws, parameter by parameter."""
    nominal = (*DESCRIPTION.nominal, 1.0)
    quantiles = np.quantile(draws, [0.5, 0.05, 0.95], axis=0).T
    rows = zip(("k11", "k22", "k12", "sigma"), (*UNITS, "-"), nominal, quantiles, strict=True)
    return tuple(
        ParameterSummary(name, unit, float(reference), *map(float, values), contraction=0.97)
        for name, unit, reference, values in rows
    )


def pair(mode: Mode) -> ModePair:
    """The identified mode mN belongs to the model's N."""
    label = mode.name.removeprefix("m")
    model_frequency = REFERENCE_MODES[int(label) - 1][2]
    return ModePair(
        mode.name, label, mode.frequency, mode.frequency_std, model_frequency, 0.998, True
    )


def rejection(window: int) -> WindowRejected:
    start = START_NS + window * WINDOW * NANOSECONDS
    reason = "gap of 60.0 s in unit tower at 60.0 s"
    return WindowRejected(TURBINE, window, start, start + WINDOW * NANOSECONDS, "gap", reason)


def node_status(state: str, last_sequence: int) -> NodeStatus:
    """Stamped by the machine's clock, years away from the sensors'."""
    machine_ns = 2_000_000_000 * NANOSECONDS
    return NodeStatus(TURBINE, "identification", machine_ns, state, last_sequence)


def change_event(window: int) -> FoundationEvent:
    """A tenth of k22 gone, k11 and k12 hardly touched, detected in a window."""
    end = START_NS + (window + 1) * WINDOW * NANOSECONDS
    since = end - 2 * WINDOW * NANOSECONDS
    changes = tuple(
        StiffnessChange(name, size, size - 0.02, size + 0.02, size, 0.01)
        for name, size in (("k11", 0.0), ("k22", -0.1), ("k12", -0.01))
    )
    text = "the foundation has changed: k22 −10 %"
    return FoundationEvent(
        *(TURBINE, window, end, "foundation", 0.998, since, since, end, changes, (), text)
    )
