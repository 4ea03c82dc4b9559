"""What a message must fulfil to be let in: checked once, at the codec, trusted afterwards.

Values that a measurement or an algorithm may produce pass, NaN and ∞ included; what would make a
receiver fail (a rate of zero, a time before 1970, arrays that do not fit together) does not.
"""

import math
from collections.abc import Callable
from typing import Any

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    FoundationTruth,
    Message,
    ModalEstimate,
    NodeStatus,
    ParameterSummary,
    PooledPosterior,
    RecordedUntil,
    StabilisationDiagram,
    StreamEnd,
    StreamGap,
    WindowRejected,
)
from pipeline.transport.errors import CodecError
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.scada import ScadaSample

LOWEST_SAMPLING_RATE = 1e-3  # [Hz]
HIGHEST_SAMPLING_RATE = 1e7  # [Hz]
LATEST_WIRE_NS = (
    2**62
)  # [ns since 1970], the year 2116: times and their differences fit into 64 bits
LATEST_SAMPLE_NS = (
    LATEST_WIRE_NS - 2**59
)  # 18 years before: windows and gaps end later than samples
LARGEST_CONDITION = 1e9  # of wind, power, water level and the like, in whatever unit
LEAST_WEIGHT = 1e-6  # hop / window duration [-]
SPRINGS = ("k11", "k22", "k12")  # of a pooled posterior, in this order
PARAMETERS = ("k11", "k22", "k12", "sigma")  # of a posterior, in this order
MOST_CHANNELS = 4096  # of one acquisition unit
HIGHEST_COUNT = 2**62  # of blocks or samples: 10⁹ years at 100 Hz, and sums fit into 64 bits


def check(message: Message) -> None:
    """Raise CodecError, in one sentence, where a message cannot be worked with."""
    _CHECKS[type(message)](message)


def _require(holds: bool, sentence: str) -> None:
    if not holds:
        raise CodecError(sentence)


def _check_time(field: str, time_ns: int) -> None:
    _require(
        0 <= time_ns < LATEST_WIRE_NS,
        f"{field} is {time_ns} ns; sensor times are 0 to {LATEST_WIRE_NS} ns",
    )


def _check_span(start_ns: int, end_ns: int) -> None:
    _check_time("start_ns", start_ns)
    _check_time("end_ns", end_ns)
    _require(start_ns <= end_ns, f"end_ns {end_ns} lies before start_ns {start_ns}")


def _check_count(field: str, count: int) -> None:
    _require(0 <= count < HIGHEST_COUNT, f"{field} is {count}; counts are 0 to {HIGHEST_COUNT}")


def _check_conditions(message: ModalEstimate | ScadaSample) -> None:
    for name in ("wind_speed", "rotor_speed", "yaw", "water_level", "pitch", "power"):
        value = getattr(message, name, math.nan)
        _require(
            math.isnan(value) or abs(value) <= LARGEST_CONDITION,
            f"{name} is {value}; it is unknown (NaN) or at most {LARGEST_CONDITION:g}",
        )


def _check_block(block: AccelerationBlock) -> None:
    _require(
        LOWEST_SAMPLING_RATE <= block.sampling_rate <= HIGHEST_SAMPLING_RATE,
        f"sampling_rate is {block.sampling_rate} Hz; a block has "
        f"{LOWEST_SAMPLING_RATE:g} to {HIGHEST_SAMPLING_RATE:g} Hz",
    )
    _require(block.samples.ndim == 2, f"samples have {block.samples.ndim} axes instead of 2")
    _require(block.samples.size > 0, f"samples have the shape {block.samples.shape}: none")
    _require(
        block.samples.shape[1] <= MOST_CHANNELS,
        f"samples have {block.samples.shape[1]} channels; a unit has 1 to {MOST_CHANNELS}",
    )
    _check_count("sequence", block.sequence)
    _check_count("first_sample", block.first_sample)
    end_ns = block.end_ns
    _check_span(block.start_ns, end_ns)
    _require(
        end_ns < LATEST_SAMPLE_NS,
        f"end_ns is {end_ns}; samples end before {LATEST_SAMPLE_NS} ns",
    )


def _check_layout(layout: SensorLayout) -> None:
    n_channels = len(layout.channels)
    _require(
        0 < n_channels <= MOST_CHANNELS,
        f"layout {layout.layout_id} has {n_channels} channels; a unit has 1 to {MOST_CHANNELS}",
    )
    for channel in layout.channels:
        _require(
            math.isfinite(channel.elevation) and math.isfinite(channel.corner_frequency),
            f"channel {channel.name}: elevation {channel.elevation} m, "
            f"corner frequency {channel.corner_frequency} Hz; both are finite",
        )


