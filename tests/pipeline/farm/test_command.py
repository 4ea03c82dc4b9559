"""`pilewatch farm`, from recordings and from what runs; its files are what they say."""

import json
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.farm import farm, sources
from pipeline.farm.farm import PoolingSettings, pooled_farm
from pipeline.farm.results import pooled_posterior
from pipeline.farm.settings import FarmError, GibbsSettings
from pipeline.farm.sources import RunningFarm, recorded_turbines
from pipeline.messages import FoundationPosterior
from pipeline.recording.writer import Recorder, whole_recording
from pipeline.transport.codec import decode, encode
from pipeline.transport.zenoh_bus import ZenohBus, free_endpoint, hub
from pipeline.updating.population import load_population
from sensors.errors import InputError
from tests.pipeline.example_messages import same
from tests.pipeline.farm.farms import drawn_farm, untrusted
from tests.pipeline.transport.memory_bus import MemoryBus

BRIEF = PoolingSettings(gibbs=GibbsSettings(chains=8, burn_in=10, sweeps=20, rounds=1))


@pytest.fixture(autouse=True)
def brief(monkeypatch: pytest.MonkeyPatch) -> None:
    """Chains that say little, and say it at once."""
    monkeypatch.setattr(farm, "PoolingSettings", lambda: BRIEF)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two recordings: three turbines, and one of which nothing can be had."""
    folder = tmp_path_factory.mktemp("farm")
    posteriors, _ = drawn_farm(4, seed=1)
    posteriors[3] = untrusted(posteriors[3])
    for name, some in (("north", posteriors[:2]), ("south", posteriors[1:])):
        recorder = Recorder(folder / f"{name}.mcap", metadata={}, clock=None)
        for each in some:
            recorder.handle(each)
        recorder.close()
    return folder


def test_a_farm_waits_no_longer_than_it_says(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    class EmptyInbox:
        def get(self, timeout: float) -> None:
            asked.append(timeout)

        def put(self, _: object) -> None: ...

    monkeypatch.setattr(sources, "Inbox", EmptyInbox)
    with pytest.raises(FarmError, match="no posterior came"):
        RunningFarm(MemoryBus()).messages()
    (patience,) = asked
    assert 0 < patience <= sources.FIRST_PATIENCE


def test_recordings_become_a_table_a_prior_and_figures(recorded: Path, tmp_path: Path) -> None:
    prior, parquet = tmp_path / "prior.json", tmp_path / "farm.parquet"
    options = ["--prior", str(prior), "--table", str(parquet), "--json"]
    finished = CliRunner().invoke(app, ["farm", str(recorded), *options])
    assert finished.exit_code == 0, finished.output
    told = json.loads(finished.stdout)
    assert [each["turbine"] for each in told["turbines"]] == ["t1", "t2", "t3"]
    assert told["left_out"] == [{"turbine": "t4", "reason": "its posterior is not trusted"}]
    spring = told["turbines"][0]["pooled"]["k22"]
    assert spring["ratio_p05"] < spring["ratio_median"] < spring["ratio_p95"]
    assert load_population(prior).turbines == ("t1", "t2", "t3")
    rows = pq.read_table(parquet).to_pylist()
    assert len(rows) == 9
    assert rows[1]["parameter"] == "k22"
    assert rows[1]["pooled_median"] == spring["median"]
    for whose in ("own", "pooled"):
        told_of = told["turbines"][0][whose]["k22"]
        ratios = [rows[1][f"{whose}_{each}"] / rows[1]["nominal"] for each in ("p05", "p95")]
        assert ratios == pytest.approx([told_of["ratio_p05"], told_of["ratio_p95"]])
    assert rows[0]["time"].year == 2023


def test_people_get_a_table_and_what_was_left_out(recorded: Path) -> None:
    told = CliRunner().invoke(app, ["farm", str(recorded)], env={"COLUMNS": "40"}).output
    assert "3 turbines pooled" in told
    assert "t4 left out: its posterior is not trusted" in told


def test_the_last_posterior_of_each_turbine_is_read(recorded: Path) -> None:
    assert sorted(each.turbine for each in recorded_turbines([recorded])) == [
        "t1", "t2", "t3", "t4",
    ]  # fmt: skip


def session_of(folder: Path, *posteriors: FoundationPosterior) -> Path:
    """A session's folder with these posteriors."""
    folder.mkdir(parents=True)
    with whole_recording(folder / "session.mcap", metadata={}) as recorder:
        for each in posteriors:
            recorder.handle(each)
    return folder


