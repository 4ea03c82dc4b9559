"""Tables of a report: springs, modes, changes, rejected windows, warnings."""

from collections.abc import Sequence

from pipeline.messages import FoundationEvent, ParameterSummary, RefusedMode, WindowRejected
from pipeline.report.figures import heights_known
from pipeline.report.html import TextTable
from pipeline.report.pictures.samples import FLAT_SHARE, ChannelStatistics
from pipeline.report.recorded_session import TurbineRecord
from pipeline.report.sentences import headline
from pipeline.report.wording import percent, span, stamp
from pipeline.state.phrases import figure_name, figures_named
from pipeline.state.posterior_json import plus_minus, ratios
from pipeline.state.run_modes import CombinedMode
from pipeline.updating.prior import PARAMETER_NAMES
from sensors.acquisition.blocks import NANOSECONDS

NEGLIGIBLE = 1e-3  # of an interval: an end that close to 0 is 0 [-]
MOST_ROWS = 60  # of windows, gaps or warnings; of more, the newest


def springs_table(record: TurbineRecord) -> TextTable:
    """Median and 90 % interval of each spring, over nominal and in its unit, and of σ."""
    posterior, truth = record.state.posterior, record.state.truth
    assert posterior is not None
    rows: list[tuple[str, ...]] = []
    for name in PARAMETER_NAMES:
        spring = posterior.parameter(name)
        median, low, high = ratios(spring)
        true = None if truth is None else getattr(truth, name) / spring.nominal
        rows.append(
            (
                name,
                f"{median:.4f}",
                f"{low:.4f} to {high:.4f}",
                "" if true is None else f"{true:.4f}",
                f"{spring.median:.3e}",
                spring.unit,
                _narrowed(spring),
            )
        )
    sigma = posterior.parameter("sigma")
    rows.append(
        ("σ", "", f"below {sigma.p95:.1e} (95 %)", "", f"{sigma.median:.1e}", "-",
         _narrowed(sigma))
    )  # fmt: skip
    head = (
        "", "÷ nominal", "90 % interval", "truth", "median", "unit",
        "narrowed by [%]",
    )  # fmt: skip
    title = "Springs of the foundation at the mudline"
    return without_blank_columns(TextTable(title, head, tuple(rows)))


def figures_table(record: TurbineRecord) -> TextTable:
    """Median and 90 % interval of each figure of the structure and its sensors."""
    posterior = record.state.posterior
    assert posterior is not None
    rows = tuple(
        (figure_name(each.name), f"{each.median:.4g}", _interval(each), each.unit, _narrowed(each))
        for each in posterior.figures
    )  # fmt: skip
    head = ("", "median", "90 % interval", "unit", "narrowed by [%]")
    return TextTable("Figures of the structure and its sensors", head, rows)


def _interval(each: ParameterSummary) -> str:
    """Return "0 to 0.1508": an end that is nothing beside the other is 0."""
    least = NEGLIGIBLE * (each.p95 - each.p05)
    low, high = (0.0 if abs(end) < least else end for end in (each.p05, each.p95))
    return f"{low:.4g} to {high:.4g}"


def _narrowed(each: ParameterSummary) -> str:
    """Return by how much the prior's interval was narrowed [%]; 0 where a rough model widens it."""
    return figure(100 * max(each.contraction, 0.0), ".1f")


def percent_or_blank(share: float) -> str:
    """Return "98 %"; blank where it is not known."""
    return percent(share) if share == share else ""


def without_blank_columns(content: TextTable) -> TextTable:
    """Return the table without the columns without a value in any row."""
    kept = [i for i in range(len(content.head)) if any(row[i] for row in content.rows)]
    return TextTable(
        content.title,
        tuple(content.head[i] for i in kept),
        tuple(tuple(row[i] for i in kept) for row in content.rows),
        tuple(kept.index(i) for i in content.words if i in kept),
    )


def modes_table(record: TurbineRecord) -> TextTable:
    """Return the identified modes over all windows, beside the paired modes of the model."""
    head = (
        "mode", "f [Hz]", "± std", "ζ [%]", "± std", "windows", "model f [Hz]", "MAC", "misfit",
        "information",
    )  # fmt: skip
    rows = tuple(_mode_row(mode) for mode in record.state.modes)
    return without_blank_columns(TextTable("", head, rows))


def _mode_row(mode: CombinedMode) -> tuple[str, ...]:
    pair = mode.pair
    measured = (
        mode.name + (" ≈" if mode.pair_id else ""),
        f"{mode.frequency:.4f}",
        figure(mode.frequency_std, ".4f"),
        f"{100 * mode.damping_ratio:.2f}",
        figure(100 * mode.damping_ratio_std, ".2f"),
        str(mode.seen_in_windows),
    )
    if pair is None:
        return (*measured, "", "", "", "")
    return (
        *measured,
        figure(pair.model_frequency, ".4f"),
        figure(pair.mac, ".3f") + ("" if pair.shape_used else " –"),
        figure(pair.misfit, "+.1f"),
        percent_or_blank(pair.information),
    )


def refused_modes_table(refused: Sequence[RefusedMode]) -> TextTable:
    """Return what looked like a mode in the last identified window, each with its reason."""
    rows = tuple(
        (f"{each.frequency:.4f}", f"{100 * each.damping_ratio:.2f}", each.text)
        for each in refused[:MOST_ROWS]
    )
    title = "Not reported as modes, in the last identified window"
    return TextTable(title, ("f [Hz]", "ζ [%]", "reason"), rows, words=(2,))


