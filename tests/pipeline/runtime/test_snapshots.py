"""An updating that was killed goes on to the posteriors it would have had, or says why not."""

import os
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.messages import FoundationPosterior, Message
from pipeline.nodes.node import NodeSnapshot
from pipeline.nodes.updating import LATEST_ANSWERS, TurbineUpdating, UpdatingNode
from pipeline.runtime.lock_step import NodeAccount
from pipeline.runtime.snapshots import SnapshotFolder
from pipeline.transport.codec import encode
from pipeline.updating.checkpoint import CheckpointError
from tests.pipeline.updating.small_tower import LAYOUT
from tests.pipeline.updating.test_state import estimate_of, updater_of

TURBINE = estimate_of(0).turbine


def node_in(folder: Path, *, past: Sequence[Message] = (), **options: object) -> UpdatingNode:
    """As a process that has just been started makes it."""
    store = SnapshotFolder(folder)
    return UpdatingNode(lambda _: TurbineUpdating(updater_of(**options)), store=store, past=past)


def last_posterior(node: UpdatingNode, windows: range) -> FoundationPosterior:
    answers = [answer for window in windows for answer in node.handle(estimate_of(window))]
    assert isinstance(answers[-1], FoundationPosterior)
    return answers[-1]


def assert_same(one: FoundationPosterior, other: FoundationPosterior) -> None:
    for field in fields(one):
        ours, theirs = getattr(one, field.name), getattr(other, field.name)
        if isinstance(ours, np.ndarray):
            np.testing.assert_array_equal(ours, theirs, err_msg=field.name)
        else:
            assert repr(ours) == repr(theirs), field.name


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> FoundationPosterior:
    """After four windows, never interrupted."""
    return last_posterior(node_in(tmp_path_factory.mktemp("whole")), range(4))


def test_a_node_killed_between_windows_continues_bit_for_bit(tmp_path, undisturbed):
    last_posterior(node_in(tmp_path), range(2))
    assert_same(last_posterior(node_in(tmp_path), range(2, 4)), undisturbed)


def test_estimates_that_come_again_after_a_restart_are_not_counted_twice(tmp_path, undisturbed):
    last_posterior(node_in(tmp_path), range(3))
    assert_same(last_posterior(node_in(tmp_path), range(4)), undisturbed)


def test_a_kill_before_the_checkpoint_was_written_answers_the_window_again(tmp_path, undisturbed):
    node = node_in(tmp_path)
    last_posterior(node, range(3))
    *_, published = _until_published(node, 3)
    assert_same(published, undisturbed)
    assert_same(last_posterior(node_in(tmp_path), range(3, 4)), undisturbed)


def _until_published(node: UpdatingNode, window: int) -> list:
    """The answers to a window, the node killed while the last one is on its way."""
    answers = NodeAccount(node, TURBINE, lambda: 0).handle(estimate_of(window))
    return [next(answers)]


def test_what_went_down_with_the_process_is_said_again_in_the_same_words(tmp_path):
    """As many windows as the node's publisher would still have had, for a recorder that was down
    too; nothing of those before."""
    node = node_in(tmp_path)
    said = [
        encode(a) for window in range(LATEST_ANSWERS + 1) for a in node.handle(estimate_of(window))
    ]
    restarted = node_in(tmp_path)
    again = [
        encode(a)
        for window in range(LATEST_ANSWERS + 1)
        for a in restarted.handle(estimate_of(window))
    ]
    assert again == said[1:]


@pytest.mark.parametrize(
    "turbine", ["t\0", "line\nbreak", "..", "a b", "Nørre Øst 7%", "long" * 500]
)
def test_whatever_a_turbine_is_called_its_updating_goes_on(tmp_path, turbine):
    folder = tmp_path / "checkpoints"
    node = node_in(folder)
    said = [encode(a) for a in node.handle(replace(estimate_of(0), turbine=turbine))]
    assert not node.statistics.warnings
    assert SnapshotFolder(folder).read(turbine) is not None
    again = node_in(folder).handle(replace(estimate_of(0), turbine=turbine))
    assert [encode(a) for a in again] == said
    (file,) = folder.iterdir()
    assert file == SnapshotFolder(folder).file_of(turbine)


def test_long_names_that_begin_alike_have_checkpoints_of_their_own(tmp_path):
    folder = SnapshotFolder(tmp_path)
    assert folder.file_of("long" * 500 + "a") != folder.file_of("long" * 500 + "b")


def test_a_disk_that_takes_no_checkpoint_costs_no_posterior_and_is_told(tmp_path, undisturbed):
    folder = tmp_path / "checkpoints"
    node = node_in(folder)
    node.begin(TURBINE)
    folder.write_text("in the way")
    for window in range(3):
        assert list(node.handle(estimate_of(window)))
        (doubt,) = node.statistics.warnings
        assert doubt.code == "checkpoint-not-written"
        assert str(folder) in doubt.text
    folder.unlink()
    *_, last = node.handle(estimate_of(3))
    assert_same(last, undisturbed)
    assert node.statistics.warnings == ()
    assert SnapshotFolder(folder).read(TURBINE) is not None


