"""Sentences of a report: is the foundation known, has it changed, are the data reliable."""

import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    ParameterSummary,
    StiffnessChange,
    WindowRejected,
)
from pipeline.report.recorded_session import TurbineRecord
from pipeline.report.wording import between_instants, join_with_and, percent, period, span
from pipeline.state.phrases import WHAT_TO_DO, count_noun, figures_named
from pipeline.state.posterior_json import ROUGH, ratios, widest_half_width
from pipeline.state.turbine_state import TurbineState
from pipeline.updating.prior import PARAMETER_NAMES
from sensors.acquisition.blocks import NANOSECONDS

NAME_WITH_NUMBER = re.compile(r"[a-z]+\d")  # k22, m3, z145-fa
SPRING_TEXTS = {
    "k11": "the foundation's lateral stiffness",
    "k22": "its rotational stiffness",
    "k12": "the coupling of both",
}


def headline(record: TurbineRecord) -> str:
    """Return the headline: one sentence on the state of the foundation."""
    posterior = record.state.posterior
    if not record.has_structure:
        return _modes_headline(record)
    if posterior is None:
        return f"The foundation's stiffness is not known: {_why_no_posterior(record)}."
    if not posterior.trusted:
        return "Do not use these stiffnesses: the data contradict the model."
    found = [event for event in record.state.events if event.kind == "foundation"]
    known = _how_well(posterior)
    if found:
        return f"The foundation has changed; its stiffness since then {known}."
    if record.state.events:
        return f"The foundation's stiffness {known}, but the structure's modes have changed."
    return f"The foundation's stiffness {known}, and no change was found."


def _how_well(posterior: FoundationPosterior) -> str:
    """Return "is known", or to what where that is little."""
    widest = widest_half_width(posterior)
    return "is known" if widest < ROUGH else f"is known only to ±{percent(widest)}"


def condition(record: TurbineRecord) -> str:
    """Return whether the posterior is reliable: `good`, `doubt`, `bad` or `unknown`."""
    posterior = record.state.posterior
    if not record.has_structure:
        return "good" if record.state.estimates else "unknown"
    if posterior is None:
        return "unknown"
    if not posterior.trusted:
        return "bad"
    return "doubt" if record.state.events else "good"


def findings(record: TurbineRecord) -> list[str]:
    """Return sentences on changes, then on each spring, then on the measurements."""
    return [*change_sentences(record), *stiffness_sentences(record), *measurement_sentences(record)]


def reasons_for_distrust(posterior: FoundationPosterior | None) -> list[str]:
    """Return why the posterior must not be used; empty where it may be."""
    if posterior is None or posterior.trusted:
        return []
    reasons = [sentence(figures_named(warning.text)) for warning in posterior.warnings]
    return [*reasons, sentence(WHAT_TO_DO)]


def change_sentences(record: TurbineRecord) -> list[str]:
    """Return one sentence for each event."""
    return [
        f"{_event_with_revised_size(record.state, event)}"
        f"{_stiffness_before_and_after(record, event)}"
        for event in record.state.events
    ]


def revised_sentence(state: TurbineState, event: FoundationEvent) -> str:
    """Return what the windows since an event make of its size; "" where they say no more."""
    found = state.revised_size(event)
    return "" if found is None or event.kind == "modal-drift" else f" {found.text}"


def _event_with_revised_size(state: TurbineState, event: FoundationEvent) -> str:
    """Return the event with its size by all posteriors since, and then what was reported first."""
    found = state.revised_size(event)
    if found is None or event.kind != "foundation" or not event.changes:
        return f"{event_sentence(event)}{revised_sentence(state, event)}"
    ratios_now = {each.name: each for each in found.springs}
    revised = [
        replace(each, median=now.median - 1, p05=now.p05 - 1, p95=now.p95 - 1)
        for each in event.changes
        if (now := ratios_now.get(each.name)) is not None
    ]
    if len(revised) < len(event.changes):
        return f"{event_sentence(event)}{revised_sentence(state, event)}"
    first = _change(max(event.changes, key=_relative_precision))
    return (
        f"{event_sentence(replace(event, changes=tuple(revised)))} This is by "
        f"{count_noun(found.n_posteriors, 'posterior')} since; as first reported, {first}."
    )