def _check_estimate(estimate: ModalEstimate) -> None:
    _check_span(estimate.start_ns, estimate.end_ns)
    _require(
        LEAST_WEIGHT <= estimate.weight <= 1.0,
        f"weight is {estimate.weight}; of a window, {LEAST_WEIGHT:g} to 1 is new",
    )
    _check_conditions(estimate)
    n_channels = len(estimate.channels)
    _require(n_channels > 0 or not estimate.modes, "modes without a channel that shows them")
    for mode in estimate.modes:
        factor = mode.covariance_factor
        _require(
            mode.shape.shape == (n_channels,),
            f"mode {mode.name!r}: shape {mode.shape.shape} for {n_channels} channels",
        )
        _require(
            factor.ndim == 2 and factor.shape[0] == 2 + n_channels,
            f"mode {mode.name!r}: covariance factor {factor.shape} for {n_channels} channels",
        )
        _require(
            0 <= mode.n_block_columns <= factor.shape[1],
            f"mode {mode.name!r}: {mode.n_block_columns} of {factor.shape[1]} columns are common",
        )


def _check_diagram(diagram: StabilisationDiagram) -> None:
    _check_span(diagram.start_ns, diagram.end_ns)
    n_poles = len(diagram.frequencies)
    for name in ("orders", "bands", "frequency_stds", "damping_ratios"):
        n_values = len(getattr(diagram, name))
        _require(n_values == n_poles, f"{n_values} {name} for {n_poles} poles")


def _check_parameter(parameter: ParameterSummary) -> None:
    nominal = parameter.nominal
    _require(
        math.isfinite(nominal) and nominal != 0.0,
        f"{parameter.name}: nominal is {nominal}; ratios need a finite value other than 0",
    )
    for value in (parameter.median, parameter.p05, parameter.p95):
        _require(
            math.isfinite(value) and math.isfinite(value / nominal),
            f"{parameter.name}: {value} of nominal {nominal} is no finite quantile",
        )


def _check_posterior(posterior: FoundationPosterior) -> None:
    _check_time("time_ns", posterior.time_ns)
    names = tuple(parameter.name for parameter in posterior.parameters)
    _require(names == PARAMETERS, f"parameters are {names} instead of {PARAMETERS}")
    for parameter in posterior.parameters:
        _check_parameter(parameter)
    for figure in posterior.figures:
        known = (figure.nominal, figure.median, figure.p05, figure.p95)
        _require(all(map(math.isfinite, known)), f"{figure.name}: {known} are no finite figures")
    n_labels = len(posterior.model_labels)
    _require(
        posterior.correlation.shape == (3, 3),
        f"correlation {posterior.correlation.shape} instead of (3, 3)",
    )
    _require(
        posterior.draws.ndim == 2 and posterior.draws.shape[1] == 4,
        f"draws {posterior.draws.shape} instead of (n_draws, 4)",
    )
    _require(
        posterior.model_frequencies.shape == (n_labels,)
        and posterior.model_shapes.ndim == 2
        and posterior.model_shapes.shape[0] == n_labels,
        f"model frequencies {posterior.model_frequencies.shape} and shapes "
        f"{posterior.model_shapes.shape} for {n_labels} labels",
    )


def _check_pooled(posterior: PooledPosterior) -> None:
    _check_time("time_ns", posterior.time_ns)
    _check_count("n_turbines", posterior.n_turbines)
    names = tuple(parameter.name for parameter in posterior.parameters)
    _require(names == SPRINGS, f"parameters are {names} instead of {SPRINGS}")
    for parameter in posterior.parameters:
        _check_parameter(parameter)


def _check_event(event: FoundationEvent) -> None:
    _check_time("time_ns", event.time_ns)
    _check_span(event.since_earliest_ns, event.since_latest_ns)
    _check_time("since_ns", event.since_ns)


def _check_gap(gap: StreamGap) -> None:
    _check_span(gap.start_ns, gap.end_ns)
    _check_count("first_sequence", gap.first_sequence)
    _check_count("n_blocks", gap.n_blocks)


def _check_end(end: StreamEnd) -> None:
    _check_time("time_ns", end.time_ns)
    _check_count("n_blocks", end.n_blocks)


def _check_recorded(recorded: RecordedUntil) -> None:
    _check_time("time_ns", recorded.time_ns)
    for each in recorded.ranges:
        _check_count("first", each.first)
        _check_count("end", each.end)
        _require(each.first < each.end, f"blocks {each.first} to {each.end} are no range")
        _check_span(each.earliest_ns, each.latest_ns)


def _check_rejected(rejected: WindowRejected) -> None:
    _check_span(rejected.start_ns, rejected.end_ns)


def _check_scada(sample: ScadaSample) -> None:
    _check_time("time_ns", sample.time_ns)
    _check_conditions(sample)


def _check_timed(message: FoundationTruth | NodeStatus) -> None:
    _check_time("time_ns", message.time_ns)


_CHECKS: dict[type, Callable[[Any], None]] = {
    AccelerationBlock: _check_block,
    SensorLayout: _check_layout,
    ModalEstimate: _check_estimate,
    StabilisationDiagram: _check_diagram,
    WindowRejected: _check_rejected,
    FoundationPosterior: _check_posterior,
    PooledPosterior: _check_pooled,
    FoundationEvent: _check_event,
    FoundationTruth: _check_timed,
    StreamGap: _check_gap,
    StreamEnd: _check_end,
    RecordedUntil: _check_recorded,
    NodeStatus: _check_timed,
    ScadaSample: _check_scada,
}
