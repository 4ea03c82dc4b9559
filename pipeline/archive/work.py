"""Work that is done somewhere: here, in processes of this machine, or on a cluster.

Calls are pulled one by one while there is room for them, so that an archive of any size never waits
in memory; results come as they are ready, in any order.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

from sensors.errors import InputError


@dataclass(frozen=True, slots=True, eq=False)
class Call:
    """A function of one argument that may run in another process: both can be pickled."""

    key: str
    """Unique among the calls of a run."""
    function: Callable[[Any], Any]
    argument: Any


@dataclass(frozen=True, slots=True)
class Failed:
    """A call that gave no result, and why: one line for people."""

    text: str


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """A call that is over."""

    call: Call
    result: Any
    """What the function gave; Failed where it could not."""


class Workers(Protocol):
    """What does the calls."""

    def outcomes(self, calls: Iterable[Call | None]) -> Iterator[Outcome]:
        """Every call's outcome, as it is ready.

        Parameters
        ----------
        calls : iterable of Call or None
            Pulled as there is room; None: the next one waits for outcomes still to come.

        Notes
        -----
        An exception that is no InputError is raised.
        """
        ...


class ThisProcess:
    """Does every call at once, one after the other."""

    def outcomes(self, calls: Iterable[Call | None]) -> Iterator[Outcome]:
        """Yield the outcome of each call, one after the other."""
        for call in calls:
            if call is not None:  # nothing is under way that could be waited for
                yield Outcome(call, attempted(call.function, call.argument))


def attempted(function: Callable[[Any], Any], argument: Any) -> Any:
    """Return what the function gives; Failed where what it was given is wrong."""
    try:
        return function(argument)
    except InputError as error:
        return Failed(str(error))
