"""Durations and shares as people say them."""

import pytest

from pipeline.report.wording import between_instants, percent, span


@pytest.mark.parametrize(
    ("seconds", "said"),
    [
        (0.4, "0.4 s"),
        (90.0, "90 s"),
        (600.0, "10 min"),
        (5400.0, "1 h 30 min"),
        (90_000.0, "1 d 1 h"),
    ],
)
def test_a_duration_is_said_in_its_largest_units(seconds: float, said: str) -> None:
    assert span(seconds) == said


@pytest.mark.parametrize(
    ("share", "said"), [(0.123, "12 %"), (-0.0123, "1.2 %"), (0.00123, "0.12 %")]
)
def test_a_share_has_two_digits(share: float, said: str) -> None:
    assert percent(share) == said


def test_two_instants_name_a_day_or_the_start_once() -> None:
    begin = 1_709_629_200 * 10**9
    assert between_instants(begin, begin + 3000 * 10**9) == "5 March 2024 09:00 to 09:50 UTC"
    assert between_instants(0, 1200 * 10**9) == "0:00:00 to 0:20:00 after the start"


def test_a_start_just_before_midnight_is_midnight() -> None:
    midnight = 1_767_225_600 * 10**9  # 1 January 2026
    just_before = midnight - 400_000  # a clock fitted to stamps in whole milliseconds
    assert between_instants(just_before, midnight + 3600 * 10**9) == (
        "1 January 2026 00:00 to 01:00 UTC"
    )
