"""A file that has not changed is not read again."""

import os
import shutil
import time
from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.archive import survey as survey_module
from pipeline.archive.survey import FileSurvey, SurveyCache, archive_files, surveyed
from pipeline.messages import StreamGap
from pipeline.recording.errors import RecordingError
from tests.pipeline.recording.test_recording import of_another_program


@pytest.fixture
def recording(short_recording: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(short_recording, tmp_path / "a.mcap"))


def test_an_unchanged_file_is_known_without_a_look_into_it(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache = SurveyCache(tmp_path / "surveys.pw")
    assert cache.get(recording) is None
    found = surveyed(recording)
    gap = StreamGap(found.parts[0].turbine, found.parts[0].unit, found.parts[0].session, 1, 2, 3, 4)
    found = replace(found, damage="some", parts=(replace(found.parts[0], gaps=(gap,)),))
    cache.put(recording, found)
    cache.close()
    monkeypatch.setattr(survey_module, "fingerprint_of", None)

    again = SurveyCache(tmp_path / "surveys.pw")

    assert again.get(recording) == found
    started = time.process_time()
    for _ in range(100):
        again.get(recording)
    assert (time.process_time() - started) / 100 < 0.0005  # of a busy machine; see the results


def test_files_of_one_layout_and_scenario_keep_them_once(recording: Path, tmp_path: Path) -> None:
    found = surveyed(recording)
    cache = SurveyCache(tmp_path / "surveys.pw")
    for number in range(200):
        path = tmp_path / f"{number}.mcap"
        path.touch()
        cache.put(path, found)
    cache.close()

    assert (tmp_path / "surveys.pw").stat().st_size < 200 * 150


def test_a_changed_file_and_damaged_surveys_are_read_again(recording: Path, tmp_path: Path) -> None:
    kept = tmp_path / "surveys.pw"
    cache = SurveyCache(kept)
    cache.put(recording, surveyed(recording))
    cache.close()
    whole = kept.read_bytes()
    kept.write_bytes(whole[:-3])
    assert SurveyCache(kept).get(recording) is None
    kept.write_bytes(whole)
    assert SurveyCache(kept).get(recording) is not None

    os.utime(recording, ns=(1, 1))
    assert SurveyCache(kept).get(recording) is None


def test_surveys_are_written_when_a_tenth_of_them_is_new_and_at_least_so_many(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(survey_module, "UNSAVED", 3)
    found, kept = surveyed(recording), tmp_path / "surveys.pw"
    cache, written = SurveyCache(kept), []
    for number in range(60):
        path = tmp_path / f"{number}.mcap"
        path.touch()
        cache.put(path, found)
        if kept.exists():
            written.append(number + 1)
            kept.unlink()
    assert written == [*range(3, 40, 3), 43, 47, 52, 57]


def test_a_file_of_another_program_is_read_again_and_refused(tmp_path: Path) -> None:
    """Earlier versions kept it as a recording without samples."""
    foreign = of_another_program(tmp_path / "robot.mcap", {"/robot/pose": ("json", "Pose")})
    cache = SurveyCache(tmp_path / "surveys.pw")
    cache.put(foreign, FileSurvey(foreign, "some bytes", (), ()))

    assert cache.get(foreign) is None
    with pytest.raises(RecordingError, match="holds no pilewatch channel, only /robot/pose"):
        surveyed(foreign)
    nothing = of_another_program(tmp_path / "nothing.mcap", {})
    with pytest.raises(RecordingError, match="holds no pilewatch channel, and no other"):
        surveyed(nothing)


def test_a_link_to_a_file_that_has_gone_is_named_by_a_pattern_too(
    recording: Path, tmp_path: Path
) -> None:
    gone = tmp_path / "gone.mcap"
    gone.symlink_to(tmp_path / "nowhere.mcap")
    (tmp_path / "folder.mcap").mkdir()

    assert archive_files([str(tmp_path / "*.mcap")]) == (recording, gone)
    assert archive_files([str(gone)]) == (gone,)
    with pytest.raises(RecordingError, match=r"gone\.mcap: No such file"):
        surveyed(gone)
