"""What is wrong is found in the messages, and so is that it is over."""

from dataclasses import replace

import pytest

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    NodeStatus,
    QualityWarning,
    StreamGap,
    WindowRejected,
)
from pipeline.monitoring.alarms.alarm_rules import AlarmCondition, AlarmRules
from pipeline.monitoring.alarms.settings import AlarmError, AlarmLogSettings
from sensors.acquisition.blocks import NANOSECONDS
from sensors.bounded_dict import MOST_NAMES
from tests.pipeline.example_messages import LAYOUT, START_NS, block, status
from tests.pipeline.state.test_posterior_json import POSTERIOR
from tests.pipeline.updating.test_state import estimate_of, updater_of

SECOND = NANOSECONDS
EVENT = FoundationEvent(
    "t1", 7, START_NS, "foundation", 0.999, START_NS, START_NS, START_NS, (), (), "k22 fell by 10 %"
)


@pytest.fixture
def finder() -> AlarmRules:
    return AlarmRules(AlarmLogSettings())


def wrong(causes: object) -> list[AlarmCondition]:
    return [cause for cause in causes if not cause.over]  # type: ignore[attr-defined]


def over(causes: object) -> list[str]:
    return [cause.key for cause in causes if cause.over]  # type: ignore[attr-defined]


def test_a_change_of_the_structure_has_no_end_of_its_own(finder: AlarmRules) -> None:
    (cause,) = finder.conditions(EVENT, START_NS)

    assert (cause.kind, cause.text, cause.lasting) == ("change", "k22 fell by 10 %", False)


def test_a_gap_is_worth_a_notice_from_a_minute_on_and_is_over_at_once(finder: AlarmRules) -> None:
    short = StreamGap("t1", "tower", "s", START_NS, START_NS + 59 * SECOND, 3, 59)
    long = replace(short, end_ns=START_NS + 60 * SECOND)

    assert wrong(finder.conditions(short, START_NS)) == []
    begun, ended = finder.conditions(long, START_NS + 2 * SECOND)
    assert begun.text == (
        "60 s of measurements of unit tower are missing, from 2023-11-14 22:13:20 UTC on"
    )
    assert ended.over
    assert ended.key == begun.key


def test_a_dead_channel_is_wrong_until_a_window_without_it(finder: AlarmRules) -> None:
    dead = WindowRejected("t1", 0, START_NS, 1, "constant", "z41-fa is constant over the window")
    unrelated = WindowRejected("t1", 1, 0, 1, "gap", "gap of 2 s")
    well = replace(estimate_of(2), turbine="t1", warnings=())

    (cause,) = wrong(finder.conditions(dead, START_NS))
    assert cause.text == (
        "z41-fa is constant over the window (window from 2023-11-14 22:13:20 UTC, not used)"
    )
    assert over(finder.conditions(unrelated, START_NS)) == []
    assert "t1/sensor/constant" in over(finder.conditions(well, START_NS))


def test_a_channel_that_gives_noise_alone_is_an_instruments_alarm(finder: AlarmRules) -> None:
    """Its windows are identified and not used, with the warning of the estimate."""
    noise = QualityWarning("silent-channel", "z41-fa shows no resonance")
    deaf = replace(estimate_of(1), turbine="t1", warnings=(noise,))
    well = replace(estimate_of(2), turbine="t1", warnings=())
    assert [each.key for each in wrong(finder.conditions(deaf, START_NS))] == [
        "t1/sensor/silent-channel"
    ]
    assert over(finder.conditions(well, START_NS)) == ["t1/sensor/silent-channel"]


def test_turbines_that_are_made_up_leave_bounded_memory_and_no_alarm_without_an_end(
    finder: AlarmRules,
) -> None:
    dead = WindowRejected("t1", 0, START_NS, 1, "constant", "z41-fa is constant over the window")
    well = replace(estimate_of(2), turbine="t1", warnings=())
    list(finder.conditions(well, START_NS))
    for number in range(MOST_NAMES + 10):
        list(finder.conditions(replace(dead, turbine=f"forged {number}"), START_NS))
    list(finder.conditions(dead, START_NS))
    assert len(finder._window_keys) == MOST_NAMES
    assert "t1/sensor/constant" in over(finder.conditions(well, START_NS))


