"""Windows lie where one recording of the whole would have them, whatever files it came in."""

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.archive.plan import (
    IdentificationTask,
    PartsBySample,
    TurbinePlan,
    chains_of,
    parts_by_turbine,
    sent_again,
    turbine_plan,
)
from pipeline.archive.survey import FileSurvey, Part, archive_files, without_copies
from pipeline.archive.turbines import TurbineArchive
from pipeline.messages import StreamGap
from pipeline.oma.settings import OmaSettings
from pipeline.scenario.loading import modes_only
from sensors.acquisition.blocks import NANOSECONDS
from sensors.errors import InputError

RATE = 10.0  # [Hz]
START_NS = 1_700_000_000 * NANOSECONDS
TEN_SECONDS = OmaSettings(window_duration=10.0, hop=10.0)


def part(
    name: str, first: int, n_samples: int, *, session: str = "s", start: float | None = None
) -> Part:
    """A part of `n_samples` from a sample of its session on; `start` [s], None: as counted."""
    begun = first / RATE if start is None else start
    start_ns = START_NS + round(begun * NANOSECONDS)
    return Part(
        path=Path(name),
        fingerprint=f"bytes of {name}",
        turbine="t",
        unit="tower",
        session=session,
        layout_id="l",
        sampling_rate=RATE,
        n_channels=8,
        n_blocks=n_samples // 10,
        gaps=(),
        first_sample=first,
        next_sample=first + n_samples,
        first_sequence=first // 10,
        last_sequence=(first + n_samples) // 10 - 1,
        start_ns=start_ns,
        end_ns=start_ns + round(n_samples / RATE * NANOSECONDS),
    )


def survey(*parts: Part) -> FileSurvey:
    return FileSurvey(parts[0].path, parts[0].fingerprint, parts, ())


def tasks(*parts: Part, settings: OmaSettings = TEN_SECONDS) -> tuple[IdentificationTask, ...]:
    (found,) = parts_by_turbine([survey(each) for each in parts]).values()
    return turbine_plan(found, settings).tasks


def test_a_window_that_spans_two_joining_files_belongs_to_the_first() -> None:
    first, second = tasks(part("a", 0, 250), part("b", 250, 250))

    assert [piece.path.name for piece in first.pieces] == ["a", "b"]
    assert (first.n_windows, second.n_windows) == (3, 2)
    assert [(p.first_sample, p.end_sample) for p in first.pieces] == [(0, 250), (250, 300)]
    assert [(p.first_sample, p.end_sample) for p in second.pieces] == [(300, 500)]
    assert second.start_ns == START_NS + 30 * NANOSECONDS


def test_files_with_a_gap_between_them_share_no_window() -> None:
    first, second = tasks(part("a", 0, 250), part("b", 260, 250))

    assert [piece.path.name for piece in first.pieces] == ["a"]
    assert second.start_ns == START_NS + 26 * NANOSECONDS  # windows begin anew
    assert (first.n_windows, second.n_windows) == (3, 3)  # the third of each is incomplete


def test_a_new_session_goes_on_where_its_clock_is_within_half_a_sample() -> None:
    goes_on = part("b", 0, 250, session="s2", start=25.04)
    begins = part("b", 0, 250, session="s2", start=25.06)

    assert len(chains_of([part("a", 0, 250), goes_on])) == 1
    assert len(chains_of([part("a", 0, 250), begins])) == 2


def test_a_new_session_is_counted_on_from_the_one_before() -> None:
    first, second = tasks(part("a", 0, 250), part("b", 0, 250, session="s2", start=25.0))

    assert first.pieces[1].shift == 250
    assert first.pieces[1].first_sample == 0
    assert first.pieces[1].sequence_shift == 25
    assert second.pieces[0].first_sample == 50


def test_samples_that_two_files_hold_are_taken_once() -> None:
    """A recorder that was started again repeats the last blocks it had."""
    first, second = tasks(part("a", 0, 250), part("b", 200, 300))

    assert first.n_windows + second.n_windows == 5
    assert [(p.first_sample, p.end_sample) for p in first.pieces] == [(0, 250), (250, 300)]


TEN_YEARS = 10 * 365 * 86400.0  # [s]


def test_a_clock_that_was_wrong_at_first_moves_no_file_out_of_its_place() -> None:
    """A boot counts samples; its first file is stamped ten years late, the others right."""
    parts = [part("a", 0, 250, start=TEN_YEARS), part("b", 250, 250), part("c", 500, 250)]
    in_order = parts_by_turbine([survey(each) for each in parts])["t"]

    assert [each.path.name for each in in_order] == ["a", "b", "c"]
    assert [[each.path.name for each in chain] for chain in chains_of(in_order)] == [
        ["a", "b", "c"]
    ]


