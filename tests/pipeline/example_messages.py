"""Messages to send and record: a plain tower for flows, and every message there can be."""

from collections.abc import Iterable, Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from pipeline import messages as contract
from pipeline.messages import (
    BlockRange,
    FoundationEvent,
    FoundationPosterior,
    FoundationTruth,
    FrequencyShift,
    Message,
    MessageCount,
    ModalEstimate,
    Mode,
    ModePair,
    NodeStatus,
    ParameterSummary,
    PooledPosterior,
    RecordedUntil,
    StabilisationDiagram,
    StiffnessChange,
    StreamEnd,
    StreamGap,
    WindowRejected,
)
from pipeline.recording.writer import Recorder
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock, BlockStatus
from sensors.acquisition.layout import Accelerometer, SensorLayout, biaxial_layout
from sensors.acquisition.scada import ScadaSample

START_NS = 1_700_000_000 * NANOSECONDS
SAMPLING_RATE = 40.0  # [Hz]
ADC_STEP = 2.0**-14  # [m/s²]
LAYOUT = biaxial_layout(
    "four-levels", turbine="t1", unit="tower", elevations=(41.0, 80.0, 106.0, 145.0)
)


def block(sequence: int, *, turbine: str = "t1", unit: str = "tower") -> AccelerationBlock:
    """Second number `sequence` of a tower at 40 Hz: 70 mm/s² rms of noise in steps of the ADC."""
    noise = np.random.default_rng(sequence).normal(scale=0.07, size=(40, 8))
    return AccelerationBlock(
        turbine=turbine,
        unit=unit,
        session="session-1",
        layout_id="four-levels",
        sequence=sequence,
        first_sample=40 * sequence,
        start_ns=START_NS + sequence * NANOSECONDS,
        sampling_rate=SAMPLING_RATE,
        samples=(np.round(noise / ADC_STEP) * ADC_STEP).astype(np.float32),
    )


def recorded(path: Path, messages: Iterable[Message]) -> Path:
    """A recording of messages, by their own times."""
    recorder = Recorder(path, metadata={}, clock=None)
    for message in messages:
        recorder.handle(message)
    recorder.close()
    return path


def rejection(window: int, *, turbine: str = "t1") -> WindowRejected:
    """A window of ten minutes that was not identified."""
    start_ns = START_NS + window * 600 * NANOSECONDS
    return WindowRejected(
        turbine, window, start_ns, start_ns + 600 * NANOSECONDS, "gap", "gap of 0.4 s in tower"
    )


def status(
    node: str,
    *,
    last_sequence: int = -1,
    received: dict[str, int] | None = None,
    published: dict[str, int] | None = None,
    lost: int = 0,
    recorded: int = 0,
    state: str = "running",
) -> NodeStatus:
    """What a node says of itself, its counts by message type."""
    return NodeStatus(
        turbine="t1",
        node=node,
        time_ns=START_NS,
        state=state,
        last_sequence=last_sequence,
        received=tuple(MessageCount(name, n) for name, n in (received or {}).items()),
        published=tuple(MessageCount(name, n) for name, n in (published or {}).items()),
        lost=lost,
        recorded=recorded,
    )


def same(one: Any, other: Any) -> bool:
    """Whether two messages agree in every field, arrays and NaN bit by bit."""
    if type(one) is not type(other):
        return False
    if isinstance(one, np.ndarray):
        return (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if is_dataclass(one):
        return all(same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one))
    if isinstance(one, float):
        return np.float64(one).tobytes() == np.float64(other).tobytes()
    return bool(one == other)


def all_same(ones: Iterator[Message] | list[Message], others: Any) -> bool:
    """`same` for two sequences of messages."""
    return same(tuple(ones), tuple(others))


# ---- every message there can be ----------------------------------------------------------------

texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
numbers = st.floats()  # NaN and ∞ included
conditions = st.floats(-1e9, 1e9) | st.just(float("nan"))
counts = st.integers(0, 2**62 - 1)
times = st.integers(0, 2**62 - 1)
spans = st.tuples(times, times).map(sorted)
warnings = st.lists(st.builds(contract.QualityWarning, texts, texts), max_size=2).map(tuple)