def test_a_second_channel_that_dies_while_one_is_dead_is_a_cause_of_its_own(
    finder: AlarmRules,
) -> None:
    list(finder.conditions(LAYOUT, START_NS))
    first, second = LAYOUT.channels[0].name, LAYOUT.channels[1].name
    reasons = (f"{first} stands still from 3 s on", f"{first} is constant", f"{second} is constant")
    windows = [WindowRejected("t1", i, 0, 1, "constant", each) for i, each in enumerate(reasons)]
    keys = [cause.key for each in windows for cause in wrong(finder.conditions(each, START_NS))]
    still_dead = replace(
        estimate_of(3),
        turbine="t1",
        warnings=(QualityWarning("constant", f"{second} does not move"),),
    )

    assert keys == [f"t1/sensor/constant/{name}" for name in (first, first, second)]
    assert over(finder.conditions(still_dead, START_NS)) == [f"t1/sensor/constant/{first}"]


def test_doubts_of_a_window_speak_of_instruments_only_by_their_codes(finder: AlarmRules) -> None:
    doubts = (QualityWarning("clipped", "z41-fa"), QualityWarning("mode-birth", "a mode"))
    estimate = replace(estimate_of(0), warnings=doubts)

    assert [each.key.split("/")[-1] for each in wrong(finder.conditions(estimate, 0))] == [
        "clipped"
    ]


def test_an_untrusted_posterior_is_wrong_until_a_trusted_one(finder: AlarmRules) -> None:
    updater = updater_of()
    _, trusted = updater.updated(updater.initial_state(), estimate_of(0))
    doubted = replace(trusted, trusted=False, warnings=(QualityWarning("misfit", "far off"),))  # type: ignore[arg-type]

    (cause,) = wrong(finder.conditions(doubted, START_NS))
    assert cause.text == "the posterior is not to be trusted: far off"
    assert cause.key in over(finder.conditions(trusted, START_NS))


def test_a_refused_posterior_is_wrong_until_there_is_one(finder: AlarmRules) -> None:
    refused = WindowRejected("t1", 3, 0, 1, "few-pairs", "only 20 % are modes of the model")

    (cause,) = wrong(finder.conditions(refused, START_NS))
    assert cause.kind == "refused"
    assert cause.text.startswith(
        "no posterior of the window from 1970-01-01 00:00:00 UTC: only 20 %"
    )


def test_a_unit_that_falls_silent_is_noticed_while_others_speak(finder: AlarmRules) -> None:
    list(finder.conditions(block(0), START_NS))
    alive = replace(status("recorder"), turbine="t1")

    early = wrong(finder.conditions(alive, START_NS + 29 * SECOND))
    late = wrong(finder.conditions(alive, START_NS + 31 * SECOND))
    back = over(finder.conditions(block(1), START_NS + 33 * SECOND))

    assert [cause.key for cause in early] == []
    assert [cause.key for cause in late] == ["t1/silence/tower"]
    assert "t1/silence/tower" in back


def test_a_feed_tells_why_its_unit_is_silent(finder: AlarmRules) -> None:
    down = replace(
        status("feed-tower"),
        turbine="t1",
        warnings=(QualityWarning("link-down", "udp://:5: refused"),),
    )
    list(finder.conditions(block(0), START_NS))

    (cause,) = wrong(finder.conditions(down, START_NS + 300 * SECOND))

    assert cause.text == (
        "unit tower has been silent for 5 minutes; its feed says: udp://:5: refused"
    )


def test_a_node_that_dies_is_noticed_and_one_that_stops_is_not(finder: AlarmRules) -> None:
    lost = replace(status("updating"), state="running")
    stopped = replace(status("viewer"), state="stopped")
    list(finder.conditions(lost, START_NS))
    list(finder.conditions(stopped, START_NS))

    busy = wrong(finder.conditions(block(0), START_NS + 20 * SECOND))
    found = wrong(finder.conditions(block(1), START_NS + 70 * SECOND))

    assert busy == []  # it may be at work on a window
    assert [cause.key.split("/", 1)[1] for cause in found] == ["node/updating"]


def test_a_recording_that_stopped_is_told_by_its_recorder(finder: AlarmRules) -> None:
    full = replace(
        status("recorder"),
        warnings=(QualityWarning("recording-stopped", "recording has stopped: full"),),
    )

    (cause,) = wrong(finder.conditions(full, START_NS))
    assert (cause.kind, cause.text) == ("recorder", "recording has stopped: full")