def test_a_boot_that_is_stamped_years_late_hides_none_that_follows() -> None:
    late = [part("session.mcap", 0, 250, start=TEN_YEARS)]
    right = [
        part("session.part2.mcap", 0, 250, session="r"),
        part("session.part10.mcap", 250, 250, session="r"),
    ]
    in_order = parts_by_turbine([survey(each) for each in (*late, *right)])["t"]

    assert [each.path.name for each in in_order] == [
        "session.mcap", "session.part2.mcap", "session.part10.mcap",
    ]  # fmt: skip
    assert sum(len(chain) for chain in chains_of(in_order)) == 3


def test_a_restart_under_the_same_name_is_a_boot_of_its_own() -> None:
    parts = [part("a", 0, 250), part("b", 250, 250), part("c", 0, 400, start=900.0)]
    in_order = parts_by_turbine([survey(each) for each in parts])["t"]

    assert [[each.path.name for each in chain] for chain in chains_of(in_order)] == [
        ["a", "b"], ["c"],
    ]  # fmt: skip


def test_the_same_time_under_another_name_counts_once() -> None:
    parts = [part("a", 0, 500), part("b", 0, 250, session="again", start=10.0)]
    in_order = parts_by_turbine([survey(each) for each in parts])["t"]

    assert [len(chain) for chain in chains_of(in_order)] == [1]


def test_time_that_two_sessions_hold_is_used_once_and_reported() -> None:
    """As if one file had it all: the second goes on where the first one ends."""
    first, second = part("a", 0, 250), part("b", 0, 250, session="again", start=15.0)
    plan = turbine_plan([first, second], TEN_SECONDS)

    assert sum(task.n_windows for task in plan.tasks) == 4
    assert [(p.path.name, p.first_sample, p.end_sample) for p in plan.tasks[0].pieces] == [
        ("a", 0, 250), ("b", 100, 150),
    ]  # fmt: skip
    assert plan.tasks[1].start_ns == START_NS + 30 * NANOSECONDS
    (overlap,) = plan.overlaps
    assert (overlap.first, overlap.second) == (Path("a"), Path("b"))
    assert (overlap.start_ns - START_NS, overlap.end_ns - START_NS) == (
        15 * NANOSECONDS,
        25 * NANOSECONDS,
    )
    archive = TurbineArchive(plan, modes_only("t"), ())
    assert archive.warnings == (
        "a and b both cover 2023-11-14 22:13:35 to 22:13:45 UTC (10 s); those of b are left out",
    )


def test_a_file_that_lies_within_another_ones_time_is_reported() -> None:
    parts = [part("a", 0, 500), part("b", 0, 250, session="again", start=10.0), part("c", 500, 250)]
    plan = turbine_plan(parts, TEN_SECONDS)
    assert [(o.second.name, (o.end_ns - o.start_ns) / NANOSECONDS) for o in plan.overlaps] == [
        ("b", 25.0)
    ]
    assert sum(task.n_windows for task in plan.tasks) == 8  # of which the last is incomplete


def test_what_a_restart_repeats_and_what_clocks_of_sessions_are_off_is_no_shared_time() -> None:
    repeated = [part("a", 0, 250), part("b", 200, 300)]
    jitter = [part("a", 0, 250), part("b", 0, 250, session="s2", start=24.5)]
    stepped = [part("r.mcap", 0, 250), part("r.part2.mcap", 0, 250, session="s2", start=15.0)]
    for parts in (repeated, jitter, stepped):
        assert turbine_plan(parts, TEN_SECONDS).overlaps == ()


def test_of_units_that_are_joined_within_files_shared_time_is_used_twice_and_reported() -> None:
    lower, again = part("a", 0, 250), part("b", 0, 250, session="again", start=15.0)
    parts = [lower, replace(lower, unit="upper"), again, replace(again, unit="upper")]
    plan = turbine_plan(parts, TEN_SECONDS)
    assert [overlap.used_twice for overlap in plan.overlaps] == [True, True]
    warnings = TurbineArchive(plan, modes_only("t"), ()).warnings
    assert warnings == (
        "a and b both cover 2023-11-14 22:13:35 to 22:13:45 UTC (10 s); both are used",
    )


def test_other_channels_or_rates_never_join() -> None:
    other = replace(part("b", 250, 250), sampling_rate=20.0)

    assert len(chains_of([part("a", 0, 250), other])) == 2


def test_a_task_reads_on_over_files_shorter_than_a_window() -> None:
    short = [part(name, 60 * i, 60) for i, name in enumerate("abcde")]

    found = tasks(*short)

    assert sum(task.n_windows for task in found) == 3
    assert [piece.path.name for piece in found[0].pieces] == ["a", "b"]
    assert "c" not in [task.path.name for task in found[:1]]