def test_half_a_file_beside_the_checkpoint_changes_nothing(tmp_path, undisturbed):
    last_posterior(node_in(tmp_path), range(3))
    (tmp_path / ".0a1b.part").write_bytes(b"pilewatch-no")
    assert_same(last_posterior(node_in(tmp_path), range(3, 4)), undisturbed)


def test_a_checkpoint_is_small(tmp_path):
    last_posterior(node_in(tmp_path), range(4))
    assert SnapshotFolder(tmp_path).file_of(TURBINE).stat().st_size < 200_000


def test_a_checkpoint_that_does_not_fit_is_one_line_at_the_start(tmp_path):
    last_posterior(node_in(tmp_path), range(1))
    path = SnapshotFolder(tmp_path).file_of(TURBINE)
    whole = path.read_bytes()
    for content, said in (
        (whole.replace(b"node 3", b"node 9", 1), "version 9 of the checkpoint's layout"),
        (whole.replace(b"node 3 0", b"node 2", 1), "version 2 of the checkpoint's layout"),
        (whole.replace(TURBINE.encode(), b"other", 1), f"'other', not of '{TURBINE}'"),
        (whole[:-7], "damaged"),
        (whole[:200], "damaged: its checksum is not that of its"),
        (whole.replace(b"FoundationPosterior", b"FoundationDiagnosis", 1), "damaged"),
        (b"\x00\x01", "no checkpoint"),
    ):
        path.write_bytes(content)
        with pytest.raises(CheckpointError, match=said) as raised:
            node_in(tmp_path).begin(TURBINE)
        assert "--fresh" in str(raised.value)
        assert "\n" not in str(raised.value)


def test_a_checkpoint_of_other_sensors_is_refused(tmp_path):
    last_posterior(node_in(tmp_path), range(1))
    fewer = replace(LAYOUT, channels=LAYOUT.channels[:-1])
    with pytest.raises(CheckpointError, match="channels"):
        node_in(tmp_path, layout=fewer).begin(TURBINE)


def test_of_too_many_checkpoints_those_not_renewed_for_longest_go(tmp_path, monkeypatch):
    monkeypatch.setattr("pipeline.runtime.snapshots.MOST_FILES", 3)
    folder = SnapshotFolder(tmp_path)
    for number, turbine in enumerate(["real", "b", "c", "real", "d", "real", "e"]):
        folder.write(turbine, NodeSnapshot(b"state"))
        os.utime(folder.file_of(turbine), ns=(number, number))  # clocks of disks are coarse
    kept = {turbine for turbine in ("real", "b", "c", "d", "e") if folder.read(turbine)}
    assert kept == {"real", "d", "e"}


def test_no_bit_of_a_checkpoint_flips_unseen(tmp_path):
    """On today's main 299 of 400 flips in the stored answers passed."""
    last_posterior(node_in(tmp_path), range(2))
    path = SnapshotFolder(tmp_path).file_of(TURBINE)
    whole = path.read_bytes()
    head = whole.index(b"\n")
    generator = np.random.default_rng(7)
    for place in generator.integers(head + 1, len(whole), size=200):
        flipped = bytearray(whole)
        flipped[place] ^= 1 << int(generator.integers(8))
        path.write_bytes(flipped)
        with pytest.raises(CheckpointError, match="damaged"):
            SnapshotFolder(tmp_path).read(TURBINE)


def test_a_node_that_remembers_nothing_is_kept_too(tmp_path):
    folder = SnapshotFolder(tmp_path)
    folder.write("t1", NodeSnapshot(b"", ()))
    assert folder.read("t1") == NodeSnapshot(b"", ())


def test_estimates_that_were_recorded_and_not_answered_enter_after_a_restart(tmp_path):
    """All of a run was killed while its updating was three windows behind."""
    undisturbed = last_posterior(node_in(tmp_path / "whole"), range(5))
    last_posterior(node_in(tmp_path / "killed"), range(1))
    past = [estimate_of(window) for window in range(4)]
    restarted = node_in(tmp_path / "killed", past=past)
    answers = list(restarted.handle(estimate_of(4)))
    assert [answer.window for answer in answers] == [1, 2, 3, 4]
    assert_same(answers[-1], undisturbed)


def test_a_run_that_was_taken_over_writes_no_snapshot_any_more(tmp_path):
    later, before = (SnapshotFolder(tmp_path, epoch=epoch) for epoch in (3, 2))
    before.write("t1", NodeSnapshot(b"first"))
    later.write("t1", NodeSnapshot(b"second"))
    with pytest.raises(OSError, match="run 3 has taken it over from run 2"):
        before.write("t1", NodeSnapshot(b"third"))
    assert later.read("t1") == NodeSnapshot(b"second")