@pytest.mark.parametrize("code", ["clock-unset", "clock-step", "clock-rate", "clock-drift"])
def test_stamps_that_are_wrong_are_an_alarm_until_a_window_without_them(
    finder: AlarmRules, code: str
) -> None:
    stepped = WindowRejected("t1", 0, START_NS, 1, code, "the clock of unit u stepped by 3600 s")
    drifting = replace(
        estimate_of(1), turbine="t1", warnings=(QualityWarning(code, "by the stamps"),)
    )
    well = replace(estimate_of(2), turbine="t1", warnings=())

    found = [
        *wrong(finder.conditions(stepped, START_NS)),
        *wrong(finder.conditions(drifting, START_NS)),
    ]
    assert [(each.kind, each.key) for each in found] == 2 * [("clock", f"t1/clock/{code}")]
    (ended,) = [
        each for each in finder.conditions(well, START_NS) if each.over and "clock" in each.key
    ]
    assert ended.kind == "clock"


def test_a_clock_that_differs_from_the_recorders_is_an_alarm_while_it_does(
    finder: AlarmRules,
) -> None:
    off = QualityWarning("clock-off", "the clock of unit u of t1 is 86400 s behind this machine's")
    early = replace(status("recorder"), warnings=(off,))

    (cause,) = wrong(finder.conditions(early, START_NS))
    assert (cause.kind, cause.text) == ("clock", off.text)
    assert cause.key in over(finder.conditions(status("recorder"), START_NS))


def test_kinds_that_nobody_wants_are_left_out() -> None:
    finder = AlarmRules(AlarmLogSettings(kinds=("gap",)))

    assert list(finder.conditions(EVENT, START_NS)) == []


def test_statuses_alone_are_no_cause(finder: AlarmRules) -> None:
    well = NodeStatus("t1", "updating", START_NS, "running", 3)

    assert wrong(finder.conditions(well, START_NS)) == []


def test_books_that_do_not_balance_and_posteriors_that_do_not_come_are_alarms() -> None:
    finder = AlarmRules(AlarmLogSettings(windows_without_posterior=3))
    list(finder.conditions(status("updating"), START_NS))
    for number in (0, *range(5, 11)):
        list(finder.conditions(block(number), START_NS))
    kinds = []
    for window in range(3):
        start_ns = 60 * SECOND * window
        rejected = WindowRejected("t1", window, start_ns, start_ns + 1, "nan", "")
        kinds.append(
            {each.kind for each in wrong(finder.conditions(rejected, START_NS))} - {"sensor"}
        )
    assert kinds == [set(), {"books"}, {"books", "no-posterior"}]
    missing = StreamGap("t1", "tower", "session-1", START_NS, START_NS + SECOND, 1, 4)
    list(finder.conditions(missing, START_NS))
    posterior = replace(POSTERIOR, turbine="t1")
    assert {"t1/books", "t1/no-posterior"} <= {*over(finder.conditions(posterior, START_NS))}


def test_a_number_of_windows_that_is_none_is_one_line() -> None:
    with pytest.raises(AlarmError, match="windows_without_posterior is 0"):
        AlarmLogSettings(windows_without_posterior=0)


def with_k22(ratio: float, *, trusted: bool = True) -> FoundationPosterior:
    """The posterior with another k22 over nominal."""
    parameters = [
        replace(each, median=ratio * each.nominal, p05=0.9 * each.nominal, p95=1.1 * each.nominal)
        if each.name == "k22"
        else each
        for each in POSTERIOR.parameters
    ]
    return replace(POSTERIOR, parameters=tuple(parameters), trusted=trusted)


def test_a_spring_below_its_threshold_is_an_alarm_until_it_is_above() -> None:
    rules = AlarmRules(AlarmLogSettings(kinds=("threshold",), k22_below=0.95))

    (raised,) = rules.conditions(with_k22(0.94), 0)
    assert (raised.kind, raised.key) == ("threshold", f"{POSTERIOR.turbine}/threshold/k22")
    assert raised.text == ("k22 is 0.940 of nominal (90 % interval 0.900 to 1.100), below 0.95")
    assert list(rules.conditions(with_k22(0.5, trusted=False), 0)) == []
    (ended,) = rules.conditions(with_k22(0.96), 0)
    assert (ended.over, ended.key) == (True, raised.key)


def test_without_a_threshold_no_spring_raises_an_alarm(finder: AlarmRules) -> None:
    assert "threshold" not in [each.kind for each in finder.conditions(with_k22(0.1), 0)]


def test_a_threshold_that_is_no_ratio_is_refused() -> None:
    with pytest.raises(AlarmError, match="k22_below is -1"):
        AlarmLogSettings(k22_below=-1.0)
