"""One small archive and what one process makes of it."""

from pathlib import Path

import pytest

from pipeline.archive.reprocessing import reprocessed
from pipeline.archive.work import ThisProcess
from tests.identified_once import remembering
from tests.pipeline.archive.archives import cut_into_files


@pytest.fixture(scope="session")
def archive(short_recording: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Four minutes in files of fifty seconds: no window lies within one file."""
    return cut_into_files(short_recording, tmp_path_factory.mktemp("archive"), 50.0)


@pytest.fixture(scope="session")
def results(
    archive: list[Path], tmp_path_factory: pytest.TempPathFactory, identified_answers: Path
) -> Path:
    """The same, reprocessed in this process."""
    out = tmp_path_factory.mktemp("results")
    with remembering(identified_answers):
        reprocessed(archive, out, ThisProcess())
    return out
