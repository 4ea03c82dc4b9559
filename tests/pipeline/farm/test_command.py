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
from pipeline.messages import FoundationEvent, FoundationPosterior
from pipeline.recording.writer import Recorder, whole_recording
from pipeline.transport.codec import decode, encode
from pipeline.transport.zenoh_bus import ZenohBus, free_endpoint, hub
from pipeline.updating.population import load_population
from sensors.errors import InputError
from tests.pipeline.example_messages import same
from tests.pipeline.farm.farms import drawn_farm, event_of, untrusted
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


def session_of(folder: Path, *messages: FoundationPosterior | FoundationEvent) -> Path:
    """A session's folder with these posteriors and events."""
    folder.mkdir(parents=True)
    with whole_recording(folder / "session.mcap", metadata={}) as recorder:
        for each in messages:
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


def lost_at(posterior: FoundationPosterior, since_ns: int) -> FoundationEvent:
    """Of the posterior's turbine, so long after it [ns]; dated to within ten minutes."""
    since_ns += posterior.time_ns
    event: FoundationEvent = event_of(posterior, -0.1)
    return replace(
        event,
        time_ns=since_ns + 3600 * 10**9,
        since_ns=since_ns,
        since_earliest_ns=since_ns - 600 * 10**9,
        since_latest_ns=since_ns + 600 * 10**9,
    )


def test_of_a_time_that_several_sessions_saw_only_the_latest_ones_events_count(
    tmp_path: Path,
) -> None:
    """The same days analysed twice date one loss ten minutes apart; of a year before, analysed
    twice as well, the later analysis counts. What an overlapping session saw before is kept."""
    (one, other), _ = drawn_farm(2, seed=1)
    hour = 3600 * 10**9

    def session(name: str, first: int, last: int, *losses: int) -> Path:
        """With posteriors and losses at these hours, its turbine among those that changed."""
        ends = [replace(one, time_ns=one.time_ns + each * hour) for each in (first, last)]
        events = [lost_at(one, each * hour) for each in losses]
        return session_of(tmp_path / name, *ends, *events)

    year, again = session("year", -9000, -8000, -8500), session("again", -9001, -8000, -8501)
    before = session("before", -60, -20, -50, -30)
    used = session("used", -40, 0, -31)
    rest = session_of(tmp_path / "rest", other, lost_at(other, 0))
    for paths in ([year, again, before, used, rest], [rest, used, before, year, again]):
        found = [each for each in recorded_turbines(paths) if isinstance(each, FoundationEvent)]
        dated = sorted((e.turbine, (e.since_ns - one.time_ns) // hour) for e in found)
        assert dated == [("t1", -8501), ("t1", -50), ("t1", -31), ("t2", 0)]


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
