"""What a manager reads: is the foundation known, has it changed, can the data be relied on."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    ParameterSummary,
    StiffnessChange,
    WindowRejected,
)
from pipeline.report.recorded_session import TurbineRecord
from pipeline.report.wording import counted, instant, joined, percent, period, span
from pipeline.updating.prior import PARAMETER_NAMES
from sensors.acquisition.blocks import NANOSECONDS

SPRINGS = {
    "k11": "the foundation's lateral stiffness",
    "k22": "its rotational stiffness",
    "k12": "the coupling of both",
}


def headline(record: TurbineRecord) -> str:
    """The one sentence that says how the foundation is."""
    posterior = record.summary.posterior
    if posterior is None:
        return f"Nothing is known of the foundation's stiffness: {_why_no_posterior(record)}."
    if not posterior.trusted:
        return "Do not use these stiffnesses: the data contradict the model."
    found = [event for event in record.summary.events if event.kind == "foundation"]
    if found:
        return "The foundation has changed; its stiffness since then is known."
    if record.summary.events:
        return "The foundation's stiffness is known, but the structure's modes have changed."
    return "The foundation's stiffness is known, and no change was found."


def condition(record: TurbineRecord) -> str:
    """ "good", "doubt", "bad" or "unknown": how much of the foundation can be relied on."""
    posterior = record.summary.posterior
    if posterior is None:
        return "unknown"
    if not posterior.trusted:
        return "bad"
    return "doubt" if record.summary.events else "good"


def findings(record: TurbineRecord) -> list[str]:
    """Changes first, then what is known of each spring, then how far the data go."""
    return [*changes(record), *stiffnesses(record), *measuring(record)]


def distrust(posterior: FoundationPosterior | None) -> list[str]:
    """Why the posterior must not be used, in the updating's own words; empty where it may be."""
    if posterior is None or posterior.trusted:
        return []
    return [sentence(doubt.text) for doubt in posterior.warnings]


def changes(record: TurbineRecord) -> list[str]:
    """One sentence for each event."""
    return [
        f"{event_sentence(event)}{_before_and_since(record, event)}"
        for event in record.summary.events
    ]


def event_sentence(event: FoundationEvent) -> str:
    """ "k22 fell by 9.0 % [6.0, 12] on 3 March 2026 between 14:10 and 14:30 UTC"."""
    when = period(event.since_earliest_ns, event.since_latest_ns)
    if event.kind == "foundation" and event.changes:
        surest = max(event.changes, key=_sureness)
        others = [_change(each) for each in event.changes if each is not surest]
        rest = f"; {', '.join(others)}" if others else ""
        return f"{_change(surest)} {when}{rest}."
    cause = (
        "in a way that no foundation explains"
        if event.kind == "modal-drift"
        else "perhaps by the foundation: that is undecided"
    )
    return f"The structure's modes changed {when}, {cause}{_most_shifted(event)}."


def _before_and_since(record: TurbineRecord, event: FoundationEvent) -> str:
    """Which springs a change that is not called the foundation's has nevertheless moved: those
    whose intervals before and since have nothing in common."""
    before = [time for time in record.posteriors if time <= event.since_ns]
    next_ns = min(
        (each.since_ns for each in record.summary.events if each.since_ns > event.since_ns),
        default=math.inf,
    )
    since = [time for time in record.posteriors if event.since_ns < time <= next_ns]
    if event.kind == "foundation" or not before or not since:
        return ""
    old, new = record.posteriors[max(before)], record.posteriors[max(since)]
    moved = [
        f"{name} from {ratios(old.parameter(name))[0]:.3f} to {ratios(new.parameter(name))[0]:.3f}"
        for name in PARAMETER_NAMES
        if _apart(old.parameter(name), new.parameter(name))
    ]
    return f" With it the stiffness went, ÷ nominal: {joined(moved)}." if moved else ""


def _apart(one: ParameterSummary, other: ParameterSummary) -> bool:
    return one.p95 < other.p05 or other.p95 < one.p05


def _sureness(change: StiffnessChange) -> float:
    width = change.p95 - change.p05
    return abs(change.median) / width if width > 0 else float("inf")