def test_a_session_that_is_not_used_is_named_with_the_reason(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (one, other), _ = drawn_farm(2, seed=1)
    later = replace(one, time_ns=one.time_ns + 600 * 10**9)
    old, new = session_of(tmp_path / "old", one), session_of(tmp_path / "new", later)
    rest = session_of(tmp_path / "rest", other)
    for paths in ([old, rest, new], [new, rest, old]):
        caplog.clear()
        found = recorded_turbines(paths)
        assert {each.turbine for each in found} == {"t1", "t2"}
        (line,) = caplog.messages
        assert line.startswith(f"t1: the posterior in {old / 'session.mcap'} (2023-")
        assert f"is not used: {new / 'session.mcap'} has a later one (2023-" in line
    caplog.clear()
    recorded_turbines([old, session_of(tmp_path / "copy", one)])
    assert "has one of the same time and was given later" in caplog.text


def test_a_folder_of_sessions_is_read_and_one_without_a_closed_recording_says_what_to_do(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    posteriors, _ = drawn_farm(3, seed=1)
    for each in posteriors:
        session_of(tmp_path / "farm" / each.turbine, each)
    assert len(recorded_turbines([tmp_path / "farm"])) == 3
    assert not caplog.messages
    killed = tmp_path / "farm" / "t1"
    (killed / "session.mcap").rename(killed / "session.mcap.active")
    with pytest.raises(FarmError, match=r"holds only session\.mcap\.active.*pilewatch salvage"):
        recorded_turbines([killed])
    assert len(recorded_turbines([tmp_path / "farm"])) == 2
    assert f"not used: the folder {killed} holds only session.mcap.active" in caplog.text


def test_nothing_recorded_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(FarmError, match="holds no recording"):
        recorded_turbines([tmp_path])
    Recorder(tmp_path / "empty.mcap", metadata={}, clock=None).close()
    with pytest.raises(FarmError, match="no posterior is recorded in"):
        recorded_turbines([tmp_path])


def test_recordings_and_a_session_that_runs_exclude_each_other() -> None:
    finished = CliRunner().invoke(app, ["farm", "x.mcap", "--follow"])
    assert isinstance(finished.exception, InputError)
    assert "exclude them" in str(finished.exception)


def test_a_session_that_runs_gives_what_it_published_before_anybody_asked() -> None:
    posteriors, _ = drawn_farm(3, seed=2)
    endpoint = free_endpoint()
    bus = ZenohBus(hub(endpoint))
    try:
        for each in posteriors:
            bus.publish(each)
        finished = CliRunner().invoke(app, ["farm", "--connect", endpoint, "--json"])
    finally:
        bus.close()
    assert finished.exit_code == 0, finished.output
    assert len(json.loads(finished.stdout)["turbines"]) == 3


def test_a_session_without_a_posterior_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sources, "FIRST_PATIENCE", 0.05)
    with pytest.raises(FarmError, match=r"no posterior came in 0\.05 s"):
        RunningFarm(MemoryBus()).messages()


def test_a_farm_that_is_followed_is_pooled_again_with_each_new_posterior() -> None:
    posteriors, _ = drawn_farm(3, seed=3)
    bus, stopping = MemoryBus(), threading.Event()
    running = RunningFarm(bus)
    bus.publish(posteriors[0])
    bus.publish(posteriors[1])
    sizes = []
    for latest in running.rounds(stopping, quiet=0.01):
        sizes.append(len(latest))
        if len(sizes) == 2:
            stopping.set()
        else:
            bus.publish(posteriors[2])
    assert sizes == [2, 3]


def test_a_pooled_posterior_travels_as_it_is() -> None:
    posteriors, _ = drawn_farm(2, seed=4)
    found = pooled_farm(posteriors, BRIEF)
    message = pooled_posterior(found, found.turbines[0])
    assert message.n_turbines == 2
    assert same(decode(type(message), encode(message)), message)
    assert np.isfinite([each.median for each in message.parameters]).all()
