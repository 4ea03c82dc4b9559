"""Plain sentences: what a manager reads is what the messages say, no more and no less."""

from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.messages import (
    FoundationPosterior,
    Message,
    ParameterSummary,
    QualityWarning,
    RelativeStiffness,
)
from pipeline.report.recorded_session import TurbineRecord, read_session
from pipeline.report.sentences import (
    _intervals_differ,
    condition,
    event_sentence,
    findings,
    headline,
    reasons_for_distrust,
    sentence,
    structure_sentence,
)
from tests.pipeline.example_messages import LAYOUT, START_NS, block, rejection
from tests.pipeline.report.example_session import (
    WINDOW_NS,
    estimate,
    event,
    posterior,
    recorded,
    session,
)


def record_of(tmp_path: Path, messages: list[Message]) -> TurbineRecord:
    """The record of the one turbine of a recording."""
    (record,) = read_session(recorded(tmp_path / "s.mcap", messages)).turbines
    return record


def test_a_change_has_its_size_its_interval_and_its_start() -> None:
    text = event_sentence(event())  # START_NS is 14 November 2023, 22:13:20
    assert text == (
        "k22 fell by 9.0 % [6.0 %, 12 %] on 14 November 2023 between 22:33 and 22:53 UTC; "
        "k11 did not change detectably (-4.0 to +2.0 %), k12 rose by 3.0 % [1.0 %, 5.0 %]."
    )


def test_a_stiffness_with_a_wide_interval_is_known_only_roughly(tmp_path: Path) -> None:
    known = posterior(0)
    (k11, *rest) = known.parameters
    rough = replace(k11, p05=0.6 * k11.median, p95=1.5 * k11.median)
    record = record_of(tmp_path, [LAYOUT, estimate(0), replace(known, parameters=(rough, *rest))])
    assert headline(record) == (
        "The foundation's stiffness is known only to ±45 %, and no change was found."
    )


def test_a_change_that_no_foundation_explains_is_not_called_the_foundations() -> None:
    text = event_sentence(event("modal-drift"))
    assert "in a way that no foundation explains" in text
    assert "k22" not in text
    assert text.endswith("most certainly the one at 1.1 Hz, down by 1.2 % ± 0.10 %.")


def test_springs_that_changed_with_an_undecided_change_are_listed_with_it(tmp_path: Path) -> None:
    messages = [each if each != event() else event("undecided") for each in session()]
    (text, *_) = findings(record_of(tmp_path, messages))
    assert text.endswith("Stiffness ÷ nominal changed with it: k22 from 1.000 to 0.912.")


def test_a_change_begins_with_its_revised_size_and_has_the_first_one_behind(tmp_path: Path) -> None:
    """A first size is by the windows of a quarter of an hour: half of what it says may be off."""
    messages = list(session())
    changes = event().changes
    last = max(n for n, each in enumerate(messages) if isinstance(each, FoundationPosterior))
    since = tuple(
        RelativeStiffness(each.name, 0.95, 0.94, 0.96, event().time_ns) for each in changes
    )
    later = max(messages[last].time_ns, event().time_ns)  # type: ignore[union-attr]
    messages[last] = replace(messages[last], relative=since, time_ns=later)  # type: ignore[type-var]
    (text, *_) = findings(record_of(tmp_path, messages))
    assert text.startswith(f"{changes[0].name} fell by 5.0 % [4.0 %, 6.0 %]")
    assert "This is by 1 posterior since; as first reported, k22 fell by 9.0 %" in text


def test_changes_come_first_then_each_spring_then_how_far_the_data_go(tmp_path: Path) -> None:
    record = record_of(tmp_path, session())
    text = findings(record)
    assert text[0].startswith("k22 fell by 9.0 %")
    assert [each.split(",")[0] for each in text[1:4]] == ["k11", "k22", "k12"]
    assert "is known to ±1.0 %: 0.912 × its nominal value" in text[2]
    assert text[2].endswith("The simulated truth, 0.910, lies inside.")
    assert any(
        "1 window could not be identified: 1 × gap. The last one: " in each for each in text[4:]
    )
    assert text[-1] == "1 gap in the stream, 4 s in all."
    assert condition(record) == "doubt"


def test_what_is_known_and_unchanged_is_good(tmp_path: Path) -> None:
    record = record_of(tmp_path, [LAYOUT, block(0), estimate(0), posterior(0)])
    assert condition(record) == "good"
    assert headline(record) == "The foundation's stiffness is known, and no change was found."
    assert findings(record)[-1] == "No sample is missing."


def test_a_posterior_that_is_not_trusted_is_no_finding_and_its_reasons_are_the_updatings(
    tmp_path: Path,
) -> None:
    warning = QualityWarning("fit", "the frequencies do not fit the model: reduced χ² 8.1")
    untrusted = posterior(0, trusted=False, warnings=(warning,))
    record = record_of(tmp_path, [LAYOUT, block(0), estimate(0), untrusted])
    assert condition(record) == "bad"
    assert headline(record).startswith("Do not use these stiffnesses")
    assert reasons_for_distrust(untrusted) == [
        "The frequencies do not fit the model: reduced χ² 8.1.",
        "What to do about each warning: docs/pages/your-turbine.md, When the posterior is not "
        "trusted.",
    ]