def event_sentence(event: FoundationEvent) -> str:
    """Return "k22 fell by 9.0 % [6.0, 12] on 3 March 2026 between 14:10 and 14:30 UTC"."""
    when = period(event.since_earliest_ns, event.since_latest_ns)
    if event.kind == "foundation" and event.changes:
        most_certain = max(event.changes, key=_relative_precision)
        others = [_change(each) for each in event.changes if each is not most_certain]
        rest = f"; {', '.join(others)}" if others else ""
        return f"{_change(most_certain)} {when}{rest}."
    cause = (
        "in a way that no foundation explains"
        if event.kind == "modal-drift"
        else "perhaps by the foundation (undecided)"
    )
    return f"The structure's modes changed {when}, {cause}{_most_shifted(event)}."


def _stiffness_before_and_after(record: TurbineRecord, event: FoundationEvent) -> str:
    """Return the springs that differ before and after a change not attributed to the foundation.

    These are the springs whose 90 % intervals before and after it are disjoint.
    """
    before = [time for time in record.state.posteriors if time <= event.since_ns]
    next_ns = min(
        (each.since_ns for each in record.state.events if each.since_ns > event.since_ns),
        default=math.inf,
    )
    since = [time for time in record.state.posteriors if event.since_ns < time <= next_ns]
    if event.kind == "foundation" or not before or not since:
        return ""
    old, new = record.state.posteriors[max(before)], record.state.posteriors[max(since)]
    moved = [
        f"{name} from {ratios(old.parameter(name))[0]:.3f} to {ratios(new.parameter(name))[0]:.3f}"
        for name in PARAMETER_NAMES
        if _intervals_differ(old.parameter(name), new.parameter(name))
    ]
    return f" Stiffness ÷ nominal changed with it: {join_with_and(moved)}." if moved else ""


def _intervals_differ(one: ParameterSummary, other: ParameterSummary) -> bool:
    return one.p95 < other.p05 or other.p95 < one.p05


def _relative_precision(change: StiffnessChange) -> float:
    width = change.p95 - change.p05
    return abs(change.median) / width if width > 0 else float("inf")


def _change(change: StiffnessChange) -> str:
    if change.p05 <= 0 <= change.p95:
        return (
            f"{change.name} did not change detectably "
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
        f"; most certainly the one at {most.frequency:.4g} Hz, {direction} by "
        f"{percent(most.change)} ± {percent(most.change_std)}"
    )


def stiffness_sentences(record: TurbineRecord) -> list[str]:
    """Return one sentence for each spring."""
    posterior = record.state.posterior
    if posterior is None:
        return []
    return [_stiffness(record, posterior.parameter(name)) for name in PARAMETER_NAMES]


def _stiffness(record: TurbineRecord, spring: ParameterSummary) -> str:
    median, low, high = ratios(spring)
    posterior = record.state.posterior
    known = f"is known to ±{percent((high - low) / 2 / median)}"
    if posterior is not None and not posterior.trusted:
        known = "is not known; by the model that the data contradict"
    text = (
        f"{spring.name}, {SPRING_TEXTS[spring.name]}, {known}: {median:.3f} × its nominal "
        f"value, 90 % interval {low:.3f} to {high:.3f}"
    )
    truth = record.state.truth
    if truth is None:
        return f"{text}."
    true = getattr(truth, spring.name) / spring.nominal
    inside = "inside" if low <= true <= high else "outside"
    return f"{text}. The simulated truth, {true:.3f}, lies {inside}."


def measurement_sentences(record: TurbineRecord) -> list[str]:
    """Return sentences on what was measured, what was used and what is missing."""
    return [
        _measured_duration(record),
        *_rejected_windows(record),
        *_books(record),
        _missing_samples(record),
    ]


def _measured_duration(record: TurbineRecord) -> str:
    summary, (start_ns, end_ns) = record.state, record.span_ns
    windows = count_noun(len(summary.estimates), "window")
    measured, whole = span(summary.measured_time), span((end_ns - start_ns) / NANOSECONDS)
    when = f"from {between_instants(start_ns, end_ns)}"
    if measured != whole:
        when = f"over {whole}, {when},"
    return (
        f"{measured} of measurements {when} gave "
        f"{windows} with {count_noun(len(summary.modes), 'mode')} in all."
    )


def _rejected_windows(record: TurbineRecord) -> Iterator[str]:
    identified = {estimate.start_ns for estimate in record.state.estimates}
    not_used = [each for each in record.state.rejected if each.start_ns in identified]
    failed = [each for each in record.state.rejected if each.start_ns not in identified]
    if failed:
        windows = count_noun(sum(1 + each.windows_before for each in failed), "window")
        counts = _counts_by_code(failed)
        yield f"{windows} could not be identified: {counts}. {_last_reason(failed)}"
    if not_used:
        number = count_noun(len(not_used), "identified window")
        counts = _counts_by_code(not_used)
        yield f"{number} did not enter the stiffness: {counts}. {_last_reason(not_used)}"


