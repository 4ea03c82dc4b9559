"""From a file of measurements to a folder in which a run starts, with every guess stated."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.offline.new_project import guess_channel, start_project
from pipeline.recording.info import recording_info
from pipeline.run.options import SessionOptions
from pipeline.run.run import run_session
from pipeline.sources.sources import open_source, replayed
from sensors.errors import InputError
from sensors.structure.description import shipped_text

RATE = 20.0  # [Hz]


@pytest.fixture
def measurement(tmp_path: Path) -> Path:
    """Five minutes of two channels that a two-mass oscillator's noise would give."""
    times = np.arange(round(300 * RATE)) / RATE
    generator = np.random.default_rng(11)
    samples = generator.standard_normal((len(times), 2)).cumsum(axis=0)
    path = tmp_path / "mast.csv"
    table = np.column_stack([times, samples])
    np.savetxt(path, table, delimiter=",", header="time [s],LAT097_FA,LAT050_SS", comments="")
    return path


@pytest.mark.parametrize(
    ("name", "elevation", "direction"),
    [
        ("LAT097_FA", 97.0, (1, 0, 0)),
        ("z145-ss", 145.0, (0, 1, 0)),
        ("acc 44.1m x", 44.1, (1, 0, 0)),
        ("H_12.5_Y", 12.5, (0, 1, 0)),
        ("TOWER_80_SideSide", 80.0, (0, 1, 0)),
    ],
)
def test_height_and_axis_are_read_from_a_channels_name(
    name: str, elevation: float, direction: tuple[int, int, int]
) -> None:
    guessed = guess_channel(name, place=3)
    assert (guessed.elevation, guessed.direction) == (elevation, direction)
    assert guessed.height_known


@pytest.mark.parametrize("name", ["ch1", "channel 7", "AI0"])
def test_a_number_that_only_counts_is_no_height(name: str) -> None:
    guessed = guess_channel(name, place=3)
    assert not guessed.height_known
    assert guessed.elevation == 3.0
    assert "not in the name" in guessed.reason


def test_a_run_starts_in_the_folder_that_was_made(
    measurement: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = start_project([measurement], tmp_path / "mast")
    assert project.complete
    assert "97 m from" in (project.folder / "layout.toml").read_text()
    monkeypatch.chdir(project.folder)
    source = open_source(None)
    run_session(source, SessionOptions(way="lock-step", rrd=False))
    assert source.scenario.oma.window_duration == 300.0
    assert Path("out/session.mcap").exists()


def test_what_is_recorded_has_the_places_of_the_layout(measurement: Path, tmp_path: Path) -> None:
    project = start_project([measurement], tmp_path / "mast")
    (layout,) = recording_info(project.recording).layouts
    assert layout.elevations.tolist() == [97.0, 50.0]


def test_a_structure_of_ones_own_goes_into_the_folder_and_into_the_recording(
    measurement: Path, tmp_path: Path
) -> None:
    own = tmp_path / "own.toml"
    own.write_text(
        shipped_text("iea15mw_monopile").replace("thickness = 0.0", "thickness = 0.1", 1)
    )
    project = start_project([measurement], tmp_path / "mast", structure=str(own))
    assert (project.folder / "structure.toml").read_text() == own.read_text()
    own.unlink()
    assert replayed(project.recording).scenario.structure.tubes[0].thickness > 0.1


def test_nothing_is_overwritten(measurement: Path, tmp_path: Path) -> None:
    start_project([measurement], tmp_path / "mast")
    with pytest.raises(InputError, match="exists"):
        start_project([measurement], tmp_path / "mast")


def test_a_structure_needs_places_that_are_known(tmp_path: Path) -> None:
    path = tmp_path / "plain.csv"
    np.savetxt(path, np.zeros((100, 2)), delimiter=",", header="ch1,ch2", comments="")
    with pytest.raises(InputError, match="height and axis"):
        start_project([path], tmp_path / "out", structure="iea15mw_monopile", sampling_rate=RATE)
