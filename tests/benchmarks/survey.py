"""Unchanged files of an archive: `python -m tests.benchmarks survey [--files 500]`.

Copies of a recording with names of their own are surveyed once; the time a file of the second
survey, which finds them unchanged, is what a daily run costs for all earlier days.
"""

import argparse
import shutil
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from pipeline.archive.survey import SurveyCache, surveyed
from tests.benchmarks._results import keep

RECORDING = Path(__file__).parents[2] / "recordings" / "parked.mcap"


def main(arguments: Sequence[str]) -> None:
    """Measure, print, write the result."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks survey")
    parser.add_argument("--files", type=int, default=500)
    chosen = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = [folder / f"{number:05d}.mcap" for number in range(chosen.files)]
        for path in files:
            shutil.copy(RECORDING, path)
        cache = SurveyCache(folder / "surveys.pw")
        survey = surveyed(files[0])
        for path in files:
            cache.put(path, survey)
        started = time.process_time()
        found = [cache.get(path) for path in files]
        known = time.process_time() - started
        started = time.process_time()
        for path in files[:20]:
            surveyed(path)
        first = time.process_time() - started
        if None in found:
            raise RuntimeError("an unchanged file was not found again")
    result = {
        "files": chosen.files,
        "cpu_ms_a_file_unchanged": 1000 * known / chosen.files,
        "cpu_ms_a_file_first": 1000 * first / 20,
    }
    print(result)
    keep(
        "survey",
        result,
        command=f"python -m tests.benchmarks survey --files {chosen.files}",
        depends=["pipeline/archive/survey.py"],
    )