def _books(record: TurbineRecord) -> Iterator[str]:
    """Yield what the books cannot account for, and posteriors that do not come."""
    books = record.run.books
    violations = books.violations(record.turbine)
    if violations:
        more = f" (and {len(violations) - 1} more)" if len(violations) > 1 else ""
        yield f"The books do not balance: {violations[0]}{more}."
    if record.has_structure:
        yield from (
            sentence(alarm.text)
            for alarm in books.alarms()
            if (alarm.kind, alarm.turbine) == ("no-posterior", record.turbine)
        )


def _counts_by_code(rejected: Sequence[WindowRejected]) -> str:
    counts = Counter[str]()
    for each in rejected:
        counts[each.code] += 1 + each.windows_before
    return join_with_and([f"{count} × {code}" for code, count in counts.most_common()])


def _last_reason(rejected: Sequence[WindowRejected]) -> str:
    """Return why the last of them was rejected; the others are in the table of windows."""
    return f"The last one: {rejected[-1].reason}."


def _missing_samples(record: TurbineRecord) -> str:
    if not record.state.published:
        return "The recording holds results only, no samples."
    stream, silent = record.figures["stream"], record.run.books.silence(record.turbine)
    pauses = f" Between boots of a unit {span(silent)} have no samples." if silent else ""
    if not stream["gaps"] and not stream["lost"]:
        return pauses.strip() or "No sample is missing."
    gaps = f"{count_noun(stream['gaps'], 'gap')} in the stream, {span(stream['gap_s'])} in all."
    lost = stream["lost"]
    return gaps + (f" {count_noun(lost, 'block')} lost between the nodes." if lost else "") + pauses


def _modes_headline(record: TurbineRecord) -> str:
    """Return the headline of a session without a structural model."""
    summary = record.state
    if not summary.estimates:
        return f"No modes are known: {_why_no_posterior(record)}."
    frequencies = [mode.frequency for mode in summary.modes]
    if not frequencies:
        return "No mode was identified."
    modes, windows = len(frequencies), count_noun(len(summary.estimates), "window")
    lowest, highest = (f"{each:.3g}" for each in (min(frequencies), max(frequencies)))
    where = f"at {lowest}" if lowest == highest else f"between {lowest} and {highest}"
    return (
        f"{count_noun(modes, 'mode')} {where} Hz {'was' if modes == 1 else 'were'} "
        f"identified in {windows}."
    )


def _why_no_posterior(record: TurbineRecord) -> str:
    if record.state.estimates:
        return "no identified window could be used"
    return "no window could be identified" if record.state.rejected else "no window was complete"


def sentence(text: str) -> str:
    """Return the text with a capital letter, but of a name such as k22, and a full stop."""
    first = text[:1] if NAME_WITH_NUMBER.match(text) else text[:1].upper()
    return first + text[1:] + ("" if text.endswith((".", "!", "?")) else ".")


def structure_sentence(posterior: FoundationPosterior) -> str:
    """Return how the structure was taken, and what makes the intervals."""
    if posterior.structure != "uncertain":
        return (
            "The structure is taken as exactly known, as its scenario has it: its errors are not "
            "in these intervals."
        )
    parts = [
        f"{each.name.replace('_', ' ')} ({100 * each.k11:.0f}, {100 * each.k22:.0f} and "
        f"{100 * each.k12:.0f} %)"
        for each in posterior.budget[:4]
    ]
    alternatives = ", ".join(
        f"{each.name}: {percent(each.probability)}" for each in posterior.alternatives
    )
    return (
        f"The structure's figures are inferred with the springs ({alternatives}). Shares of the "
        f"variance of k11, k22 and k12: {'; '.join(parts)}. "
        f"{_unpredicted(posterior.unpredicted_share)}"
    )


def _unpredicted(share: float) -> str:
    if share == 0:
        return "Every mode is what the others predict."
    return f"{percent(share)} of the modes are not what the others predict."


def axis_words(record: TurbineRecord) -> str:
    """Return which line is which axis, of the axes that sensors have; "" where it is one."""
    x, y = ("fore-aft (x)", "side-side (y)") if record.has_structure else ("along x", "along y")
    layout = record.layout
    lines = (f"{x} solid", f"{y} dashed", "along z dotted")
    seen = np.ones(3, dtype=bool) if layout is None else np.any(layout.directions, axis=0)
    present = [line for line, each in zip(lines, seen, strict=True) if each]
    return f": {', '.join(present)}" if len(present) > 1 else ""
