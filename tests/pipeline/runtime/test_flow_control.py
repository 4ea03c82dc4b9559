"""A replay goes as fast as its slowest node, and is over when everything is handled."""

import pytest

from pipeline.messages import FoundationPosterior, ModalEstimate, NodeStatus
from pipeline.runtime.flow_control import Credit, Quiet, is_drained
from sensors.acquisition.blocks import AccelerationBlock
from tests.pipeline.example_messages import status

CONSUMERS = {
    "identification": (AccelerationBlock,),
    "updating": (ModalEstimate,),
    "recorder": (AccelerationBlock, ModalEstimate, FoundationPosterior, NodeStatus),
}


def test_no_more_blocks_than_allowed_are_on_their_way() -> None:
    credit = Credit(["identification"], 3)
    assert [credit.may_send(sequence, []) for sequence in range(5)] == [True] * 3 + [False] * 2


def test_the_slowest_node_sets_the_pace() -> None:
    credit = Credit(["identification", "recorder"], 2)
    for sequence in range(2):
        credit.may_send(sequence, [])
    fast, slow = status("recorder", last_sequence=1), status("identification", last_sequence=-1)
    assert not credit.may_send(2, [fast, slow])
    assert credit.may_send(2, [fast, status("identification", last_sequence=0)])


def test_a_gap_in_the_numbers_holds_nothing_up() -> None:
    credit = Credit(["identification"], 2)
    assert credit.may_send(0, [])
    assert credit.may_send(1000, [])
    assert not credit.may_send(1001, [])
    assert credit.may_send(1001, [status("identification", last_sequence=1000)])


def test_numbers_that_start_again_with_a_new_session_hold_nothing_up() -> None:
    credit = Credit(["identification"], 2)
    handled = -1
    for sequence in (998, 999, 0, 1, 2):
        assert credit.may_send(sequence, [status("identification", last_sequence=handled)])
        handled = sequence


def test_an_old_status_gives_no_new_credit() -> None:
    credit = Credit(["identification"], 1)
    first = status("identification", last_sequence=0)
    assert credit.may_send(0, [])
    assert credit.may_send(1, [first])
    assert not credit.may_send(2, [first])


def test_nodes_that_take_no_blocks_do_not_matter() -> None:
    credit = Credit(["identification"], 1)
    assert credit.may_send(0, [status("updating")])
    assert credit.may_send(1, [status("identification", last_sequence=0), status("updating")])


def test_at_least_one_block_must_be_allowed() -> None:
    with pytest.raises(ValueError, match="at least 1"):
        Credit(["identification"], 0)


def finished() -> list[NodeStatus]:
    return [
        status("source", published={"AccelerationBlock": 3600}),
        status(
            "identification",
            received={"AccelerationBlock": 3600},
            published={"ModalEstimate": 6},
        ),
        status("updating", received={"ModalEstimate": 6}, published={"FoundationPosterior": 6}),
        status(
            "recorder",
            received={"AccelerationBlock": 3600, "ModalEstimate": 6, "FoundationPosterior": 6},
        ),
    ]


def test_a_run_is_over_when_everything_published_has_been_handled() -> None:
    assert is_drained(finished(), CONSUMERS)


@pytest.mark.parametrize(
    "behind",
    [
        status("identification", received={"AccelerationBlock": 3599}),
        status("updating", received={"ModalEstimate": 5}),
        status(
            "recorder",
            received={"AccelerationBlock": 3600, "ModalEstimate": 6, "FoundationPosterior": 5},
        ),
    ],
    ids=lambda late: late.node,
)
def test_a_run_is_not_over_while_one_node_is_behind(behind: NodeStatus) -> None:
    assert not is_drained([*finished(), behind], CONSUMERS)


def test_a_run_is_not_over_before_every_node_has_spoken() -> None:
    assert not is_drained(finished()[:-1], CONSUMERS)


def test_blocks_that_are_known_to_be_lost_are_not_waited_for() -> None:
    losing = status(
        "identification",
        received={"AccelerationBlock": 3590},
        published={"ModalEstimate": 6},
        lost=10,
    )
    assert is_drained([*finished(), losing], CONSUMERS)


def test_nodes_are_quiet_when_they_have_said_the_same_for_three_seconds() -> None:
    """A status a second: four alike span three; a new count begins the waiting again."""
    quiet = Quiet()
    same = status("updating", received={"ModalEstimate": 6})
    for _ in range(3):
        quiet.note(same)
        assert not quiet.of_all(["updating"])
    quiet.note(same)
    assert quiet.of_all(["updating"])
    assert not quiet.of_all(["updating", "recorder"])  # of which nothing was heard
    quiet.note(status("updating", received={"ModalEstimate": 7}))
    assert not quiet.of_all(["updating"])
