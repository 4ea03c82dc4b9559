"""A farm for others: messages, JSON, Parquet."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.farm.farm import Farm, Interval, PooledTurbine
from pipeline.farm.own_changes import OwnChange
from pipeline.farm.settings import FarmError
from pipeline.messages import HALF_INTERVAL, ParameterSummary, PooledPosterior
from pipeline.state.posterior_json import MEDIAN_AND_INTERVAL, stiffness_summary
from pipeline.updating.prior import PARAMETER_NAMES
from sensors.json_values import Json, fields_of


def pooled_posterior(farm: Farm, turbine: PooledTurbine) -> PooledPosterior:
    """Return what is published of a turbine."""
    return PooledPosterior(
        turbine=turbine.turbine,
        window=turbine.window,
        time_ns=turbine.time_ns,
        n_turbines=len(farm.turbines),
        parameters=turbine.pooled,
        outlier_probability=turbine.outlier_probability,
        text=turbine.text,
    )


def farm_json(farm: Farm) -> Json:
    """Return everything but the draws; names are stable."""
    return {
        "turbines": [_turbine(each) for each in farm.turbines],
        "left_out": [{"turbine": e.turbine, "reason": e.reason} for e in farm.left_out],
        "centre": _springs(farm.centre),
        "spread": _intervals(farm.spread),
        "ess": farm.ess,
        "rhat": farm.rhat,
    }


def _turbine(turbine: PooledTurbine) -> Json:
    return {
        "turbine": turbine.turbine,
        "time_ns": turbine.time_ns,
        "windows": turbine.n_windows,
        "own": _springs(turbine.own),
        "pooled": _springs(turbine.pooled),
        "deviation": _intervals(turbine.deviations),
        "own_change": _own_change(turbine.own_change),
        **fields_of(turbine, "outlier_probability", "outlying", "text"),
    }


def _own_change(change: OwnChange | None) -> Json | None:
    """Of each spring as a share of what it was, with its 90 % interval; None without a change."""
    if change is None:
        return None
    reach = HALF_INTERVAL * change.stds
    columns = np.expm1(change.logs + np.outer([0, -1, 1], reach)).T.tolist()
    return {
        name: {"median": median, "p05": p05, "p95": p95}
        for name, (median, p05, p95) in zip(PARAMETER_NAMES, columns, strict=True)
    }


def _springs(springs: tuple[ParameterSummary, ...]) -> Json:
    summaries = {each.name: stiffness_summary(each) for each in springs}
    for summary in summaries.values():
        del summary["truth_ratio"]
    return summaries


def _intervals(intervals: Iterable[Interval]) -> Json:
    pairs = zip(PARAMETER_NAMES, intervals, strict=True)
    return {name: fields_of(each, *MEDIAN_AND_INTERVAL) for name, each in pairs}


def write_parquet(farm: Farm, path: Path) -> None:
    """One row a turbine and spring: k in its unit, alone and pooled; deviations as shares.

    Raises FarmError where the file cannot be written.
    """
    rows = [
        _row(turbine, number) for turbine in farm.turbines for number in range(len(PARAMETER_NAMES))
    ]
    table = pa.Table.from_pylist(rows)
    time = pa.timestamp("ns", tz="UTC")
    table = table.set_column(1, "time", table.column("time").cast(pa.int64()).cast(time))
    try:
        pq.write_table(table, path)
    except OSError as error:
        raise FarmError(f"cannot write {path}: {error.strerror or error}") from error


def _row(turbine: PooledTurbine, number: int) -> Json:
    own, pooled, off = turbine.own[number], turbine.pooled[number], turbine.deviations[number]
    return {
        "turbine": turbine.turbine,
        "time": turbine.time_ns,
        "windows": turbine.n_windows,
        "parameter": own.name,
        "unit": own.unit,
        "nominal": own.nominal,
        **{
            f"{whose}_{quantile}": getattr(values, quantile)
            for whose, values in (("own", own), ("pooled", pooled), ("deviation", off))
            for quantile in ("p05", "median", "p95")
        },
        "outlier_probability": turbine.outlier_probability,
    }
