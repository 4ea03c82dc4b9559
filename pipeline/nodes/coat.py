"""A node round another: it does something more and gives the other's accounts as its own."""

from typing import Generic, Protocol, TypeVar


class Accounted(Protocol):
    """What every identification tells of the blocks that it was given."""

    @property
    def late(self) -> int: ...

    @property
    def duplicate(self) -> int: ...

    def close(self) -> None: ...


Inner = TypeVar("Inner", bound=Accounted)


class Coat(Generic[Inner]):
    """Holds the inner node; whoever wears it writes `handle`."""

    def __init__(self, inner: Inner) -> None:
        self._inner = inner

    def close(self) -> None:
        """Close the inner node."""
        self._inner.close()

    @property
    def late(self) -> int:
        """Blocks that came when their window was over, by the inner node's account."""
        return self._inner.late

    @property
    def duplicate(self) -> int:
        """Blocks that came twice, by the inner node's account."""
        return self._inner.duplicate
