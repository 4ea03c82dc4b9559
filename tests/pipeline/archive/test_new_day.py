"""The short form of `python -m tests.benchmarks history`: a new day into two weeks."""

from pathlib import Path

import pytest

from tests.benchmarks.history import arguments_of, measured


@pytest.mark.nightly
def test_a_new_day_costs_a_day_and_a_window_keeps_twenty_kilobytes(tmp_path: Path) -> None:
    chosen = arguments_of(["--years", "0.04", "--new-day", "2026-01-01", "--posteriors", "0"])

    found = measured(tmp_path, chosen)

    assert found.days_passed == 1
    assert found.windows == 16 * 144
    assert found.cpu < 60.0
    assert found.survey_ms_a_file < 1.0
    assert found.kept_bytes_a_window < 20_000
