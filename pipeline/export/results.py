"""Tables of the results, one per kind; times UTC, units in brackets.

`number` counts the modes of a window from 1: with turbine and window it names a mode in `modes`
and `mode_shapes`, also where a mode has no name yet.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from pipeline.export.table_file import TIMESTAMP
from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    FoundationTruth,
    Message,
    ModalEstimate,
    ParameterSummary,
    StreamGap,
    WindowRejected,
)
from pipeline.updating.prior import PARAMETER_NAMES, PARAMETER_UNITS
from sensors.acquisition.scada import ScadaSample

Row = tuple[Any, ...]

_TEXT, _WHOLE, _REAL, _YES = pa.string(), pa.int64(), pa.float64(), pa.bool_()
_WINDOW = (("turbine", _TEXT), ("window", _WHOLE))
_SPAN = (("start", TIMESTAMP), ("end", TIMESTAMP))


@dataclass(frozen=True, slots=True)
class ResultTable:
    """One table: its message type and how its rows are made."""

    name: str
    message: type
    columns: tuple[tuple[str, pa.DataType], ...]
    rows: Callable[[Any], Iterator[Row]]
    """Rows of one message."""

    @property
    def schema(self) -> pa.Schema:
        """Arrow schema of the table."""
        return pa.schema(list(self.columns))


def _modes(estimate: ModalEstimate) -> Iterator[Row]:
    for number, mode in enumerate(estimate.modes, start=1):
        yield (
            estimate.turbine, estimate.window, estimate.start_ns, estimate.end_ns, number,
            mode.name, mode.pair_id, mode.frequency, mode.frequency_std, mode.damping_ratio,
            mode.damping_ratio_std, mode.phase_collinearity, mode.presence, mode.quality,
            estimate.weight, estimate.operating_state, estimate.wind_speed, estimate.rotor_speed,
            estimate.yaw, estimate.water_level,
        )  # fmt: skip


def _mode_shapes(estimate: ModalEstimate) -> Iterator[Row]:
    for number, mode in enumerate(estimate.modes, start=1):
        rows = zip(estimate.channels, mode.shape.tolist(), mode.shape_std.tolist(), strict=True)
        for channel, component, std in rows:
            yield (estimate.turbine, estimate.window, number, mode.name, channel, component, std)


def _posterior(posterior: FoundationPosterior) -> Iterator[Row]:
    correlation = posterior.correlation
    yield (
        posterior.turbine, posterior.window, posterior.time_ns, posterior.n_windows,
        *(value for name in PARAMETER_NAMES for value in _spring(posterior.parameter(name))),
        *_spring(posterior.parameter("sigma"))[:3],
        *(float(correlation[i, j]) for i, j in ((0, 1), (0, 2), (1, 2))),
        posterior.sampler, posterior.ess, posterior.rhat, posterior.reduced_chi_square,
        posterior.paired_share, posterior.pairing_cost, posterior.change_probability,
        posterior.trusted,
        "; ".join(f"{warning.code}: {warning.text}" for warning in posterior.warnings),
    )  # fmt: skip


def _spring(spring: ParameterSummary) -> tuple[float, float, float, float]:
    return spring.median, spring.p05, spring.p95, spring.nominal


def _figures(posterior: FoundationPosterior) -> Iterator[Row]:
    for figure in posterior.figures:
        yield (
            posterior.turbine, posterior.window, posterior.time_ns, figure.name, figure.unit,
            figure.median, figure.p05, figure.p95, figure.contraction,
        )  # fmt: skip


def _relative(posterior: FoundationPosterior) -> Iterator[Row]:
    for each in posterior.relative:
        yield (
            posterior.turbine, posterior.window, posterior.time_ns, each.reference_ns, each.name,
            each.median, each.p05, each.p95,
        )  # fmt: skip


def _pairs(posterior: FoundationPosterior) -> Iterator[Row]:
    for pair in posterior.pairs:
        yield (
            posterior.turbine, posterior.window, pair.identified, pair.model, pair.frequency,
            pair.frequency_std, pair.model_frequency, pair.mac, pair.shape_used, pair.misfit,
            pair.information,
        )  # fmt: skip


def _events(event: FoundationEvent) -> Iterator[Row]:
    changes = {each.name: (each.median, each.p05, each.p95) for each in event.changes}
    unknown = (None, None, None)
    yield (
        event.turbine, event.window, event.time_ns, event.kind, event.probability, event.since_ns,
        event.since_earliest_ns, event.since_latest_ns,
        *(value for name in PARAMETER_NAMES for value in changes.get(name, unknown)),
        event.text,
    )  # fmt: skip


def _rejected(rejected: WindowRejected) -> Iterator[Row]:
    yield (
        rejected.turbine, rejected.window, rejected.start_ns, rejected.end_ns, rejected.code,
        rejected.reason,
    )  # fmt: skip


def _gaps(gap: StreamGap) -> Iterator[Row]:
    yield (
        gap.turbine, gap.unit, gap.session, gap.start_ns, gap.end_ns, gap.duration,
        gap.first_sequence, gap.n_blocks,
    )  # fmt: skip


def _scada(sample: ScadaSample) -> Iterator[Row]:
    yield (
        sample.turbine, sample.time_ns, sample.state, sample.wind_speed, sample.rotor_speed,
        sample.pitch, sample.yaw, sample.power, sample.water_level,
    )  # fmt: skip


def _truth(truth: FoundationTruth) -> Iterator[Row]:
    yield (truth.turbine, truth.time_ns, truth.k11, truth.k22, truth.k12)


def _real(*names: str) -> tuple[tuple[str, pa.DataType], ...]:
    return tuple((name, _REAL) for name in names)


_SPRINGS = tuple(zip(PARAMETER_NAMES, PARAMETER_UNITS, strict=True))

RESULT_TABLES = (
    ResultTable(
        "modes",
        ModalEstimate,
        (
            *_WINDOW, *_SPAN, ("number", _WHOLE), ("mode", _TEXT), ("pair_id", _TEXT),
            *_real(
                "frequency [Hz]", "frequency_std [Hz]", "damping_ratio [-]",
                "damping_ratio_std [-]", "phase_collinearity [-]", "presence [-]", "quality [-]",
                "weight [-]",
            ),
            ("operating_state", _TEXT),
            *_real("wind_speed [m/s]", "rotor_speed [rpm]", "yaw [deg]", "water_level [m]"),
        ),
        _modes,
    ),
    ResultTable(
        "mode_shapes",
        ModalEstimate,
        (*_WINDOW, ("number", _WHOLE), ("mode", _TEXT), ("channel", _TEXT),
         *_real("component [-]", "component_std [-]")),
        _mode_shapes,
    ),
    ResultTable(
        "posterior",
        FoundationPosterior,
        (
            *_WINDOW, ("time", TIMESTAMP), ("windows", _WHOLE),
            *_real(*(f"{name}_{what} [{unit}]" for name, unit in _SPRINGS
                     for what in ("median", "p05", "p95", "nominal"))),
            *_real("sigma_median [-]", "sigma_p05 [-]", "sigma_p95 [-]"),
            *_real("correlation_k11_k22 [-]", "correlation_k11_k12 [-]", "correlation_k22_k12 [-]"),
            ("sampler", _TEXT),
            *_real("ess [-]", "rhat [-]", "reduced_chi_square [-]", "paired_share [-]",
                   "pairing_cost [-]", "change_probability [-]"),
            ("trusted", _YES), ("doubts", _TEXT),
        ),
        _posterior,
    ),
    ResultTable(
        "figures",
        FoundationPosterior,
        (*_WINDOW, ("time", TIMESTAMP), ("figure", _TEXT), ("unit", _TEXT),
         *_real("median", "p05", "p95", "contraction [-]")),
        _figures,
    ),
    ResultTable(
        "relative",
        FoundationPosterior,
        (*_WINDOW, ("time", TIMESTAMP), ("reference", TIMESTAMP), ("spring", _TEXT),
         *_real("ratio_median [-]", "ratio_p05 [-]", "ratio_p95 [-]")),
        _relative,
    ),
    ResultTable(
        "pairs",
        FoundationPosterior,
        (*_WINDOW, ("identified", _TEXT), ("model", _TEXT),
         *_real("frequency [Hz]", "frequency_std [Hz]", "model_frequency [Hz]", "mac [-]"),
         ("shape_used", _YES), *_real("misfit [-]", "information [-]")),
        _pairs,
    ),
    ResultTable(
        "events",
        FoundationEvent,
        (*_WINDOW, ("time", TIMESTAMP), ("kind", _TEXT), ("probability [-]", _REAL),
         ("since", TIMESTAMP), ("since_earliest", TIMESTAMP), ("since_latest", TIMESTAMP),
         *_real(*(f"{name}_change_{what} [-]" for name in PARAMETER_NAMES
                  for what in ("median", "p05", "p95"))),
         ("text", _TEXT)),
        _events,
    ),
    ResultTable(
        "rejected",
        WindowRejected,
        (*_WINDOW, *_SPAN, ("code", _TEXT), ("reason", _TEXT)),
        _rejected,
    ),
    ResultTable(
        "gaps",
        StreamGap,
        (("turbine", _TEXT), ("unit", _TEXT), ("session", _TEXT), *_SPAN, ("duration [s]", _REAL),
         ("first_sequence", _WHOLE), ("blocks", _WHOLE)),
        _gaps,
    ),
    ResultTable(
        "scada",
        ScadaSample,
        (("turbine", _TEXT), ("time", TIMESTAMP), ("state", _TEXT),
         *_real("wind_speed [m/s]", "rotor_speed [rpm]", "pitch [deg]", "yaw [deg]", "power [W]",
                "water_level [m]")),
        _scada,
    ),
    ResultTable(
        "truth",
        FoundationTruth,
        (("turbine", _TEXT), ("time", TIMESTAMP),
         *_real(*(f"{name} [{unit}]" for name, unit in _SPRINGS))),
        _truth,
    ),
)  # fmt: skip


def table_of_rows(rows: Sequence[Row], schema: pa.Schema) -> pa.Table:
    """Rows of values in the order of the columns as an Arrow table."""
    columns = zip(*rows, strict=True)
    arrays = [pa.array(each, field.type) for each, field in zip(columns, schema, strict=True)]
    return pa.Table.from_arrays(arrays, schema=schema)


def tables_of(message: Message) -> tuple[ResultTable, ...]:
    """Return the tables in which a message has rows."""
    return tuple(table for table in RESULT_TABLES if type(message) is table.message)
