"""Blows that ring down and stops: the short form of the benchmark `stationarity`."""

import numpy as np
import pytest

from pipeline.oma.data_quality.input_checks import check_stationarity
from pipeline.oma.data_quality.transients import ring_down
from tests.benchmarks.stationarity import RATE, record


@pytest.mark.parametrize("kind", ["blow", "stop"])
def test_decays_of_five_times_are_warned_of(kind: str) -> None:
    warned = [bool(check_stationarity(record(seed, kind, 5.0), RATE)) for seed in range(1, 21)]
    assert np.mean(warned) >= 0.9


def test_gusts_alone_are_stationary() -> None:
    assert not any(check_stationarity(record(seed), RATE) for seed in range(1, 41))


def test_the_warning_names_the_moment_of_the_blow() -> None:
    quiet = record(3)
    time = np.arange(len(quiet)) / RATE
    after = np.clip(time - 200.0, 0, None)
    ring = np.where(after > 0, np.exp(-0.01 * 2 * np.pi * 0.2 * after), 0.0)
    blown = quiet + np.outer(10 * quiet.std() * ring * np.sin(2 * np.pi * 0.2 * after), np.ones(8))
    found = ring_down(blown - blown.mean(axis=0), RATE)
    assert found is not None
    assert found.kind == "blow"
    assert found.excess > 1
    assert found.time == pytest.approx(200.0, abs=15.0)


def test_a_record_of_few_periods_is_not_judged() -> None:
    assert ring_down(np.random.default_rng(0).standard_normal((200, 2)), RATE) is None