def figure(value: float, form: str) -> str:
    """Return a number; blank where it is not known."""
    return format(value, form) if value == value else ""


def events_table(events: Sequence[FoundationEvent]) -> TextTable:
    """Return every change: start, detection, probability."""
    rows = tuple(
        (stamp(event.since_ns), stamp(event.time_ns), event.kind, f"{event.probability:.3f}")
        for event in events
    )
    return TextTable("", ("start, about (UTC)", "detected (UTC)", "kind", "probability"), rows)


def channels_table(record: TurbineRecord) -> TextTable:
    """Return every channel: where it is, how much it moved, what is missing, what is noticed."""
    rows = []
    for unit, layout in sorted(record.state.layouts.items()):
        recorded = record.signals.samples.get(unit)
        statistics = recorded.statistics() if recorded is not None else ()
        if len(statistics) != len(layout.channels):
            continue
        typical = max((each.deviation for each in statistics if each.deviation > 0), default=0.0)
        for channel, each in zip(layout.channels, statistics, strict=True):
            rows.append(
                (
                    channel.name,
                    f"{channel.elevation:g}" if heights_known(layout) else "",
                    ", ".join(f"{value:.2g}" for value in channel.direction),
                    figure(each.deviation, ".3g"),
                    figure(each.largest, ".3g"),
                    f"{100 * each.missing:.2g}",
                    _remark(each, typical),
                )
            )
    units = {
        channel.unit for layout in record.state.layouts.values() for channel in layout.channels
    }
    unit = units.pop() if len(units) == 1 else ""
    measured = f"[{unit}]" if unit else "(unscaled)"
    head = (
        "channel", "height [m]", "direction x, y, z", f"std {measured}", f"largest {measured}",
        "not a number [%]", "remark",
    )  # fmt: skip
    return without_blank_columns(TextTable("Channels", head, tuple(rows), words=(6,)))


def _remark(statistics: ChannelStatistics, typical: float) -> str:
    """Return what a channel's statistics show by themselves; warnings of windows stand below."""
    if statistics.missing >= 1.0:
        return "no sample"
    if statistics.deviation <= FLAT_SHARE * typical:
        return "constant: measures nothing"
    return ""


def rejected_table(rejected: Sequence[WindowRejected]) -> TextTable:
    """Return the rejected windows, newest last."""
    rows = tuple(
        (stamp(each.start_ns), span((each.end_ns - each.start_ns) / NANOSECONDS), each.code,
         each.reason)
        for each in rejected[-MOST_ROWS:]
    )  # fmt: skip
    title = "Rejected windows" + _left_out(len(rejected))
    return TextTable(title, ("start (UTC)", "length", "code", "reason"), rows, words=(3,))


def gaps_table(record: TurbineRecord) -> TextTable:
    """Return the gaps, newest last."""
    gaps = record.state.gaps
    rows = tuple(
        (stamp(gap.start_ns), span(gap.duration), gap.unit,
         str(gap.n_blocks))
        for gap in gaps[-MOST_ROWS:]
    )  # fmt: skip
    title = "Gaps in the stream" + _left_out(len(gaps))
    return TextTable(title, ("start (UTC)", "length", "unit", "blocks"), rows)


def warnings_table(record: TurbineRecord) -> TextTable:
    """Return every warning of a window, the posterior or a node, once."""
    warnings = record.state.warnings
    rows = tuple((warning.code, figures_named(warning.text)) for warning in warnings[:MOST_ROWS])
    left = len(warnings) - len(rows)
    title = "Warnings" + (f" (the first {MOST_ROWS} of {len(warnings)})" if left else "")
    return TextTable(title, ("code", "text"), rows, words=(1,))


def nodes_table(record: TurbineRecord) -> TextTable:
    """Return the last status of every node."""
    rows = tuple(
        (name, status.state, str(status.lost), str(status.late), str(status.duplicate),
         str(status.malformed), f"{status.busy_s:.1f}")
        for name, status in sorted(record.state.statuses.items())
    )  # fmt: skip
    head = ("node", "last state", "lost", "late", "duplicate", "malformed", "busy [s]")
    return TextTable("Last status of the nodes", head, rows)


def overview_table(records: Sequence[TurbineRecord]) -> TextTable:
    """Return one row per turbine: the state of its foundation."""
    head = (
        "turbine", "k11 ÷ nominal", "k22 ÷ nominal", "k12 ÷ nominal", "windows", "changes",
        "verdict",
    )  # fmt: skip
    return TextTable("", head, tuple(_overview_row(record) for record in records), words=(6,))


def _overview_row(record: TurbineRecord) -> tuple[str, ...]:
    posterior = record.state.posterior
    springs = ["unknown"] * len(PARAMETER_NAMES)
    if posterior is not None:
        springs = [plus_minus(posterior.parameter(name)) for name in PARAMETER_NAMES]
    windows, changes = len(record.state.estimates), len(record.state.events)
    return (record.turbine, *springs, str(windows), str(changes), headline(record))


def _left_out(number: int) -> str:
    return f" (the last {MOST_ROWS} of {number})" if number > MOST_ROWS else ""
