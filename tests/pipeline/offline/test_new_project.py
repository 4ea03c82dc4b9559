"""From a file of measurements to a folder in which a run starts, with every guess stated."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.offline.new_project import start_project
from pipeline.recording.info import recording_info
from pipeline.recording.reader import read_messages
from pipeline.run.options import SessionOptions
from pipeline.run.run import run_session
from pipeline.sources.sources import open_source, replayed
from sensors.acquisition.scada import ScadaSample
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


def test_columns_of_controller_and_logger_are_no_motions(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    count = round(300 * RATE)
    columns = {
        "time [s]": np.arange(count) / RATE,
        "acc_85m_x [g]": rng.standard_normal(count) * 1e-3,
        "acc_50m_x [g]": rng.standard_normal(count) * 1e-3,
        "acc_25m_x [g]": np.full(count, 0.25),
        "SG_10m_x [ue]": rng.standard_normal(count),
        "Power [kW]": np.zeros(count),
        "BattV": np.full(count, 12.6),
        "WindSpeed [m/s]": rng.uniform(5, 7, count),
    }
    path = tmp_path / "mixed.csv"
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="")
    project = start_project([path], tmp_path / "out")
    assert [each.name for each in project.channels] == ["acc_85m_x", "acc_50m_x"]
    reasons = {each.name: each.reason for each in project.left_out}
    assert reasons["acc_25m_x"] == "constant over the record"
    assert reasons["SG_10m_x"] == "a displacement, beside accelerations"
    assert set(reasons) == {"acc_25m_x", "SG_10m_x", "Power", "BattV", "WindSpeed"}
    recorded = list(read_messages(project.recording, (ScadaSample,)))
    assert len(recorded) == 30
    assert all(each.power == 0 and 5 < each.wind_speed < 7 for each in recorded)
