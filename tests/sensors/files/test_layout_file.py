"""A layout file states what a measurement's own file leaves open: places, time, units."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from sensors.acquisition.layout import LayoutError
from sensors.files.formats import read_file
from sensors.files.layout_file import load_layout
from sensors.files.table import FileError

RATE = 50.0  # [Hz]
SAMPLES = np.round(np.random.default_rng(8).normal(size=(40, 1)), 6)
TICKS = 20 * np.arange(len(SAMPLES))  # [ms]
CHANNEL = '[[channels]]\nname = "a"\nelevation = 80.0\ndirection = [1, 0, 0]\n'


def layout(folder: Path, time: str) -> Path:
    path = folder / "layout.toml"
    path.write_text(f"{CHANNEL}[time]\n{time}\n", encoding="utf-8")
    return path


def write_text(path: Path) -> None:
    rows = [f"{tick},{float(value)!r},1" for tick, value in zip(TICKS, SAMPLES[:, 0], strict=True)]
    path.write_text("\n".join(["Messpunkt,a [m/s²],date", *rows]) + "\n")


def write_parquet(path: Path) -> None:
    parquet.write_table(pa.table({"Messpunkt": TICKS, "a [m/s²]": SAMPLES[:, 0]}), path)


def write_npz(path: Path) -> None:
    np.savez(path, **{"Messpunkt": TICKS, "a [m/s²]": SAMPLES[:, 0]})


WRITERS = {"csv": write_text, "parquet": write_parquet, "npz": write_npz}


@pytest.mark.parametrize("suffix", WRITERS)
def test_a_layout_states_which_column_is_the_time_and_in_what_unit(
    tmp_path: Path, suffix: str
) -> None:
    path = tmp_path / f"measured.{suffix}"
    WRITERS[suffix](path)
    mapping = load_layout(layout(tmp_path, 'column = "Messpunkt"\nunit = "ms"'))
    table = read_file(path, wanted=mapping.wanted())
    assert table.names == ("a",)
    np.testing.assert_array_equal(table.samples, SAMPLES)
    assert table.sampling_rate == pytest.approx(RATE)
    assert table.start_ns == 0


@pytest.mark.parametrize("suffix", WRITERS)
def test_a_time_that_the_file_lacks_is_one_line(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"measured.{suffix}"
    WRITERS[suffix](path)
    mapping = load_layout(layout(tmp_path, 'column = "t"'))
    with pytest.raises(FileError, match=r"no (column|series) 't' to be the time; it has Messpunkt"):
        read_file(path, wanted=mapping.wanted())


def test_a_unit_of_time_that_is_none_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(LayoutError, match=r"unit is 'm/s'; it can be s, ms"):
        load_layout(layout(tmp_path, 'column = "t"\nunit = "m/s"'))


def test_a_unit_of_time_without_a_column_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(LayoutError, match="unit is 'ms', but no column is named"):
        load_layout(layout(tmp_path, 'unit = "ms"'))


def test_a_layout_states_what_comes_first_in_its_dates(tmp_path: Path) -> None:
    path = tmp_path / "measured.csv"
    rows = [f"03/04/2024 12:00:0{i},{i}" for i in range(4)]
    path.write_text("\n".join(["time,a", *rows]))
    mapping = load_layout(layout(tmp_path, 'dates = "day-first"'))
    start = np.datetime64(read_file(path, wanted=mapping.wanted()).start_ns, "ns")
    assert str(start.astype("datetime64[D]")) == "2024-04-03"


def test_a_layout_with_all_heights_at_sea_level_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "layout.toml"
    path.write_text(CHANNEL.replace("80.0", "0.0"))
    with pytest.raises(LayoutError, match="elevation is 0 for all 1 channels; fill in"):
        load_layout(path)
    path.write_text(CHANNEL.replace("80.0", "0.0").replace("[1, 0, 0]", "[0, 0, 1]"))
    assert load_layout(path).channels[0].elevation == 0.0  # a vertical sensor on a bridge's deck


def test_a_sensitivity_turns_volts_into_what_the_sensor_measures(tmp_path: Path) -> None:
    """0.1 V per g: a volt is ten g."""
    path = tmp_path / "layout.toml"
    path.write_text(f'{CHANNEL}unit = "g"\nsensitivity = 0.1\n', encoding="utf-8")
    measured = tmp_path / "volts.csv"
    volts = ["0.5", "-1.0", "0.25"]
    measured.write_text("\n".join(["time [s],a", *(f"{i / 50},{v}" for i, v in enumerate(volts))]))
    table = load_layout(path).chosen(read_file(measured))
    assert table.units == ("m/s²",)
    np.testing.assert_allclose(table.samples[:, 0], 98.0665 * np.array([0.5, -1.0, 0.25]))


def test_a_sensor_without_any_sensitivity_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "layout.toml"
    path.write_text(f'{CHANNEL}unit = "g"\nsensitivity = 0.0\n', encoding="utf-8")
    with pytest.raises(LayoutError, match="sensitivity is 0"):
        load_layout(path)


@pytest.mark.parametrize(
    ("statement", "quantities"),
    [
        ('quantity = "velocity"\n', ("velocity", "acceleration", "displacement")),
        ("", None),  # phases may tell
    ],
)
def test_what_a_layout_says_of_one_channel_makes_the_unstated_ones_accelerations(
    tmp_path: Path, statement: str, quantities: tuple[str, ...] | None
) -> None:
    path = tmp_path / "layout.toml"
    others = [CHANNEL.replace('"a"', f'"{name}"') for name in ("b", "disp-c")]
    path.write_text("".join([CHANNEL, statement, *others]), encoding="utf-8")
    measured = tmp_path / "mixed.csv"
    measured.write_text("\n".join(["time [s],a,b,disp-c", *(f"{i / 50},1,2,3" for i in range(4))]))
    assert load_layout(path).chosen(read_file(measured)).quantities == quantities


@pytest.mark.parametrize(
    ("statement", "titles", "message"),
    [
        ('unit = "furlong"', "a,b", "channel 'a': unit 'furlong' is not known"),
        ("", "a [V],b [g]", "channel 'a' is in V, others are in m/s²: state its unit"),
    ],
)
def test_samples_of_no_known_scale_are_one_line(
    tmp_path: Path, statement: str, titles: str, message: str
) -> None:
    path = tmp_path / "layout.toml"
    path.write_text(f"{CHANNEL}{statement}\n" + CHANNEL.replace('"a"', '"b"'), encoding="utf-8")
    measured = tmp_path / "volts.csv"
    measured.write_text(f"time [s],{titles}\n0.0,0.5,1\n0.1,-1.0,2\n")
    with pytest.raises(LayoutError, match=message):
        load_layout(path).chosen(read_file(measured))


@pytest.mark.parametrize("height", ["1e300", "80000.0", "-80000"])
def test_a_height_that_no_structure_has_is_one_line(tmp_path: Path, height: str) -> None:
    path = tmp_path / "layout.toml"
    path.write_text(CHANNEL.replace("80.0", height))
    with pytest.raises(LayoutError, match="heights are in metres above mean water level"):
        load_layout(path)
