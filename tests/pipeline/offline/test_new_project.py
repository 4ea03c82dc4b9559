"""From a file of measurements to a folder in which a run starts, with every guess stated."""

import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.messages import ModalEstimate, WindowRejected
from pipeline.offline.new_project import start_project
from pipeline.recording.info import recording_info
from pipeline.recording.reader import read_messages
from pipeline.run.options import SessionOptions
from pipeline.run.run import run_session
from pipeline.sources.sources import default_scenario, open_source, replayed
from sensors.acquisition.scada import ScadaSample
from sensors.errors import InputError
from sensors.structure.description import shipped_text

pytestmark = pytest.mark.usefixtures("identified_once")

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


def test_an_edited_scenario_of_the_folder_is_the_one_that_a_run_takes(
    measurement: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run without options; the copy in the recording is older."""
    project = start_project([measurement], tmp_path / "mast")
    monkeypatch.chdir(project.folder)
    text = Path("scenario.toml").read_text()
    Path("scenario.toml").write_text(re.sub(r"= 300.0", "= 100.0", text))
    assert CliRunner().invoke(app, ["run", "--lock-step", "--no-rrd"]).exit_code == 0
    estimates = read_messages(Path("out/session.mcap"), (ModalEstimate, WindowRejected))
    assert len(list(estimates)) == 3
    Path("layout.toml").unlink()  # no folder of `new`: a scenario beside a recording by chance
    assert default_scenario() is None


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


@pytest.mark.parametrize(
    ("names", "missing"),
    [
        ("ch1,ch2", "'ch1' has no height and no axis in its name"),
        ("top FA,top SS", "'top FA' has no height in its name"),
        ("acc 97m fore-aft,acc 50m", "'acc 50m' has no axis in its name"),
    ],
)
def test_a_structure_needs_places_that_are_known(names: str, missing: str, tmp_path: Path) -> None:
    path = tmp_path / "plain.csv"
    np.savetxt(path, np.zeros((100, 2)), delimiter=",", header=names, comments="")
    with pytest.raises(InputError, match=f"height and axis of each channel; {missing}: give"):
        start_project([path], tmp_path / "out", structure="iea15mw_monopile", sampling_rate=RATE)


PLACES = """turbine = "t07"
[[channels]]
name = "ch2"
elevation = 44.0
direction = [1.0, 0.0, 0.0]
coupling = "ac"
corner_frequency = 0.1
"""


@pytest.fixture
def unplaced(tmp_path: Path) -> Path:
    """Half a minute of two channels and the rotor's speed, with names that say no place."""
    path = tmp_path / "plain.csv"
    table = np.random.default_rng(3).standard_normal((600, 4))
    table[:, 0] = np.arange(600) / RATE
    table[:, 3] = 7.0
    np.savetxt(path, table, delimiter=",", header="time [s],ch1,ch2,rotor_rpm", comments="")
    return path


def test_compass_directions_are_enough_for_a_structure(tmp_path: Path) -> None:
    samples = np.random.default_rng(5).standard_normal((6000, 2)).cumsum(axis=0)
    path = tmp_path / "mast.csv"
    header = "time [s],24m N30E,24m N120E"
    table = np.column_stack([np.arange(6000) / RATE, samples])
    np.savetxt(path, table, delimiter=",", header=header, comments="")
    project = start_project([path], tmp_path / "mast", structure="iea15mw_monopile")
    assert "x taken as north" in (project.folder / "layout.toml").read_text()


def test_a_layout_file_states_the_places_that_names_do_not(unplaced: Path, tmp_path: Path) -> None:
    """Also for a structure; its couplings hold, what it leaves out stays SCADA or is named."""
    stated = tmp_path / "places.toml"
    stated.write_text(PLACES)
    project = start_project(
        [unplaced], tmp_path / "out", layout=stated, structure="iea15mw_monopile"
    )
    assert project.complete
    assert (project.folder / "layout.toml").read_text() == PLACES
    assert {each.name: each.reason for each in project.left_out}["ch1"] == "not in the layout"
    assert project.conditions == ("rotor_rpm",)
    (layout,) = recording_info(project.recording).layouts
    assert (layout.turbine, layout.elevations.tolist()) == ("t07", [44.0])
    assert layout.channels[0].coupling == "ac"


def test_a_layout_file_that_lists_another_channel_is_named(unplaced: Path, tmp_path: Path) -> None:
    stated = tmp_path / "places.toml"
    stated.write_text(PLACES.replace("ch2", "ch7"))
    with pytest.raises(InputError, match=r"places.toml: the measurement has no channel 'ch7'"):
        start_project([unplaced], tmp_path / "out", layout=stated)
    assert not (tmp_path / "out").exists()


def test_a_layout_file_names_the_turbine(unplaced: Path, tmp_path: Path) -> None:
    stated = tmp_path / "places.toml"
    stated.write_text(PLACES)
    with pytest.raises(InputError, match=r"--name 't08': .*places.toml names the turbine 't07'"):
        start_project([unplaced], tmp_path / "out", layout=stated, name="t08")


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
        "acc_15m_x [g]": np.full(count, np.nan),
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
    assert reasons["acc_15m_x"] == "no value in any row"
    assert reasons["SG_10m_x"] == "a displacement, beside accelerations"
    assert set(reasons) == {"acc_25m_x", "acc_15m_x", "SG_10m_x", "Power", "BattV", "WindSpeed"}
    recorded = list(read_messages(project.recording, (ScadaSample,)))
    assert len(recorded) == 30
    assert all(each.power == 0 and 5 < each.wind_speed < 7 for each in recorded)


def test_a_channel_of_noise_alone_is_left_out_and_named(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    count = round(300 * RATE)
    lines = np.fft.rfftfreq(count, 1 / RATE)
    loads = rng.standard_normal(len(lines)) + 1j * rng.standard_normal(len(lines))
    moved = np.fft.irfft(loads / (1 - (lines / 1.1) ** 2 + 0.02j * lines / 1.1), count)
    columns = {
        "time [s]": np.arange(count) / RATE,
        "acc_85m_x [g]": 1e-3 * (moved + 0.1 * rng.standard_normal(count)),
        "acc_50m_x [g]": 1e-5 * rng.standard_normal(count),
        "acc_25m_x [g]": 1e-4 * (moved + 0.1 * rng.standard_normal(count)),
    }
    path = tmp_path / "broken.csv"
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="")
    project = start_project([path], tmp_path / "out")
    assert [each.name for each in project.channels] == ["acc_85m_x", "acc_25m_x"]
    (unused,) = project.left_out
    assert str(unused) == "acc_50m_x (noise alone: no resonance, nothing that another channel has)"


def local_summer_record(path: Path) -> Path:
    """Five minutes from 14:00 of Berlin's summer time, which the file does not state."""
    begin = np.datetime64("2025-07-03T14:00:00.000")
    stamps = begin + (np.arange(1500) * 200).astype("timedelta64[ms]")
    rows = np.random.default_rng(2).standard_normal((1500, 2))
    lines = [f"{t},{a:.5f},{b:.5f}" for t, (a, b) in zip(stamps, rows, strict=True)]
    path.write_text("\n".join(["time,LAT097_FA,LAT050_SS", *lines]))
    return path


def test_local_accelerations_meet_a_controllers_file_in_utc(tmp_path: Path) -> None:
    record = local_summer_record(tmp_path / "tower.csv")
    scada = tmp_path / "scada.csv"
    rows = [f"2025-07-03T{h:02d}:{m:02d}:00Z,8.5,300" for h in (11, 12) for m in range(60)]
    scada.write_text("\n".join(["timestamp,wind_speed_ms,power_kW", *rows]))
    project = start_project(
        [record], tmp_path / "made", zone="Europe/Berlin", scada=[scada], name="t1"
    )
    assert project.span_ns[0] == np.datetime64("2025-07-03T12:00:00", "ns").astype(int)
    assert project.conditions == ("wind_speed_ms", "power_kW")
    samples = list(read_messages(project.recording, (ScadaSample,)))
    assert len(samples) == 5  # those of the record
    assert (samples[0].wind_speed, samples[0].power) == (8.5, 300e3)
    late = tmp_path / "late.csv"
    late.write_text("timestamp,wind_speed_ms\n2025-07-03T15:00:00Z,8\n2025-07-03T15:01:00Z,8\n")
    with pytest.raises(InputError, match="has nothing of the measurement's 2025-07-03 14:00:00"):
        start_project([record], tmp_path / "other", scada=[late])
    assert not (tmp_path / "other").exists()


def test_levels_of_a_gauge_with_another_zero_are_doubted_until_the_zero_is_stated(
    tmp_path: Path,
) -> None:
    record = local_summer_record(tmp_path / "tower.csv")
    scada = tmp_path / "scada.csv"
    rows = [f"2025-07-03T14:{m:02d}:00Z,{1.2 + 0.2 * m:.1f}" for m in range(5)]
    scada.write_text("\n".join(["timestamp,water_level [m]", *rows]))
    chart = start_project([record], tmp_path / "chart", scada=[scada], name="t1")
    assert chart.water is not None
    assert chart.water.zero_doubted
    mean = start_project(
        [record], tmp_path / "mean", scada=[scada], name="t1", water_level_zero=-1.5
    )
    assert mean.water is not None
    assert not mean.water.zero_doubted
    found = (mean.water.mean, mean.water.lowest, mean.water.highest, mean.water.still)
    assert found == pytest.approx((0.1, -0.3, 0.5, 0.0))
    samples = list(read_messages(mean.recording, (ScadaSample,)))
    assert [each.water_level for each in samples] == pytest.approx([-0.3, -0.1, 0.1, 0.3, 0.5])


def test_what_is_left_out_of_a_controllers_file_is_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    record = local_summer_record(tmp_path / "tower.csv")
    scada = tmp_path / "scada.csv"
    rows = [f"2025-07-03T12:{m:02d}:00Z;8.5;0.2;17;4" for m in range(60)]
    titles = "Zeit;Wind [m/s];Rotordrehzahl [1/min];Öltemperatur [°C];Reserve"
    scada.write_text("\n".join([titles, *rows]), encoding="utf-8")
    project = start_project(
        [record], tmp_path / "made", zone="Europe/Berlin", scada=[scada], name="t1"
    )
    assert project.conditions == ("Wind", "Rotordrehzahl")
    (warning,) = (each for each in caplog.messages if "left out" in each)
    assert "scada.csv: left out: Öltemperatur [°C], Reserve;" in warning


def test_small_files_are_joined_by_the_times_in_their_names(
    measurement: Path, tmp_path: Path
) -> None:
    files = [tmp_path / f"mast_20250301_00{minute:02d}00.csv" for minute in (0, 5)]
    for file in files:
        file.write_text(measurement.read_text())
    project = start_project(files[::-1], tmp_path / "joined")
    begin, end = project.span_ns
    assert begin == np.datetime64("2025-03-01", "ns").astype(int)
    assert end - begin == 600 * 10**9


def test_a_channel_with_a_value_in_every_second_row_is_left_out_and_named(tmp_path: Path) -> None:
    rows = np.random.default_rng(4).standard_normal((400, 3))
    rows[1::2, 2] = np.nan
    path = tmp_path / "rates.csv"
    table = np.column_stack([np.arange(400) / 20, rows])
    np.savetxt(path, table, delimiter=",", header="t [s],A97x,A97y,A50x", comments="")
    project = start_project([path], tmp_path / "made")
    assert [each.name for each in project.channels] == ["A97x", "A97y"]
    assert "A50x (a value in every 2 rows: 10 Hz)" in map(str, project.left_out)


def test_springs_without_a_ratio_are_refused_at_once(measurement: Path, tmp_path: Path) -> None:
    own = tmp_path / "onshore.toml"
    text = shipped_text("iea15mw_monopile").replace("k12 = 0.678e11", "k12 = 0.0")
    own.write_text(text)
    with pytest.raises(InputError, match="of a tower that only rocks, k11 = 1e12 and k12 = 1e8"):
        start_project([measurement], tmp_path / "mast", structure=str(own))
    assert not (tmp_path / "mast").exists()


@pytest.mark.parametrize(
    ("own_zone", "zone", "begins", "is_open"),
    [
        (None, "", 12, True),
        (None, "Europe/Berlin", 10, False),
        ("Europe/Berlin", "", 12, False),
        ("Europe/Berlin", "America/Lima", 12, False),
        ("UTC", "", 12, False),
    ],
)
def test_a_zone_is_asked_for_only_where_the_dates_have_none(
    tmp_path: Path, own_zone: str | None, zone: str, begins: int, is_open: bool
) -> None:
    noon = np.datetime64("2025-07-03T12:00:00", "us").astype(int)
    stamps = pa.array((noon + 50_000 * np.arange(2000)).tolist(), pa.timestamp("us", own_zone))
    samples = np.random.default_rng(2).standard_normal((2, 2000))
    path = tmp_path / "tower.parquet"
    table = {"ts": stamps, "LAT097_FA": pa.array(samples[0]), "LAT050_SS": pa.array(samples[1])}
    parquet.write_table(pa.table(table), path)
    project = start_project([path], tmp_path / "made", zone=zone)
    start = np.datetime64(f"2025-07-03T{begins}:00:00", "ns").astype(int)
    assert (project.span_ns[0], project.zone_open) == (start, is_open)
    options = ["-o", str(tmp_path / "other"), "--yes", "--zone", zone]
    printed = CliRunner().invoke(app, ["new", str(path), *options]).output
    assert ("dates without a zone" in printed) == is_open