def test_books_that_do_not_balance_are_a_sentence(tmp_path: Path) -> None:
    record = record_of(
        tmp_path, [LAYOUT, block(0), *map(block, range(3, 9)), estimate(0), posterior(0)]
    )
    assert (
        "The books do not balance: unit tower of t1, session session-1, boot 0: "
        "blocks 1 to 2 are neither recorded nor reported missing."
    ) in findings(record)


@pytest.mark.parametrize(
    ("messages", "why"),
    [
        ([estimate(0)], "no identified window could be used"),
        ([rejection(0)], "no window could be identified"),
    ],
)
def test_without_a_posterior_the_headline_gives_the_reason(
    tmp_path: Path, messages: list[Message], why: str
) -> None:
    record = record_of(tmp_path, [LAYOUT, block(0), *messages])
    assert condition(record) == "unknown"
    assert headline(record) == f"The foundation's stiffness is not known: {why}."


def test_a_record_knows_each_window_once_and_the_truth_that_held_then(tmp_path: Path) -> None:
    repeated: list[Message] = [*session(), posterior(5, k22=0.912)]
    record = record_of(tmp_path, repeated)
    assert list(record.state.posteriors) == [START_NS + (n + 1) * WINDOW_NS for n in range(6)]
    assert isinstance(record.state.posterior, FoundationPosterior)
    nominal = record.state.posterior.parameter("k22").nominal
    before, after = START_NS + WINDOW_NS, START_NS + 5 * WINDOW_NS
    for early in (START_NS - WINDOW_NS, before):  # the first truth holds before its own time
        assert record.true_stiffness("k22", early) == pytest.approx(nominal)
    assert record.true_stiffness("k22", after) == pytest.approx(0.91 * nominal)


@pytest.mark.parametrize(
    ("low", "high", "differ"),
    [(0.7, 0.9, False), (0.7, 0.89, True), (1.1, 1.2, False), (1.11, 1.2, True)],
)
def test_intervals_that_touch_do_not_differ(low: float, high: float, differ: bool) -> None:
    one = ParameterSummary("k11", "N/m", nominal=1.0, median=1.0, p05=0.9, p95=1.1)
    other = replace(one, p05=low, p95=high)
    assert _intervals_differ(one, other) == _intervals_differ(other, one) == differ


@pytest.mark.parametrize(
    ("share", "sentence"),
    [(0.0, "Every mode is what the others predict."), (0.056, "5.6 % of the modes are not what")],
)
def test_modes_that_the_others_do_not_predict_are_a_share_or_none(
    share: float, sentence: str
) -> None:
    published = replace(posterior(0), structure="uncertain", unpredicted_share=share)
    assert sentence in structure_sentence(published)


@pytest.mark.parametrize("name", ["k22", "m3", "z145-fa"])
def test_a_name_at_the_beginning_of_a_sentence_stays_as_it_is(name: str) -> None:
    assert sentence(f"{name} is unlike the others") == f"{name} is unlike the others."
    assert sentence("modes are few") == "Modes are few."


@pytest.mark.parametrize(
    ("frequencies", "modes"),
    [
        ([0.16], "1 mode at 0.16 Hz was"),
        ([0.1601, 0.1603], "2 modes at 0.16 Hz were"),
        ([0.16, 2.571], "2 modes between 0.16 and 2.57 Hz were"),
    ],
)
def test_modes_lie_between_two_frequencies_where_these_differ_as_they_are_written(
    frequencies: list[float], modes: str, tmp_path: Path
) -> None:
    like = estimate(0).modes
    found = [replace(mode, frequency=each) for mode, each in zip(like, frequencies, strict=False)]
    record = record_of(tmp_path, [LAYOUT, replace(estimate(0), modes=tuple(found))])
    assert headline(replace(record, has_structure=False)) == f"{modes} identified in 1 window."


def test_measured_time_is_stated_and_its_span_where_pauses_lie_between(tmp_path: Path) -> None:
    whole = [LAYOUT, *map(block, range(600)), replace(estimate(0), end_ns=block(599).end_ns)]
    (tmp_path / "whole").mkdir()
    texts = findings(record_of(tmp_path / "whole", whole))
    begin = "10 min of measurements from 14 November 2023 22:13 to 22:23 UTC gave 1 window"
    assert any(text.startswith(begin) for text in texts)
    month = 30 * 86_400
    texts = findings(record_of(tmp_path, [*whole, *map(block, range(month, month + 600))]))
    begin = "20 min of measurements over 30 d 0 h, from 14 November 2023"
    assert any(text.startswith(begin) for text in texts)
