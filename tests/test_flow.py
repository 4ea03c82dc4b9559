"""One recording, three ways of running the graph, one posterior.

lock-step    block ─► identification ─► updating             one thread, no transport
threads      source ═► identification ═► updating            ═► is Zenoh over loopback
processes    source ═► │identification│ ═► │updating│        each in a process of its own

The processes compute everything again. The threads take the answer to a window, to the bit the
same as that of the lock-step, from there; to any other they would compute their own.
"""

import json
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from pipeline.messages import FoundationPosterior, ModalEstimate, WindowRejected
from pipeline.offline.measured_file import recorded_channels
from pipeline.recording.reader import read_messages
from pipeline.run.options import SessionOptions, Way
from pipeline.run.run import run_session
from pipeline.run.update_recording import holds_estimates, update_from
from pipeline.scenario import scenario_from_text
from pipeline.sources.sources import record_simulation, replayed, replayed_with_structure, simulated
from sensors.acquisition.blocks import AccelerationBlock
from tests.identified_once import remembering


@pytest.fixture(scope="module")
def sessions(
    short_recording: Path,
    short_session: Path,
    identified_answers: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> dict[str, Path]:
    """The recording run in each way; the folder of each session."""
    folders = {"lock-step": short_session.parent}
    for way in set(get_args(Way)) - folders.keys():
        folders[way] = tmp_path_factory.mktemp(way)
        options = SessionOptions(out=folders[way], way=way, rrd=way == "threads")
        with remembering(identified_answers):
            run_session(replayed(short_recording), options)
    return folders


def session_of(recording: Path, out: Path, way: Way = "lock-step") -> None:
    run_session(replayed(recording), SessionOptions(out=out, way=way, rrd=False))


def posteriors(folder: Path) -> list[FoundationPosterior]:
    return list(read_messages(folder / "session.mcap", (FoundationPosterior,)))


def figures(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "summary.json").read_text())


def test_every_way_gives_bit_identical_posteriors(sessions: dict[str, Path]) -> None:
    reference = posteriors(sessions["lock-step"])
    assert len(reference) == 2
    for way in ("threads", "processes"):
        for ours, theirs in zip(posteriors(sessions[way]), reference, strict=True):
            np.testing.assert_array_equal(ours.draws, theirs.draws)
            assert ours.parameters == theirs.parameters
            assert ours.pairs == theirs.pairs


def test_every_way_records_every_block_as_it_was_published(
    sessions: dict[str, Path], short_recording: Path
) -> None:
    published = list(read_messages(short_recording, (AccelerationBlock,)))
    for folder in sessions.values():
        recorded = list(read_messages(folder / "session.mcap", (AccelerationBlock,)))
        assert [block.sequence for block in recorded] == [block.sequence for block in published]
        for ours, theirs in zip(recorded, published, strict=True):
            np.testing.assert_array_equal(ours.samples, theirs.samples)


def test_a_session_loses_nothing_and_says_so(sessions: dict[str, Path]) -> None:
    for folder in sessions.values():
        stream = figures(folder)["stream"]
        assert stream.pop("recovered") >= 0  # a busy machine keeps some on their way for long
        assert stream == {
            "published": 240,
            "recorded": 240,
            "lost": 0,
            "late": 0,
            "duplicate": 0,
            "gaps": 0,
            "gap_s": 0.0,
        }


@pytest.mark.usefixtures("identified_before")
def test_the_recorded_session_can_be_replayed_to_the_same_posterior(
    sessions: dict[str, Path], tmp_path: Path
) -> None:
    session_of(sessions["threads"] / "session.mcap", tmp_path)
    again, first = posteriors(tmp_path), posteriors(sessions["lock-step"])
    np.testing.assert_array_equal(again[-1].draws, first[-1].draws)


def test_the_summary_names_the_truth_and_how_the_posterior_was_sampled(
    sessions: dict[str, Path],
) -> None:
    summary = figures(sessions["threads"])
    assert summary["posterior"]["sampler"] == "laplace"  # figures of the structure uncertain
    assert summary["posterior"]["k11"]["truth_ratio"] == 1.0
    assert summary["windows"]["identified"] == 2
    assert summary["duration_s"] == 240.0


