"""`--sampling-rate` beside a file with time stamps: those that increase are followed."""

import logging
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.offline.identify_file import identify_file
from pipeline.recording.info import UnitInfo, recording_info

RATE = 50.0
SECONDS = 20
SAMPLES = np.random.default_rng(5).standard_normal((int(RATE) * SECONDS, 2))
FOLLOWED = (
    "the file runs at 50 Hz by its own time, not at the 40 Hz given; its own time is followed"
)


def stamped(path: Path, seconds: np.ndarray, title: str = "time", unit: str = "ms") -> Path:
    """A CSV of SAMPLES at so many seconds after a date, rounded to a unit."""
    begin = np.datetime64("2024-03-01T12:00:00", "us")
    stamps = begin + np.round(seconds * 1e6).astype("timedelta64[us]")
    texts = np.datetime_as_string(stamps.astype(f"datetime64[{unit}]"))
    rows = [f"{stamp},{a!r},{b!r}" for stamp, (a, b) in zip(texts, SAMPLES.tolist(), strict=True)]
    path.write_text("\n".join([f"{title},z145-fa,z145-ss", *rows]) + "\n")
    return path


def recorded(file: Path, command: str, *options: str) -> UnitInfo:
    """What a command makes of a file and a stated rate of 40 Hz."""
    recording = file.parent / "made.mcap"
    target = recording if command == "import" else file.parent / "made"
    words = [command, str(file), "-o", str(target), "--sampling-rate", "40", *options]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    if command == "new":
        (recording,) = (target / "recordings").glob("*.mcap")
    (unit,) = recording_info(recording).units
    return unit


EVEN = np.arange(len(SAMPLES)) / RATE


@pytest.mark.parametrize("command", ["import", "new"])
def test_a_recording_follows_stamps_that_increase_and_names_the_other_rate(
    tmp_path: Path, command: str, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    unit = recorded(stamped(tmp_path / "tower.csv", EVEN), command)
    assert (unit.sampling_rate, unit.duration) == (RATE, SECONDS)
    assert np.datetime64(unit.start_ns, "ns") == np.datetime64("2024-03-01T12:00:00")
    assert FOLLOWED in caplog.text


@pytest.mark.parametrize("command", ["import", "new"])
def test_a_stated_rate_that_the_stamps_have_is_not_mentioned(
    tmp_path: Path, command: str, caplog: pytest.LogCaptureFixture
) -> None:
    file = stamped(tmp_path / "tower.csv", EVEN * RATE / 40)
    assert recorded(file, command).sampling_rate == 40
    assert "40 Hz" not in caplog.text


@pytest.mark.parametrize("command", ["import", "new"])
@pytest.mark.parametrize("unit", ["ms", "s"])
def test_stamps_that_stand_still_are_counted_and_their_own_pace_is_named(
    tmp_path: Path, command: str, unit: str, caplog: pytest.LogCaptureFixture
) -> None:
    once = EVEN.copy()
    once[700] = once[699]
    made = recorded(stamped(tmp_path / "tower.csv", once, unit=unit), command)
    assert (made.sampling_rate, made.duration) == (40, len(SAMPLES) / 40)
    assert "stand still or go back" in caplog.text
    assert "counted at the 40 Hz given" in caplog.text


def test_modes_of_a_file_are_those_of_its_stamps(tmp_path: Path) -> None:
    file = stamped(tmp_path / "tower.csv", EVEN)
    found = identify_file(file, sampling_rate=40.0, window=10.0)
    assert (found.sampling_rate, found.duration) == (RATE, SECONDS)
    assert len(found.estimates) + len(found.rejected) == 2
    assert FOLLOWED in [each.text for each in found.warnings]
    once = EVEN.copy()
    once[700] = once[699]
    counted = identify_file(stamped(tmp_path / "still.csv", once), sampling_rate=40.0)
    assert (counted.sampling_rate, counted.duration) == (40.0, len(SAMPLES) / 40)
    assert "sampling-rate" in [each.code for each in counted.warnings]


def test_a_file_that_states_its_rate_is_followed_too(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = tmp_path / "tower.npz"
    np.savez(file, fs=RATE, **{"z145-fa": SAMPLES[:, 0], "z145-ss": SAMPLES[:, 1]})
    assert recorded(file, "import").sampling_rate == RATE
    assert identify_file(file, sampling_rate=40.0).sampling_rate == RATE
    assert FOLLOWED in caplog.text
