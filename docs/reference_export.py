"""Write the reference page of an export: every file with its columns.

Run by mkdocs (plugin gen-files) at every build, so that the page cannot fall behind the code.
"""

import re

from pipeline.export.results import RESULT_TABLES

INTRODUCTION = """`pilewatch export out --csv -o tables`, or `--parquet`, writes a file of each kind that the
recording or the session's folder has; a kind without rows has no file.

- **CSV**: a header row, then UTF-8 text with commas. Times are `2026-01-01 00:10:00.000000000Z`, in
  UTC; truth values `true` and `false`. What is not known is an empty cell or `nan`. A text that a spreadsheet may take for a formula
  has a `'` in front.
- **Parquet**: the same columns under the same names, times as timestamps of nanoseconds in UTC, with
  types of their own. `reprocess` writes the same tables in folders by turbine and month.

The names below are those in the file, unit included: `table["k22_p05 [N·m/rad]"]`. A window is
named by `turbine` and `window`.

## samples-TURBINE-UNIT.csv, samples-TURBINE-UNIT.parquet

A row a sample, a file for each acquisition unit; a unit whose channels change has another,
`samples-TURBINE-UNIT-2`, from there on. Samples that are missing are missing rows.

| column | unit | meaning |
|---|---|---|
| `time [s]` (CSV), `time` (Parquet) | s | CSV: seconds since 1970-01-01 UTC; Parquet: a timestamp |
| `NAME [m/s²]`, `NAME [g]`, … | in its name | Readings of a channel, by its name in the layout; `ch1 [m/s²]`, `ch2 [m/s²]`, … where the layout is not known. |
"""  # noqa: E501 - rows of tables

# Rows of a table: file → what a row is.
ROWS = {
    "modes": "A row an identified mode and window.",
    "mode_shapes": "A row an identified mode, window and channel.",
    "posterior": "A row a window that has a posterior, of the windows since the last event.",
    "figures": (
        "A row an uncertain parameter of the structure or of a sensor and window; none where the "
        "structure is exact."
    ),
    "relative": (
        "A row a spring and window: over what it was before the last event, or in the reference "
        "period. After an event this is its size, revised with each window."
    ),
    "pairs": "A row an identified mode that has a model mode, and window.",
    "events": (
        "A row an [event](../theory.md#events), with its size as it was first reported; "
        "`relative` has what the windows since make of it."
    ),
    "rejected": "A row a window that was rejected, by the identification or by the updating.",
    "gaps": "A row a gap in the blocks of a unit.",
    "scada": "A row a SCADA sample.",
    "truth": "A row a time from which other springs hold; of simulations only.",
}
# Columns, without units: what they have, in all files or in one ("file.column").
COLUMNS = {
    "turbine": "Turbine id.",
    "unit": "Acquisition unit id.",
    "session": "Session id of the unit's stream: one per start of the unit.",
    "window": "Windows since the session's start, rejected ones counted, from 0.",
    "start": "Begin of the window.",
    "end": "End of the window.",
    "time": "End of the window.",
    "number": (
        "Number of the mode in its window, from 1. With `turbine` and `window` it names a mode in "
        "`modes` and `mode_shapes`."
    ),
    "mode": "Name that the mode keeps from window to window; empty while it has none.",
    "pair_id": "Two modes that cannot be separated share one; else empty.",
    "frequency": "Undamped natural frequency.",
    "frequency_std": "Its standard deviation.",
    "damping_ratio": "Share of critical damping.",
    "damping_ratio_std": "Its standard deviation.",
    "phase_collinearity": "MPC of the complex shape; 1: all channels in phase.",
    "presence": "Share of the model orders in which the mode was stable.",
    "quality": "0 (doubtful) to 1 (sure).",
    "weight": "Hop over window length: how much of the window is new.",
    "operating_state": "State of the whole window by SCADA; empty: not known.",
    "wind_speed": "At the hub; of a window its mean by SCADA.",
    "rotor_speed": "Of the rotor; of a window its mean by SCADA.",
    "yaw": "Of the nacelle, from the tower's x axis towards y; of a window its mean by SCADA.",
    "water_level": "Above the mean water level; of a window its mean by SCADA.",
    "channel": "Name of the channel.",
    "component": "Component of the shape; the largest of a mode is 1.",
    "component_std": "Its standard deviation; 0 of the largest one, which is 1 by definition.",
    "windows": "Number of windows that entered since the last event.",
    "k_median": "Median of the spring.",
    "k_p05": "5 % quantile: lower end of the 90 % interval.",
    "k_p95": "95 % quantile: upper end of the 90 % interval.",
    "k_nominal": "The description's value.",
    "sigma_median": "Median of σ, the relative discrepancy between model and truth.",
    "sigma_p05": "5 % quantile of σ.",
    "sigma_p95": "95 % quantile of σ.",
    "correlation_k11_k22": "Correlation of the two springs in the posterior.",
    "correlation_k11_k12": "Likewise.",
    "correlation_k22_k12": "Likewise.",
    "sampler": "`laplace`, `importance`, `emcee`, …",
    "ess": "Smallest effective number of draws over the parameters.",
    "rhat": "Largest split-R̂ over the parameters; `nan` with `laplace`.",
    "reduced_chi_square": "Of the paired frequencies at σ = 0.",
    "paired_share": "Share of the identified modes that have a model mode.",
    "pairing_cost": "Mean pairing cost of an identified mode.",
    "change_probability": "Probability that the modes have changed since the last event.",
    "trusted": (
        "Whether no check contradicts the posterior "
        "([the checks](../theory.md#when-a-posterior-is-not-to-be-trusted))."
    ),
    "doubts": "Its warnings, `code: text`, apart by `; `; empty: none.",
    "figure": "Key of the parameter, such as `steel_modulus`; of a sensor `gain NAME` or alike.",
    "figures.unit": "Unit of the parameter, and of the next three columns.",
    "median": "Median [in `unit`].",
    "p05": "5 % quantile [in `unit`].",
    "p95": "95 % quantile [in `unit`].",
    "contraction": "1 − width of the interval over the prior's; 0: nothing was learned.",
    "reference": "End of what the spring is compared with.",
    "spring": "`k11`, `k22` or `k12`.",
    "ratio_median": "Median of the ratio; 1: unchanged.",
    "ratio_p05": "Its 5 % quantile.",
    "ratio_p95": "Its 95 % quantile.",
    "identified": (
        "Name of the identified mode, as `mode` of `modes`; `m1+m2`: the mean of two that cannot "
        "be separated."
    ),
    "model": "Label of the model mode.",
    "pairs.frequency": "Identified frequency.",
    "model_frequency": "The model's, at the median of the posterior.",
    "mac": "Modal assurance criterion of the two shapes.",
    "shape_used": "Whether the shape entered the likelihood; false: the frequency alone.",
    "misfit": "Of the frequency, in standard deviations of the posterior's prediction.",
    "information": "The mode's share of what all modes tell of the springs.",
    "events.time": "End of the window in which the event was noticed.",
    "kind": "`foundation`, `modal-drift` or `undecided`.",
    "probability": "Probability that there was a change at all.",
    "since": "Start of the first window after the change, most probably.",
    "since_earliest": "Its 5 % quantile.",
    "since_latest": "Its 95 % quantile.",
    "k_change_median": "Change of the spring, a share of what it was; empty of a modal drift.",
    "k_change_p05": "Its 5 % quantile.",
    "k_change_p95": "Its 95 % quantile.",
    "text": "One sentence.",
    "code": "[Code](warnings.md) of the reason.",
    "reason": "The reason, in words.",
    "gaps.start": "Where the missing samples begin.",
    "gaps.end": "Where samples go on.",
    "duration": "From `start` to `end`.",
    "first_sequence": "Number of the first missing block.",
    "blocks": "Number of missing blocks.",
    "scada.time": "Time of the sample.",
    "state": "`parked`, `idling`, `start`, `operating` or `stop`; empty: not known.",
    "pitch": "Of the blades; 90 is feathered.",
    "power": "Electrical power.",
    "truth.time": "From when it holds.",
    "k": "True spring.",
}
SPRING = re.compile(r"^k(?:11|22|12)(?=_|$)")
TIMES = "UTC"  # in place of a unit


