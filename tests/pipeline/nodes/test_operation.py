"""Windows know what the turbine was doing; only those that may, speak of the foundation."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from pipeline.messages import Message, ModalEstimate, Mode, Warning, WindowRejected  # noqa: A004
from pipeline.nodes.nacelle_axes import in_nacelle_axes, turning_matrix
from pipeline.nodes.operation import CHANGING, OperationLog, OperationSettings
from pipeline.nodes.updating_in_context import UpdatingInContext
from pipeline.oma.block_watch import BlockWatch
from pipeline.oma.channel_watch import ChannelWatch
from sensors.blocks import NANOSECONDS
from sensors.errors import InputError
from sensors.layout import SensorLayout
from sensors.scada import ScadaSample
from tests.pipeline.example_messages import LAYOUT, START_NS, block

WINDOW = 600  # [s]


def mode(frequency: float, shape: Iterable[float]) -> Mode:
    factor = np.zeros((10, 3))
    factor[0, 0] = 1e-3
    factor[2:, 1] = 1e-3
    values = np.array(list(shape), dtype=float)
    unit = int(np.argmax(np.abs(values)))
    factor[2 + unit] = 0.0
    return Mode("m", frequency, 1e-3, 0.01, 1e-3, values / values[unit], factor, 3)


def estimate(*modes: Mode, number: int = 0, turbine: str = "t1") -> ModalEstimate:
    start_ns = START_NS + number * WINDOW * NANOSECONDS
    return ModalEstimate(
        turbine,
        number,
        start_ns,
        start_ns + WINDOW * NANOSECONDS,
        LAYOUT.layout_id,
        LAYOUT.channel_names,
        modes,
    )


def sample(second: float, state: str = "parked", yaw: float = 0.0) -> ScadaSample:
    time_ns = START_NS + round(second * NANOSECONDS)
    return ScadaSample("t1", time_ns, state, 8.0 + second / 100, 0.0, 90.0, yaw, 0.0, 0.5)


def with_conditions(*samples: ScadaSample, number: int = 0) -> ModalEstimate:
    log = OperationLog()
    for each in samples:
        log.note(each)
    return log.with_conditions(estimate(number=number))


def test_a_window_carries_the_state_that_held_during_all_of_it() -> None:
    told = with_conditions(*(sample(second) for second in range(0, 600, 10)))
    assert told.operating_state == "parked"
    assert told.wind_speed == pytest.approx(8.0 + 2.95)
    assert told.water_level == 0.5


def test_a_state_holds_until_the_next_sample() -> None:
    told = with_conditions(sample(-300.0, "idling"), number=3)
    assert told.operating_state == "idling"


def test_a_window_in_which_the_state_or_the_yaw_changes_is_changing() -> None:
    assert with_conditions(sample(0), sample(300, "start")).operating_state == CHANGING
    assert with_conditions(sample(0), sample(300, yaw=15.0)).operating_state == CHANGING
    assert with_conditions(sample(0), sample(300, yaw=0.5)).operating_state == "parked"


def test_a_turbine_without_a_controllers_stream_has_windows_of_unknown_state() -> None:
    told = with_conditions()
    assert told.operating_state == ""
    assert np.isnan(told.yaw)


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
    doubtful = replace(estimate(), warnings=(Warning("clipped", "z145-ss is clipped"),))
    (refused,) = node.handle(doubtful)
    assert isinstance(refused, WindowRejected)
    assert (refused.code, refused.reason) == ("clipped", "z145-ss is clipped; not used")
    assert not updater.taken


def test_each_turbine_has_an_updater_of_its_own() -> None:
    node, made = gate()
    for turbine in ("t1", "t2", "t1"):
        node.handle(estimate(turbine=turbine))
    assert [len(each.taken) for each in made] == [2, 1]


def test_a_state_that_there_is_not_is_refused() -> None:
    with pytest.raises(InputError, match="allowed_states has 'asleep'"):
        OperationSettings(("asleep",))


def test_shapes_of_a_yawed_nacelle_are_turned_back_to_its_axes() -> None:
    """A purely fore-aft mode, seen by sensors fixed to a tower under a nacelle yawed by 30°."""
    along = np.array([0.2, 0.4, 0.6, 1.0])
    angle = np.radians(30.0)
    seen = np.concatenate([along * np.cos(angle), along * np.sin(angle)])
    yawed = replace(estimate(mode(0.16, seen)), yaw=30.0)
    (turned,) = in_nacelle_axes(yawed, LAYOUT).modes
    np.testing.assert_allclose(turned.shape, [*along, 0, 0, 0, 0], atol=1e-12)
    assert turned.shape_std[turned.unit_component] == 0.0
    assert in_nacelle_axes(estimate(mode(0.16, seen)), LAYOUT).modes[0].shape[0] < 0.3


def test_a_turn_by_yaw_and_back_changes_nothing() -> None:
    there, back = turning_matrix(LAYOUT, 37.0), turning_matrix(LAYOUT, -37.0)
    np.testing.assert_allclose(there @ back, np.eye(8), atol=1e-12)


def test_one_axis_at_a_height_cannot_be_turned() -> None:
    single = SensorLayout("one", "t1", "tower", LAYOUT.channels[:1])
    with pytest.raises(InputError, match="one direction only at 41 m"):
        turning_matrix(single, 10.0)


def test_two_channels_that_changed_place_are_named() -> None:
    rng = np.random.default_rng(2)
    modes = [mode(f, rng.normal(size=8)) for f in (0.16, 0.6, 1.1, 1.8, 2.6)]
    watch = ChannelWatch()
    assert watch.swap_in(estimate(*modes)) is None
    order = [0, 2, 1, 3, 4, 5, 6, 7]
    swapped = [mode(each.frequency * 1.002, each.shape[order]) for each in modes]
    words = watch.swap_in(estimate(*swapped, number=1))
    assert words is not None
    assert words.startswith("z80-fa and z106-fa have changed place")
    assert watch.swap_in(estimate(*modes, number=2)) is None


def test_shapes_that_change_without_a_swap_are_let_pass() -> None:
    rng = np.random.default_rng(3)
    watch = ChannelWatch()
    for number in range(3):
        modes = [mode(f, rng.normal(size=8)) for f in (0.16, 0.6, 1.1, 1.8, 2.6)]
        assert watch.swap_in(estimate(*modes, number=number)) is None


def test_a_unit_with_a_good_clock_and_link_gives_no_cause_for_words() -> None:
    watch = BlockWatch(lateness=5.0)
    for sequence in range(60):
        watch.note(block(sequence))
    assert watch.warnings_until(START_NS + 60 * NANOSECONDS) == ()
    assert watch.still_channel(START_NS, START_NS + 60 * NANOSECONDS) is None


def test_what_the_link_did_is_counted_by_name() -> None:
    watch = BlockWatch(lateness=5.0)
    for sequence in (0, 1, 1, 3, 2, 4, 20, 5):
        watch.note(block(sequence))
    codes = {warning.code: warning.text for warning in watch.warnings_until(START_NS)}
    assert {code: text.split()[0] for code, text in codes.items()} == {
        "repeated": "1",
        "out-of-order": "1",
        "late": "1",
    }
    assert watch.warnings_until(START_NS) == ()  # told once


@pytest.mark.parametrize("ppm", [-40.0, 40.0])
def test_a_clock_that_runs_fast_or_slow_is_told_with_its_rate(ppm: float) -> None:
    watch = BlockWatch(lateness=5.0)
    for sequence in range(60):
        sound = block(sequence)
        off = round(ppm * 1e-6 * sequence * NANOSECONDS)
        watch.note(replace(sound, start_ns=sound.start_ns + off))
    (warning,) = watch.warnings_until(START_NS + 61 * NANOSECONDS)
    assert warning.code == "clock-drift"
    assert f"{ppm:+.0f} ppm" in warning.text


def test_a_channel_that_dies_within_a_window_is_found_where_it_dies() -> None:
    watch = BlockWatch(lateness=5.0)
    for sequence in range(20):
        sound = block(sequence)
        samples = sound.samples.copy()
        if sequence >= 12:
            samples[:, 5] = 0.0
        watch.note(replace(sound, samples=samples))
    assert watch.still_channel(START_NS, START_NS + 20 * NANOSECONDS) == (5, 13.0)
    assert watch.still_channel(START_NS, START_NS + 10 * NANOSECONDS) is None