def test_overlapping_windows_read_the_next_files_beginning() -> None:
    overlapping = OmaSettings(window_duration=10.0, hop=5.0)

    first, second = tasks(part("a", 0, 200), part("b", 200, 200), settings=overlapping)

    assert (first.n_windows, second.n_windows) == (4, 3)
    assert first.pieces[1].end_sample == 250


@given(
    lengths=st.lists(st.integers(1, 400), min_size=1, max_size=8),
    hop=st.sampled_from([2.0, 5.0, 10.0]),
)
def test_however_a_recording_is_cut_every_window_has_one_task(
    lengths: list[int], hop: float
) -> None:
    settings = OmaSettings(window_duration=10.0, hop=hop)
    parts, first = [], 0
    for number, length in enumerate(lengths):
        parts.append(part(f"{number:02d}", first, length))
        first += length
    whole = tasks(part("whole", 0, first), settings=settings)

    cut = tasks(*parts, settings=settings)

    starts = [
        task.start_ns + round(index * hop * NANOSECONDS)
        for task in cut
        for index in range(task.n_windows)
    ]
    expected = [START_NS + round(index * hop * NANOSECONDS) for index in range(whole[0].n_windows)]
    assert starts == expected
    samples = [piece.end_sample - piece.first_sample for task in cut[-1:] for piece in task.pieces]
    assert cut[-1].end_ns == START_NS + round(first / RATE * NANOSECONDS)
    assert all(samples)


def test_files_with_the_same_bytes_count_once() -> None:
    original, copy = survey(part("a", 0, 250)), survey(part("z", 0, 250))
    copy = replace(copy, fingerprint=original.fingerprint)

    assert without_copies([original, copy]) == ([original], [copy])


def test_a_pattern_that_names_nothing_is_a_mistake_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="names no recording"):
        archive_files([str(tmp_path / "*.mcap")])


@given(
    st.lists(
        st.tuples(st.integers(0, 900), st.integers(1, 300), st.sampled_from(["s", "u"])),
        min_size=1,
        max_size=12,
    ),
    st.integers(0, 900),
    st.integers(1, 200),
)
def test_parts_that_reach_into_a_gap_are_found_as_by_looking_at_all(
    held: list[tuple[int, int, str]], first: int, n_samples: int
) -> None:
    parts = [
        part(str(number), begin, length, session=session)
        for number, (begin, length, session) in enumerate(held)
    ]
    found = PartsBySample(parts).others(parts[0], first, first + n_samples)
    assert found == [
        each
        for each in parts[1:]
        if each.session == parts[0].session
        and each.first_sample < first + n_samples
        and each.next_sample > first
    ]


def test_a_plan_looks_at_other_parts_only_where_samples_are_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An archive of ten years has 90 000 files: each with each would take days."""
    asked: list[Part] = []

    def nothing(_: PartsBySample, of: Part, start: int, stop: int) -> list[Part]:
        asked.append(of)
        return []

    monkeypatch.setattr(PartsBySample, "others", nothing)
    whole = [part(str(number), 250 * number, 250) for number in range(20)]
    gap = StreamGap("t", "tower", "s", START_NS, START_NS + NANOSECONDS, 180, 1)
    lacking = replace(whole[7], missing=((1800, 1810),), gaps=(gap,))
    tasks(*whole[:7], lacking, *whole[8:])
    assert {each.path.name for each in asked} == {"7"}


def test_samples_that_a_part_lacks_are_taken_from_whatever_parts_have_them() -> None:
    """Of 100 to 200, one has the first half and another the last quarter; nobody has the rest."""
    lacking = replace(part("a", 0, 300), missing=((100, 200),))
    half, quarter = part("b", 50, 100), part("c", 175, 100)
    parts = PartsBySample([lacking, half, quarter])
    found = [(each.path.name, *span) for each, *span in sent_again(lacking, 0, 300, parts)]
    assert found == [("b", 100, 150), ("c", 175, 200)]


def test_windows_of_a_file_that_must_be_read_to_know_are_as_many_as_fit() -> None:
    hour = NANOSECONDS * 3600
    known = IdentificationTask(Path("a"), (), "t", (), (), 0, 9 * hour, n_windows=3)
    tasks = [replace(known, n_windows=0, end_ns=end) for end in (hour, hour // 100, 1)]
    archive = TurbineArchive(TurbinePlan("t", (known, *tasks), ()), modes_only("t"), ())
    hop = archive.scenario.oma.hop
    assert archive.n_windows == 3 + round(3600 / hop) + 1 + 1