def column_parts(title: str) -> tuple[str, str]:
    """A column's name and its unit; "" where it has none."""
    name, _, unit = title.partition(" [")
    return name, unit.removesuffix("]")


def column_meaning(table: str, name: str) -> str:
    """What a column of an export has; KeyError where that is not written yet."""
    of_table, of_any = f"{table}.{name}", SPRING.sub("k", name)
    return COLUMNS[of_table if of_table in COLUMNS else of_any]


def tables() -> str:
    """Every file of an export with its columns, as they stand in the file."""
    lines = []
    for table in RESULT_TABLES:
        lines += [f"## {table.name}.csv, {table.name}.parquet", "", ROWS[table.name], ""]
        lines += ["| column | unit | meaning |", "|---|---|---|"]
        for field in table.schema:
            name, unit = column_parts(field.name)
            shown = unit or (TIMES if str(field.type).startswith("timestamp") else "")
            lines.append(f"| `{field.name}` | {shown} | {column_meaning(table.name, name)} |")
        lines.append("")
    return "\n".join(lines)


IMU = """## imu.mcap

`pilewatch export out --imu -o tables` writes the samples alone, for Foxglove, PlotJuggler and RViz:
topic `/TURBINE/UNIT/z145/imu` of each height, one message `sensor_msgs/msg/Imu` of ROS 2 (CDR) a
sample. `linear_acceleration` has x fore-aft, y side-side, z up [m/s²]; an axis that no sensor
measures is NaN.
"""


def page() -> str:
    """Text of the page."""
    return f"# Files of an export\n\n{INTRODUCTION}\n{tables()}\n{IMU}"


def write_page() -> None:
    """Write it as mkdocs' plugin takes it."""
    import mkdocs_gen_files

    with mkdocs_gen_files.open("reference/export.md", "w") as file:
        file.write(page())


if __name__ == "<run_path>":  # by the plugin, not by a test
    write_page()
