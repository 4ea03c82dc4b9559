"""RunState: what is known of a run. Each message is folded once; what is shown is computed from it.

message ──► [RunState] ──► summary.json, status, metrics, alarms, viewer, report, farm
             ├ books     blocks, windows and estimates, each with one fate
             ├ health    nodes and streams, by the listener's clock
             └ turbines  name ──► TurbineState
"""

from dataclasses import replace

from pipeline.messages import Message
from pipeline.state.books import Books
from pipeline.state.health import Health
from pipeline.state.turbine_state import TurbineState

MOST_TURBINES_KNOWN = 300  # of a live run; of more the one with the fewest messages goes


class RunState:
    """What is known of a run after the messages so far.

    Parameters
    ----------
    kept : int or None, optional
        Windows, rejections, gaps and events that are kept of a turbine, each; what is let go is
        counted. None: all.
    once : bool, optional
        Whether a block that comes again counts once, as of a live unit that sends again.
    """

    def __init__(self, *, kept: int | None = None, once: bool = False) -> None:
        self.books = Books()
        self.health = Health()
        self.turbines: dict[str, TurbineState] = {}
        self._kept = kept
        self._once = once

    def fold(self, message: Message, now_ns: int | None = None) -> None:
        """Take one message into account.

        Parameters
        ----------
        message : Message
            That has come.
        now_ns : int or None, optional
            When it came, by the listener's clock [ns]; None: health is not watched.
        """
        if now_ns is not None:
            self.health.observe(message, now_ns)
        is_new = self.books.handle(message)
        state = self.turbine(message.turbine)
        state.fold(message, counts=is_new or not self._once, is_new=is_new)

    def turbine(self, name: str) -> TurbineState:
        """Return the state of one turbine, an empty one where nothing is known yet."""
        if name not in self.turbines:
            if self._kept is not None and len(self.turbines) >= MOST_TURBINES_KNOWN:
                del self.turbines[min(self.turbines, key=self._received)]
            self.turbines[name] = (
                TurbineState(name) if self._kept is None else TurbineState.bounded(name, self._kept)
            )
        return self.turbines[name]

    @property
    def measured(self) -> dict[str, TurbineState]:
        """Turbines of which more is known than states of nodes; all of them where none is.

        A live session has a name of its own until a turbine sends under another one: the first one
        that sends then has the states of its nodes beside those that speak for itself.
        """
        known = {name: each for name, each in self.turbines.items() if each.is_measured}
        if not known:
            return self.turbines
        first = next(iter(known))
        of_session = [each for each in self.turbines.values() if not each.is_measured]
        if of_session:
            statuses = {
                node: status for each in of_session for node, status in each.statuses.items()
            }
            own = known[first].statuses
            known[first] = replace(known[first], statuses={**statuses, **own})
        return known

    def reported(self, name: str) -> TurbineState:
        """Return what is reported of one turbine: its state, as `measured` has it."""
        return self.measured.get(name) or self.turbine(name)

    def _received(self, name: str) -> int:
        return self.turbines[name].received.total()

    @property
    def published(self) -> int:
        """Blocks of all turbines."""
        return sum(each.published for each in self.turbines.values())