def float_arrays(*shape: int, dtype: type = np.float64) -> st.SearchStrategy[Any]:
    return arrays.arrays(dtype, shape, elements=st.floats(width=np.dtype(dtype).itemsize * 8))


@st.composite
def blocks(draw: st.DrawFn) -> AccelerationBlock:
    n_samples, n_channels = draw(st.integers(1, 5)), draw(st.integers(1, 4))
    return AccelerationBlock(
        turbine=draw(texts),
        unit=draw(texts),
        session=draw(texts),
        layout_id=draw(texts),
        sequence=draw(counts),
        first_sample=draw(counts),
        start_ns=draw(st.integers(0, 2**61)),
        sampling_rate=draw(st.floats(1e-3, 1e7)),
        samples=draw(float_arrays(n_samples, n_channels, dtype=np.float32)),
        status=BlockStatus(draw(st.integers(0, 7))),
    )


@st.composite
def layouts(draw: st.DrawFn) -> SensorLayout:
    direction = st.sampled_from([(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.6, 0.8, 0.0)])
    channel = st.builds(
        Accelerometer,
        name=texts,
        elevation=st.floats(-100, 200),
        direction=direction,
        coupling=st.sampled_from(["dc", "ac"]),
        corner_frequency=st.floats(1e-3, 1),
        serial=texts,
        unit=texts,
    )
    channels = draw(st.lists(channel, min_size=1, max_size=3, unique_by=lambda c: c.name))
    return SensorLayout(draw(texts), draw(texts), draw(texts), tuple(channels))


@st.composite
def estimates(draw: st.DrawFn) -> ModalEstimate:
    channels = draw(st.lists(texts, min_size=1, max_size=3).map(tuple))
    n_channels, n_columns = len(channels), draw(st.integers(0, 4))
    mode = st.builds(
        Mode,
        *[texts, numbers, numbers, numbers, numbers],
        shape=float_arrays(n_channels),
        covariance_factor=float_arrays(2 + n_channels, n_columns),
        n_block_columns=st.integers(0, n_columns),
        phase_collinearity=numbers,
        presence=numbers,
        quality=numbers,
        pair_id=texts,
    )
    start_ns, end_ns = draw(spans)
    return ModalEstimate(
        turbine=draw(texts),
        window=draw(counts),
        start_ns=start_ns,
        end_ns=end_ns,
        layout_id=draw(texts),
        channels=channels,
        modes=draw(st.lists(mode, max_size=2).map(tuple)),
        weight=draw(st.floats(1e-6, 1.0)),
        warnings=draw(warnings),
        operating_state=draw(texts),
        wind_speed=draw(conditions),
        rotor_speed=draw(conditions),
        yaw=draw(conditions),
        water_level=draw(conditions),
    )


@st.composite
def diagrams(draw: st.DrawFn) -> StabilisationDiagram:
    n_poles = draw(st.integers(0, 3))
    poles = [draw(float_arrays(n_poles, dtype=np.float32)) for _ in range(5)]
    return StabilisationDiagram(draw(texts), draw(counts), *draw(spans), *poles)


def summaries(name: str) -> st.SearchStrategy[ParameterSummary]:
    nominal = st.floats(1e-3, 1e15) | st.floats(-1e15, -1e-3)
    quantiles = [st.floats(-1e20, 1e20)] * 3
    return st.builds(ParameterSummary, st.just(name), texts, nominal, *quantiles, numbers)


