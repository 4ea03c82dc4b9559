"""Only windows that may, speak of the foundation; every turbine has its own updater."""

from collections.abc import Iterable
from dataclasses import replace

from pipeline.messages import Message, ModalEstimate, QualityWarning, WindowRejected
from pipeline.nodes.operating_state import CHANGING, OperationSettings
from pipeline.nodes.updating import UpdatingInContext
from tests.pipeline.example_estimates import estimate
from tests.pipeline.example_messages import LAYOUT


class Counting:
    """An updating node that says what reached it."""

    name = "updating"
    inputs = (ModalEstimate,)

    def __init__(self) -> None:
        self.taken: list[ModalEstimate] = []

    def handle(self, message: Message) -> Iterable[Message]:
        assert isinstance(message, ModalEstimate)
        self.taken.append(message)
        return ()

    def close(self) -> None: ...


def gate(*, allowed: tuple[str, ...] = ("parked",)) -> tuple[UpdatingInContext, list[Counting]]:
    made: list[Counting] = []

    def make() -> Counting:
        made.append(Counting())
        return made[-1]

    return UpdatingInContext(make, LAYOUT, OperationSettings(allowed)), made


def test_only_windows_of_the_allowed_states_reach_the_updater() -> None:
    node, (updater,) = gate()
    for state in ("parked", "operating", CHANGING, ""):
        answers = list(node.handle(replace(estimate(), operating_state=state)))
        refused = [answer for answer in answers if isinstance(answer, WindowRejected)]
        assert bool(refused) == (state in ("operating", CHANGING))
        if refused:
            assert refused[0].code == "operating-state"
            assert f"the turbine was {state}" in refused[0].reason
    assert [taken.operating_state for taken in updater.taken] == ["parked", ""]


def test_a_window_whose_shapes_are_spoilt_is_not_used() -> None:
    node, (updater,) = gate()
    doubtful = replace(estimate(), warnings=(QualityWarning("clipped", "z145-ss is clipped"),))
    (refused,) = node.handle(doubtful)
    assert isinstance(refused, WindowRejected)
    assert (refused.code, refused.reason) == ("clipped", "z145-ss is clipped; not used")
    assert not updater.taken


def test_each_turbine_has_an_updater_of_its_own() -> None:
    node, made = gate()
    for turbine in ("t1", "t2", "t1"):
        node.handle(estimate(turbine=turbine))
    assert [len(each.taken) for each in made] == [2, 1]
