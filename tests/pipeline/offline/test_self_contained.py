"""A recording alone, mailed to another folder, gives the posterior that it was made with."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pipeline.messages import FoundationPosterior
from pipeline.offline.draw_recording import draw_recording
from pipeline.recording.reader import read_messages
from pipeline.report.canvas import PageFigure
from pipeline.report.page import write_page
from pipeline.report.recorded_session import read_session
from pipeline.run.options import SessionOptions
from pipeline.run.run import run_session
from pipeline.run.update_recording import update_from
from pipeline.scenario import load_scenario
from pipeline.sources.import_files import open_measurement, record_measurement
from pipeline.sources.sources import (
    record_simulation,
    replayed,
    replayed_with_structure,
    simulated,
)
from pipeline.viewer.outputs.outputs import RrdFile
from sensors.acquisition.blocks import AccelerationBlock
from sensors.files.layout_file import load_layout
from sensors.structure.description import shipped_text

pytestmark = pytest.mark.usefixtures("identified_once")

QUICK = """
seed = 5
[structure]
uncertain = "exact"
[sensors]
elevations = [80.0, 145.0]
[simulation]
duration = 120.0
transient = 60.0
[oma]
window_duration = 120.0
hop = 120.0
highest_frequency = 4.0
[updating.pairing]
search_draws = 100
refined = 2
[updating.sampling.importance]
effective_draws = 100
draws = 400
[turbine]
id = "tower"
"""


def shipped(path: Path) -> None:
    """Record a simulation of the shipped turbine."""
    Path("quick.toml").write_text(QUICK)
    record_simulation(simulated(load_scenario("quick.toml")), path)


def own_structure(path: Path) -> None:
    """Record a simulation of a turbine described beside the scenario."""
    described = shipped_text("iea15mw_monopile").replace("thickness = 0.0", "thickness = 0.1", 1)
    Path("own.toml").write_text(described)
    Path("quick.toml").write_text(QUICK + 'description = "own.toml"\n')
    record_simulation(simulated(load_scenario("quick.toml")), path)


def own_layout(path: Path) -> None:
    """Record a text file whose channels a layout file gives places, one of them turned round."""
    Path("quick.toml").write_text(QUICK + 'description = "iea15mw_monopile"\n')
    source = simulated(load_scenario("quick.toml"))
    blocks = [each for each in source.messages() if isinstance(each, AccelerationBlock)]
    samples = np.concatenate([each.samples for each in blocks])
    table = np.column_stack([np.arange(len(samples)) / 40.0, samples * [1, 1, -1, 1]])
    header = "time [s],a [m/s2],b [m/s2],c [m/s2],d [m/s2]"
    np.savetxt("own.csv", table, delimiter=",", header=header, comments="")
    places = zip("abcd", ((80, 1, 0), (145, 1, 0), (80, 0, -1), (145, 0, 1)), strict=True)
    Path("layout.toml").write_text(
        'turbine = "tower"\n'
        + "".join(
            f'[[channels]]\nname = "{name}"\nelevation = {z}\ndirection = [{x}, {y}, 0]\n'
            for name, (z, x, y) in places
        )
    )
    measurement = open_measurement([Path("own.csv")], layout=load_layout(Path("layout.toml")))
    record_measurement(measurement, path, scenario=load_scenario("quick.toml"))


@pytest.mark.parametrize(
    "record", [pytest.param(shipped, marks=pytest.mark.nightly), own_structure, own_layout]
)
def test_a_recording_gives_its_posterior_in_an_empty_folder(
    record: Callable[[Path], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home, elsewhere = tmp_path / "home", tmp_path / "elsewhere"
    home.mkdir()
    elsewhere.mkdir()
    monkeypatch.chdir(home)
    record(Path("tower.mcap"))
    made = _run(Path("tower.mcap"))
    shutil.move(home / "out" / "session.mcap", elsewhere / "mailed.mcap")
    shutil.rmtree(home / "out")
    for file in home.iterdir():
        file.unlink()
    monkeypatch.chdir(elsewhere)

    replayed_there = _run(Path("mailed.mcap"))
    np.testing.assert_array_equal(replayed_there.draws, made.draws)
    source = replayed_with_structure(Path("mailed.mcap"))
    updated = update_from(source, identify=False).main.posterior
    assert updated is not None
    np.testing.assert_array_equal(updated.draws, made.draws)
    draw_recording(Path("mailed.mcap"), (RrdFile(Path("mailed.rrd")),))
    # Figures are made of the recording; how they become SVG is the same for all recordings.
    monkeypatch.setattr(PageFigure, "svg", lambda _: "<svg></svg>")
    write_page(read_session(Path("mailed.mcap")), Path("report.html"))
    assert Path("mailed.rrd").stat().st_size > 0
    assert "tower" in Path("report.html").read_text()


def _run(recording: Path) -> FoundationPosterior:
    run_session(replayed(recording), SessionOptions(way="lock-step", rrd=False))
    (posterior,) = read_messages(Path("out/session.mcap"), (FoundationPosterior,))
    return posterior
