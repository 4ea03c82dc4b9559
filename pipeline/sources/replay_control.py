"""Play, pause, seek and speed of a source that is being played, asked from elsewhere.

source ──► [replay control] ──► session or publisher
                ▲ query on pilewatch/@replay/TURBINE ◄── pilewatch control pause│play│seek S│speed X

The schedule is absolute from the last change on. After a seek the blocks are those of a session of
their own ("…@2"), so that windows begin where the playing does; a posterior takes no window twice.
"""

import json
import math
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from pipeline.messages import Message
from pipeline.sources.recorded_source import RecordedSource, due_of
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.errors import InputError
from sensors.json_values import Json

if TYPE_CHECKING:
    from pipeline.sources.sources import Source

REPLAY_KEY = "pilewatch/@replay"  # no stream's key expression matches what begins with @
ACTIONS = ("play", "pause", "seek", "speed", "state")
LOOKS = 0.2  # the event that ends everything is looked for so often [s]


@dataclass(slots=True)
class _State:
    """How the source is played; only changed under the lock."""

    speed: float
    """Speed of sensor time [-]."""

    paused: bool = False
    wanted: float | None = None
    """Position to go to [s from the first sample]."""

    origin: tuple[int, float] | None = None
    """Sensor time [ns], clock [s]; None: set by the next."""

    position: float = 0.0
    """Position of the last block given [s from the first sample]."""


class ReplayControl:
    """Gives a source's messages when they are due, and changes that when asked.

    Parameters
    ----------
    speed : float, optional
        1: real time; infinity: as fast as they are taken.
    stopping : threading.Event, optional
        Ends the waiting when set.
    clock : Callable[[], float], optional
        Returns the time [s]; it never goes back.
    """

    def __init__(
        self,
        source: "Source | RecordedSource",
        speed: float = math.inf,
        stopping: threading.Event | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._source = source
        self._state = _State(_checked_speed(speed))
        self._stopping = stopping or threading.Event()
        self._clock = clock
        self._changed = threading.Condition()

    def messages(self) -> Iterator[Message]:
        """Yield everything of the source, from the wanted position on after each seek."""
        source, number = self._source, 1
        while True:
            yield from self._played(source, number)
            with self._changed:
                wanted, self._state.wanted = self._state.wanted, None
                self._state.origin = None
            if wanted is None:
                return
            number += 1
            source = replace(self._source, playback=replace(source.playback, start=wanted))

    def _played(self, source: "Source | RecordedSource", number: int) -> Iterator[Message]:
        first_ns: int | None = None
        for message in source.messages():
            if self._is_interrupted_before(due_of(message)):
                return
            if isinstance(message, AccelerationBlock):
                first_ns = message.start_ns if first_ns is None else first_ns
                since = (message.end_ns - first_ns) / NANOSECONDS
                self._state.position = source.playback.start + since
                if number > 1:
                    message = replace(message, session=f"{message.session}@{number}")
            yield message

    def _is_interrupted_before(self, due_ns: int | None) -> bool:
        """Wait until a message is due; whether another position is wanted instead."""
        state = self._state
        with self._changed:
            while not self._stopping.is_set() and state.wanted is None:
                remaining = LOOKS if state.paused else self._remaining(due_ns)
                if remaining <= 0:
                    return False
                self._changed.wait(min(remaining, LOOKS))
            return state.wanted is not None

    def _remaining(self, due_ns: int | None) -> float:
        state = self._state
        if due_ns is None or math.isinf(state.speed):
            return 0.0
        if state.origin is None:
            state.origin = (due_ns, self._clock())
        first_ns, started = state.origin
        return started + (due_ns - first_ns) / NANOSECONDS / state.speed - self._clock()

    def answer(self, request: bytes) -> bytes:
        """Do what a query asks, as JSON {"do": ACTION, "value": …}; the state, or why not."""
        try:
            asked = json.loads(request or b'{"do": "state"}')
            self.do(str(asked["do"]), asked.get("value"))
        except InputError as error:
            return json.dumps({"error": str(error)}).encode()
        except (ValueError, KeyError, TypeError, AttributeError):
            return json.dumps({"error": f"{request[:60]!r} is no request"}).encode()
        return json.dumps(self.as_json()).encode()

    def do(self, action: str, value: float | None = None) -> None:
        """Do one of ACTIONS.

        Parameters
        ----------
        action : str
            Its name.
        value : float, optional
            seek takes a position [s], speed a factor [-].

        Raises
        ------
        InputError
            For anything else, and for a position outside of what is played.
        """
        if action not in ACTIONS:
            raise InputError(f"{action!r} is none of {', '.join(ACTIONS)}")
        if action in ("seek", "speed") and not isinstance(value, int | float):
            raise InputError(f"{action} needs a number, not {value!r}")
        with self._changed:
            state = self._state
            match action, value:
                case "pause", _:
                    state.paused = True
                case "play", _:
                    state.paused, state.origin = False, None
                case "speed", int() | float() as speed:
                    state.speed, state.origin = _checked_speed(speed), None
                case "seek", int() | float() as position:
                    state.wanted = state.position = self._checked_position(float(position))
            self._changed.notify_all()

    def _checked_position(self, position: float) -> float:
        source = self._source
        if source.recording is None or source.duration is None:
            raise InputError(f"seek is for replay:FILE, not for {source.text}")
        start = source.playback.start
        end = start + source.duration / source.playback.rounds
        if not start <= position < end:
            raise InputError(f"seek {position:g} lies outside of {start:g} to {end:g} s")
        return position

    def as_json(self) -> Json:
        """Return what is played and how; names are stable."""
        with self._changed:
            state = self._state
            return {
                "source": self._source.text,
                "playing": not state.paused,
                "speed": None if math.isinf(state.speed) else state.speed,
                "position_s": state.position,
                "duration_s": self._source.duration,
            }


def _checked_speed(speed: float) -> float:
    if not speed > 0:
        raise InputError(f"speed is {speed:g}; 1 is real time, 10 ten times faster")
    return float(speed)