def test_pictures_are_written_only_where_they_were_wanted(sessions: dict[str, Path]) -> None:
    assert (sessions["threads"] / "session.rrd").stat().st_size > 100_000
    assert not (sessions["lock-step"] / "session.rrd").exists()


def test_estimates_carry_the_names_of_their_channels(sessions: dict[str, Path]) -> None:
    (estimate, _) = read_messages(sessions["threads"] / "session.mcap", (ModalEstimate,))
    assert estimate.channels[:2] == ("z41-fa", "z80-fa")


@pytest.mark.usefixtures("identified_before")
@pytest.mark.parametrize("identify", [True, False])
def test_updating_from_a_recording_gives_the_sessions_posterior(
    sessions: dict[str, Path], identify: bool
) -> None:
    recording = sessions["threads"] / "session.mcap"
    assert holds_estimates(recording)
    source = replayed_with_structure(recording)
    summary = update_from(source, identify=identify)
    reference = posteriors(sessions["lock-step"])[-1]
    assert summary.main.posterior is not None
    np.testing.assert_array_equal(summary.main.posterior.draws, reference.draws)
    ours, theirs = summary.as_json(wall=1.0), figures(sessions["lock-step"])
    assert ours.keys() == theirs.keys()
    for key in ("modes", "posterior", "windows", "duration_s"):
        assert ours[key] == theirs[key]


@pytest.mark.usefixtures("identified_before")
def test_a_sessions_folder_is_updated_from_as_its_recording(sessions: dict[str, Path]) -> None:
    folder = sessions["threads"]
    assert holds_estimates(folder)
    summary = update_from(replayed_with_structure(folder), identify=False)
    assert summary.main.posterior is not None
    draws = posteriors(sessions["lock-step"])[-1].draws
    np.testing.assert_array_equal(summary.main.posterior.draws, draws)


TWO_UNITS = """
title = "Half a tower each, on two clocks"
seed = 4

[simulation]
duration = 125.0
transient = 60.0
units = [
  {name = "lower", elevations = [41.0, 80.0]},
  {name = "upper", elevations = [106.0, 145.0], start = 0.4, clock_drift = 30.0},
]

[oma]
window_duration = 120.0
hop = 120.0
highest_frequency = 4.0

[updating.pairing]
search_draws = 100
refined = 2

[updating.sampling.importance]
effective_draws = 100.0

[structure]
uncertain = "exact"
"""


@pytest.mark.nightly
def test_two_units_give_the_same_posterior_in_lock_step_over_zenoh_and_replayed(
    tmp_path: Path, identified_answers: Path
) -> None:
    """What is replayed is what the run in threads recorded; its windows go by their samples."""
    recording = tmp_path / "two.mcap"
    record_simulation(simulated(scenario_from_text(TWO_UNITS, "two.toml")), recording)
    with remembering(identified_answers):
        session_of(recording, tmp_path / "lock-step")
    session_of(recording, tmp_path / "threads", way="threads")
    with remembering(identified_answers):
        session_of(tmp_path / "threads" / "session.mcap", tmp_path / "again")
    (reference,) = posteriors(tmp_path / "lock-step")
    for folder in ("threads", "again"):
        refused = read_messages(tmp_path / folder / "session.mcap", (WindowRejected,))
        assert [each.code for each in refused] == ["short"], folder
        (posterior,) = posteriors(tmp_path / folder)
        np.testing.assert_array_equal(posterior.draws, reference.draws)
    (estimate,) = read_messages(tmp_path / "threads" / "session.mcap", (ModalEstimate,))
    assert len(estimate.channels) == 8
    table = recorded_channels([recording]).table
    assert table.names == estimate.channels
    assert table.samples.shape[0] == pytest.approx(124.6 * 40, abs=40)
    assert figures(tmp_path / "threads")["stream"]["lost"] == 0
