"""The machine's clock, for what must keep pace with it."""

import threading
import time


class MachineClock:
    """Monotonic time, and waiting that `stop` ends early."""

    def __init__(self) -> None:
        self._stopped = threading.Event()

    def now(self) -> float:
        """Time since an arbitrary moment [s]; never set back."""
        return time.monotonic()

    def wait(self, seconds: float) -> None:
        """Return after that time, or at once when the clock has been stopped."""
        self._stopped.wait(seconds)

    def stop(self) -> None:
        """End every wait, now and from now on. Any thread."""
        self._stopped.set()
