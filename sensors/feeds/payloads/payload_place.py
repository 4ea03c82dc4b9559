"""Where the paths of a mapping are looked up: a message, one row of it, its topic."""

import re
from dataclasses import dataclass
from typing import Any

from sensors.feeds.payloads.mapping import Paths, looked_up

_CONSTANTS: dict[str, Any] = {"$zero": 0, "$empty": ""}
_LEVEL = re.compile(r"\$topic\[(-?\d+)\]")


@dataclass(frozen=True, slots=True)
class PayloadPlace:
    """Where paths are looked up."""

    message: Any
    """The whole message."""
    row: Any
    """One row of it."""
    key: str
    """Of the row, if the rows are an object."""
    topic: str
    """Of the message."""

    def first(self, paths: Paths) -> Any:
        """What the first path that leads somewhere leads to; None if none does."""
        for path in paths:
            found = self._of(path)
            if found is not None:
                return found
        return None

    def has(self, paths: Paths) -> bool:
        """Whether one of the paths leads somewhere, if only to null."""
        return any(self._of(path) is not None or self._is_null(path) for path in paths)

    def _is_null(self, path: str) -> bool:
        """Whether a key is there and has no value."""
        content = self.message if path.startswith("^") else self.row
        outer, _, key = path.removeprefix("^").rpartition(".")
        return key in within if isinstance(within := looked_up(content, outer), dict) else False

    def _of(self, path: str) -> Any:
        if path == "$key":
            return self.key
        if path in _CONSTANTS:
            return _CONSTANTS[path]
        if level := _LEVEL.fullmatch(path):
            return looked_up(self.topic.split("/"), f"[{level[1]}]")
        if path.startswith("^"):
            return looked_up(self.message, path[1:])
        return looked_up(self.row, path)