def _change(change: StiffnessChange) -> str:
    if change.p05 <= 0 <= change.p95:
        return (
            f"{change.name} stayed within what can be told "
            f"({100 * change.p05:+.1f} to {100 * change.p95:+.1f} %)"
        )
    low, high = sorted((abs(change.p05), abs(change.p95)))
    verb = "fell" if change.median < 0 else "rose"
    return f"{change.name} {verb} by {percent(change.median)} [{percent(low)}, {percent(high)}]"


def _most_shifted(event: FoundationEvent) -> str:
    if not event.shifts:
        return ""
    most = max(event.shifts, key=lambda shift: abs(shift.change) / max(shift.change_std, 1e-12))
    direction = "down" if most.change < 0 else "up"
    return (
        f"; surest of all the one at {most.frequency:.4g} Hz, {direction} by "
        f"{percent(most.change)} ± {percent(most.change_std)}"
    )


def stiffnesses(record: TurbineRecord) -> list[str]:
    """One sentence for each spring."""
    posterior = record.summary.posterior
    if posterior is None:
        return []
    return [_stiffness(record, posterior.parameter(name)) for name in PARAMETER_NAMES]


def _stiffness(record: TurbineRecord, spring: ParameterSummary) -> str:
    median, low, high = ratios(spring)
    text = (
        f"{spring.name}, {SPRINGS[spring.name]}, is known to "
        f"±{percent((high - low) / 2 / median)}: {median:.3f} × its nominal value, 90 % sure "
        f"between {low:.3f} and {high:.3f}"
    )
    truth = record.summary.truth
    if truth is None:
        return f"{text}."
    true = getattr(truth, spring.name) / spring.nominal
    inside = "inside" if low <= true <= high else "outside"
    return f"{text}. The simulated truth, {true:.3f}, lies {inside}."


def ratios(spring: ParameterSummary) -> tuple[float, float, float]:
    """Median, 5 % and 95 % quantile over nominal [-]; a negative nominal does not turn them."""
    low, high = sorted((spring.p05 / spring.nominal, spring.p95 / spring.nominal))
    return spring.median / spring.nominal, low, high


def measuring(record: TurbineRecord) -> list[str]:
    """How much was measured, how much of it could be used, what is missing."""
    return [_measured(record), *_not_used(record), _missing(record)]


def _measured(record: TurbineRecord) -> str:
    summary, (start_ns, end_ns) = record.summary, record.span_ns
    windows = counted(len(summary.estimates), "window")
    measured = span((end_ns - start_ns) / NANOSECONDS)
    return (
        f"{measured} of measurements, from {instant(start_ns)} to {instant(end_ns)}, gave "
        f"{windows} with {counted(len(summary.modes), 'mode')} in all."
    )


def _not_used(record: TurbineRecord) -> Iterator[str]:
    identified = {estimate.start_ns for estimate in record.summary.estimates}
    kept_back = [each for each in record.summary.rejected if each.start_ns in identified]
    failed = [each for each in record.summary.rejected if each.start_ns not in identified]
    if failed:
        yield f"{counted(len(failed), 'window')} could not be identified: {_codes(failed)}."
    if kept_back:
        number = counted(len(kept_back), "identified window")
        yield f"{number} did not enter the stiffness: {_codes(kept_back)}."


def _codes(rejected: Sequence[WindowRejected]) -> str:
    counts = Counter(each.code for each in rejected)
    return joined([f"{count} × {code}" for code, count in counts.most_common()])


def _missing(record: TurbineRecord) -> str:
    if not record.summary.published:
        return "The samples themselves are no longer here, only what was made of them."
    stream = record.summary.as_json(wall=0.0)["stream"]
    if not stream["gaps"] and not stream["lost"]:
        return "No sample is missing."
    return (
        f"{counted(stream['gaps'], 'gap')} in the stream, {span(stream['gap_s'])} in all; "
        f"{counted(stream['lost'], 'block')} lost."
    )


def _why_no_posterior(record: TurbineRecord) -> str:
    if record.summary.estimates:
        return "no identified window could be used"
    return "no window could be identified" if record.summary.rejected else "no window was complete"


def sentence(text: str) -> str:
    """With a capital letter and a full stop."""
    return text[:1].upper() + text[1:] + ("" if text.endswith((".", "!", "?")) else ".")