@st.composite
def posteriors(draw: st.DrawFn) -> FoundationPosterior:
    labels = draw(st.lists(texts, max_size=3).map(tuple))
    pairs = st.builds(ModePair, texts, texts, *[numbers] * 4, st.booleans(), *[numbers] * 2)
    return FoundationPosterior(
        turbine=draw(texts),
        window=draw(counts),
        time_ns=draw(times),
        n_windows=draw(counts),
        parameters=tuple(draw(summaries(name)) for name in ("k11", "k22", "k12", "sigma")),
        correlation=draw(float_arrays(3, 3)),
        draws=draw(float_arrays(draw(st.integers(0, 3)), 4)),
        pairs=draw(st.lists(pairs, max_size=2).map(tuple)),
        model_labels=labels,
        model_frequencies=draw(float_arrays(len(labels))),
        model_shapes=draw(float_arrays(len(labels), draw(st.integers(0, 3)))),
        sampler=draw(texts),
        **{name: draw(numbers) for name in _POSTERIOR_NUMBERS},
        trusted=draw(st.booleans()),
        warnings=draw(warnings),
        population=draw(texts),
        figures=draw(st.lists(summaries("rna_mass"), max_size=1).map(tuple)),
        change_probability=draw(numbers),
    )


@st.composite
def pooled(draw: st.DrawFn) -> PooledPosterior:
    return PooledPosterior(
        turbine=draw(texts),
        window=draw(counts),
        time_ns=draw(times),
        n_turbines=draw(counts),
        parameters=tuple(draw(summaries(name)) for name in ("k11", "k22", "k12")),
        outlier_probability=draw(numbers),
        text=draw(texts),
    )


_POSTERIOR_NUMBERS = (
    "ess",
    "rhat",
    "autocorrelation_time",
    "reduced_chi_square",
    "paired_share",
    "pairing_cost",
)


@st.composite
def events(draw: st.DrawFn) -> FoundationEvent:
    earliest, latest = draw(spans)
    return FoundationEvent(
        turbine=draw(texts),
        window=draw(counts),
        time_ns=draw(times),
        kind=draw(texts),
        probability=draw(numbers),
        since_ns=draw(times),
        since_earliest_ns=earliest,
        since_latest_ns=latest,
        changes=draw(
            st.lists(st.builds(StiffnessChange, texts, *[numbers] * 5), max_size=3).map(tuple)
        ),
        shifts=draw(
            st.lists(st.builds(FrequencyShift, texts, *[numbers] * 3), max_size=3).map(tuple)
        ),
        text=draw(texts),
    )


@st.composite
def _spanned(draw: st.DrawFn) -> WindowRejected | StreamGap:
    start_ns, end_ns = draw(spans)
    rejected = st.builds(
        WindowRejected, texts, counts, *map(st.just, (start_ns, end_ns)), texts, texts,
        windows_before=counts,
    )  # fmt: skip
    gap = st.builds(
        StreamGap, texts, texts, texts, *map(st.just, (start_ns, end_ns)), counts, counts
    )
    return draw(st.one_of(rejected, gap))


@st.composite
def _acknowledged(draw: st.DrawFn) -> RecordedUntil:
    firsts = draw(st.lists(st.tuples(counts, st.integers(1, 1000), spans), max_size=3))
    ranges = tuple(
        BlockRange(first, first + length, *span)
        for first, length, span in firsts
        if first + length < 2**62
    )
    return RecordedUntil(draw(texts), draw(texts), draw(texts), draw(times), ranges)


_counted = st.lists(st.builds(MessageCount, texts, counts), max_size=3).map(tuple)

messages = st.one_of(
    blocks(),
    layouts(),
    estimates(),
    diagrams(),
    posteriors(),
    pooled(),
    events(),
    _spanned(),
    st.builds(FoundationTruth, texts, times, numbers, numbers, numbers),
    st.builds(ScadaSample, texts, times, texts, *[conditions] * 6),
    st.builds(StreamEnd, texts, texts, texts, times, counts),
    _acknowledged(),
    st.builds(
        NodeStatus,
        *[texts, texts, times, texts, st.integers(-1, 2**62)],
        received=_counted,
        published=_counted,
        lost=counts,
        late=counts,
        duplicate=counts,
        busy_s=numbers,
        warnings=warnings,
        malformed=counts,
        recovered=counts,
        recorded=counts,
    ),
)
