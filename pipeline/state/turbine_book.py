"""What became of one turbine's windows and estimates."""

from collections import Counter
from dataclasses import asdict, dataclass, field
from typing import Any

from pipeline.messages import FoundationPosterior, ModalEstimate, WindowRejected
from pipeline.state.phrases import codes_in_words
from sensors.bounded_dict import BoundedDict
from sensors.json_values import Json

MOST_BOOKS = 2000  # boots of units, and windows that are waited for, each; of more the oldest go
UNANSWERED = 2  # later windows that were answered, after which an estimate counts as forgotten
IN_POSTERIOR = "in-posterior"  # fate of an estimate
LATEST_WINDOWS = 20  # whose fates are listed

WindowKey = tuple[object, ...]


def bounded_table() -> BoundedDict[Any, Any]:
    """Return a table of at most `MOST_BOOKS` entries."""
    return BoundedDict(MOST_BOOKS)


@dataclass(slots=True)
class WindowFate:
    """What became of one window."""

    window: int
    start_ns: int
    fate: str
    """"identified", or the reason's code."""
    estimate: str = ""
    """Of an identified window: "pending", "in-posterior", or the code why it was refused."""


@dataclass(slots=True)
class TurbineBook:
    """What became of one turbine's windows and estimates."""

    identified: int = 0
    rejected: Counter[str] = field(default_factory=Counter)
    """By the reason's code."""
    in_posterior: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    """Estimates that the updating did not use, by the reason's code."""
    pending: BoundedDict[WindowKey, int] = field(default_factory=bounded_table)
    """Estimates without an answer of the updating, in their order → later ones answered since."""
    known: BoundedDict[WindowKey, WindowFate] = field(default_factory=bounded_table)
    """Fates of the latest windows."""
    superseded: int = 0
    """Answers of windows that have another one by now."""
    without_posterior: int = 0
    """Windows that were answered since the last posterior."""
    unbalanced: int = 0
    """Windows on end that were answered while the books did not balance."""
    early: dict[WindowKey, str] = field(default_factory=dict)
    """The last answer of the updating that may have overtaken its estimate on the way: two nodes
    send them, and nothing orders what different nodes send."""
    last: BoundedDict[WindowKey, int] = field(default_factory=bounded_table)
    """Boot of a unit → number of its last window."""
    latest: tuple[WindowKey, ...] = ()
    """Boots of the last window that has any: a window in which no unit was there is theirs."""
    skipped: list[str] = field(default_factory=list)
    """Windows that have no fate, in words."""

    def enter_estimate(self, estimate: ModalEstimate, *, updated: bool, awaited: bool) -> bool:
        """Enter an identified window; False: it is given again after a restart.

        Parameters
        ----------
        updated : bool
            Whether an updating has sent anything.
        awaited : bool
            Whether an updating owes it an answer.
        """
        key = _key(estimate)
        known = self.known.get(key)
        if known is not None and known.fate == "identified":
            return False
        early = self.early.get(key, "") if updated else ""
        self.early.clear()
        if known is None:
            self._follow(estimate)
        else:
            self.rejected -= Counter({known.fate: 1})
            self.superseded += not early
        self.identified += 1
        pending = early or "pending" if awaited else ""
        self.known[key] = WindowFate(estimate.window, estimate.start_ns, "identified", pending)
        if early:
            self.in_posterior += early == IN_POSTERIOR
            self.refused += Counter({early: early != IN_POSTERIOR})
        elif awaited:
            self.pending[key] = 0
        return True

    def enter_rejection(self, rejected: WindowRejected) -> bool:
        """Enter a rejected window, or an estimate that the updating refused; whether it is a
        window's first answer."""
        key = _key(rejected)
        known = self.known.get(key)
        if known is None:
            self.rejected[rejected.code] += 1 + rejected.windows_before
            self._follow(rejected, rejected.windows_before)
            self.known[key] = WindowFate(rejected.window, rejected.start_ns, rejected.code)
            self.early = {key: rejected.code}
        elif key in self.pending:
            self._strike_out(key)
            self.refused[rejected.code] += 1
            known.estimate = rejected.code
        elif known.fate == "identified" and rejected.code != known.estimate:
            self.superseded += 1  # by the estimate that the posterior has
        return known is None

    def enter_posterior(self, posterior: FoundationPosterior) -> None:
        """Enter the answer to an estimate."""
        key = _key(posterior)
        if not posterior.origins:  # of an older recording: by the end of its window
            key = next((each for each in self.pending if each[-1] == posterior.time_ns), key)
        if key in self.pending:
            self._strike_out(key)
            self.in_posterior += 1
            if key in self.known:
                self.known[key].estimate = IN_POSTERIOR
        elif key not in self.known:
            self.early = {key: IN_POSTERIOR}
        self.without_posterior = 0

    def _strike_out(self, answered: WindowKey) -> None:
        """Strike out an estimate. One that came before it and is still pending was passed over; one
        that came after it only waits for a slow updating."""
        for key in self.pending:
            if key == answered:
                break
            self.pending[key] += 1
        del self.pending[answered]

    def _follow(self, answer: ModalEstimate | WindowRejected, before: int = 0) -> None:
        """Note windows between this one and the last of its boots that have no answer.

        before: windows before it that it answers too. Of joined units some may be left out of some
        windows: the last window of any of them counts, and one that follows the latest is theirs.
        """
        boots = tuple((o.unit, o.session, o.boot) for o in answer.origins) or self.latest
        first = answer.window - before
        last = max((self.last.get(boot, -1) for boot in boots), default=-1)
        latest = max((self.last.get(boot, -1) for boot in self.latest), default=-1)
        if 0 <= last < first - 1 != latest:
            _, session, number = boots[0]
            self.skipped.append(
                f"windows {last + 1} to {first - 1} of boot {number} of session {session} have no "
                "answer"
            )
        self.latest = boots
        for boot in boots:
            self.last.pop(boot, None)  # the longest unheard is forgotten first
            self.last[boot] = max(answer.window, last)

    @property
    def forgotten(self) -> int:
        """Estimates that have no answer although later ones have."""
        return sum(count >= UNANSWERED for count in self.pending.values())

    @property
    def line(self) -> str:
        """Windows and estimates in one line, with the reasons of those that are not used."""
        return (
            f"{self.identified} were identified, {self.rejected.total()} rejected "
            f"({codes_in_words(self.rejected)}), {self.refused.total()} estimates refused "
            f"({codes_in_words(self.refused)})"
        )

    def as_json(self) -> Json:
        """Return the book in figures; names are stable."""
        return {
            "identified": self.identified,
            "rejected": dict(self.rejected),
            "in_posterior": self.in_posterior,
            "refused": dict(self.refused),
            "pending": len(self.pending),
            "superseded": self.superseded,
            "windows": [asdict(fate) for fate in list(self.known.values())[-LATEST_WINDOWS:]],
        }


def _key(message: ModalEstimate | WindowRejected | FoundationPosterior) -> WindowKey:
    """Return a window's identity; of an older recording its start and end."""
    if message.origins:
        return tuple(message.origins)
    if isinstance(message, FoundationPosterior):
        return ("ends", message.time_ns)
    return ("lies", message.start_ns, message.end_ns)
