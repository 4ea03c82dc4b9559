"""A source that is played can be paused, moved and hurried, and says how it does."""

import json
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from pipeline.sources.publisher import publish_source
from pipeline.sources.replay_control import REPLAY_KEY, ReplayControl
from pipeline.sources.sources import replayed, simulated
from pipeline.transport.bus import Inbox
from pipeline.transport.zenoh_bus import ZenohBus, asked, free_endpoint, hub, peer_of
from sensors.acquisition.blocks import AccelerationBlock
from sensors.errors import InputError

PATIENCE = 30.0  # [s]


class Clock:
    now = 0.0  # [s]

    def __call__(self) -> float:
        return self.now


def blocks(control: ReplayControl) -> Iterator[AccelerationBlock]:
    return (each for each in control.messages() if isinstance(each, AccelerationBlock))


def test_unless_asked_everything_is_played_as_it_was_recorded(short_recording: Path) -> None:
    source = replayed(short_recording)
    played = list(blocks(ReplayControl(source)))
    recorded = [each for each in source.messages() if isinstance(each, AccelerationBlock)]
    assert [each.sequence for each in played] == [each.sequence for each in recorded]
    assert {each.session for each in played} == {each.session for each in recorded}


def test_a_seek_goes_on_elsewhere_as_a_session_of_its_own(short_recording: Path) -> None:
    control = ReplayControl(replayed(short_recording))
    playing = blocks(control)
    first = [next(playing) for _ in range(10)]
    control.do("seek", 200.0)
    assert control.as_json()["position_s"] == 200.0
    then = list(playing)
    assert len(then) == 40
    assert then[0].sequence == 0
    assert then[0].start_ns - first[0].start_ns == 200 * 10**9
    assert then[0].session == f"{first[0].session}@2"
    control = ReplayControl(replayed(short_recording))
    playing = blocks(control)
    [next(playing) for _ in range(100)]
    control.do("seek", 0.0)
    assert sum(1 for _ in playing) == 240


def test_paused_means_that_nothing_comes_until_play(short_recording: Path) -> None:
    control = ReplayControl(replayed(short_recording))
    playing, taken, reached = blocks(control), [], threading.Event()
    control.do("pause")

    def take() -> None:
        for each in playing:
            taken.append(each)
            reached.set()

    thread = threading.Thread(target=take)
    thread.start()
    assert not reached.wait(0.3)
    assert control.as_json()["playing"] is False
    control.do("play")
    thread.join(PATIENCE)
    assert len(taken) == 240


def test_the_speed_is_kept_from_its_change_on(short_recording: Path) -> None:
    clock = Clock()
    control = ReplayControl(replayed(short_recording), speed=2.0, clock=clock)
    assert control._remaining(10 * 10**9) == 0.0
    assert control._remaining(14 * 10**9) == pytest.approx(2.0)
    clock.now = 1.0
    control.do("speed", 4.0)
    assert control._remaining(14 * 10**9) == 0.0
    assert control._remaining(18 * 10**9) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("request_", "message"),
    [
        ({"do": "dance"}, "'dance' is none of play, pause"),
        ({"do": "seek", "value": 900.0}, "seek 900 lies outside of 0 to 240 s"),
        ({"do": "seek"}, "seek needs a number"),
        ({"do": "speed", "value": 0}, "speed is 0"),
        ([], "is no request"),
    ],
)
def test_what_cannot_be_done_is_answered_with_the_reason(
    short_recording: Path, request_: object, message: str
) -> None:
    control = ReplayControl(replayed(short_recording))
    answer = json.loads(control.answer(json.dumps(request_).encode()))
    assert message in answer["error"]
    assert len(list(blocks(control))) == 240


def test_what_is_simulated_has_no_position_to_go_to(short_scenario) -> None:
    with pytest.raises(InputError, match="seek is for replay:FILE"):
        ReplayControl(simulated(short_scenario)).do("seek", 10.0)


def test_a_source_that_publishes_can_be_controlled_from_elsewhere(short_recording: Path) -> None:
    endpoint, stopping = free_endpoint(), threading.Event()
    listening = ZenohBus(hub(endpoint))
    inbox = Inbox()
    listening.subscribe([AccelerationBlock], inbox)
    published: list[int] = []

    def publish() -> None:
        published.append(
            publish_source(
                replayed(short_recording), peer_of(endpoint), speed=1.0, stopping=stopping
            )
        )

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        assert isinstance(inbox.get(PATIENCE), AccelerationBlock)
        request = json.dumps({"do": "seek", "value": 239.0}).encode()
        (answer,) = asked(endpoint, f"{REPLAY_KEY}/*", request)
        assert json.loads(answer)["playing"] is True
        sought = inbox.get(PATIENCE)
        while isinstance(sought, AccelerationBlock) and "@2" not in sought.session:
            sought = inbox.get(PATIENCE)
        assert isinstance(sought, AccelerationBlock)
    finally:
        stopping.set()
        thread.join(PATIENCE)
        listening.close()
    assert published[0] >= 2
