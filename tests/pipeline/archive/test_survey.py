"""A file that has not changed is not read again."""

import os
import shutil
import time
from pathlib import Path

import pytest

from pipeline.archive import survey as survey_module
from pipeline.archive.store import FinishedResults
from pipeline.archive.survey import SurveyCache, decoded_survey, encoded_survey, surveyed


@pytest.fixture
def recording(short_recording: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(short_recording, tmp_path / "a.mcap"))


def test_a_survey_comes_back_as_it_was(recording: Path) -> None:
    found = surveyed(recording)

    assert decoded_survey(recording, encoded_survey(found)) == found


def test_an_unchanged_file_is_known_without_a_look_into_it(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache = SurveyCache(FinishedResults(tmp_path / "finished"))
    assert cache.get(recording) is None
    found = surveyed(recording)
    cache.put(recording, found)
    monkeypatch.setattr(survey_module, "fingerprint_of", None)

    assert cache.get(recording) == found
    started = time.process_time()
    for _ in range(100):
        cache.get(recording)
    assert (time.process_time() - started) / 100 < 0.003  # of a busy machine; see the results


def test_a_changed_file_and_a_damaged_survey_are_read_again(
    recording: Path, tmp_path: Path
) -> None:
    cache = SurveyCache(FinishedResults(tmp_path / "finished"))
    cache.put(recording, surveyed(recording))
    (kept,) = (tmp_path / "finished").rglob("*.pw")
    whole = kept.read_bytes()
    kept.write_bytes(whole[:-3])
    assert cache.get(recording) is None
    kept.write_bytes(whole)
    assert cache.get(recording) is not None

    os.utime(recording, ns=(1, 1))
    assert cache.get(recording) is None
