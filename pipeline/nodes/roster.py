"""Roster: whom a node remembers, at most so many at a time.

A turbine's or a unit's name is all that it takes to be one: a stranger can make up any number, and
what a node keeps of each would grow without end.
"""

from pipeline.messages import Warning  # noqa: A004  # the field's word

MOST_TURBINES = 300  # of a session; an updater of each holds 3 MB
MOST_UNITS = 16  # of a turbine


class Roster:
    """Names of those that were heard.

    When one more comes, who has said least goes; of these, who has been silent longest. So a flood
    of new names drives out names of the flood, and nobody who has been speaking for a while.
    """

    def __init__(self, most: int) -> None:
        self.gone = 0  # names that had to go
        self._most = most
        self._said: dict[str, int] = {}  # by name, the longest silent first

    def __len__(self) -> int:
        return len(self._said)

    def heard(self, name: str) -> str | None:
        """Note that somebody speaks; who has to go for it, if anybody has."""
        leaving = None
        if name not in self._said and len(self._said) >= self._most:
            leaving = min(self._said, key=self._said.__getitem__)  # the first of equals
            del self._said[leaving]
            self.gone += 1
        self._said[name] = self._said.pop(name, 0) + 1
        return leaving


def told_of_gone(gone: int, limits: str) -> tuple[Warning, ...]:
    """What a node says that had to let somebody go; nothing where nobody had to."""
    if not gone:
        return ()
    text = f"more than {limits}: {gone} times who had said least was let go"
    return (Warning("too-many-turbines", text),)
