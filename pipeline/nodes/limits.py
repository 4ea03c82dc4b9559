"""What a unit or a turbine may cost, so that none costs the others' windows, and how many of them
there may be."""

from dataclasses import dataclass, field, fields

from sensors.errors import InputError
from sensors.settings import NO_KEY


class LimitError(InputError):
    """A limit that cannot be right; the message names it."""


@dataclass(frozen=True, slots=True)
class LimitSettings:
    """Section [limits]: what is beyond them is recorded, counted and not identified."""

    channels: int = 100
    """Of a unit: the time for a window grows with their square."""
    sampling_rate: float = field(default=10_000.0, metadata=NO_KEY)
    """Of a unit [Hz]: faster is no vibration of a tower."""
    block_megabytes: float = 5.0
    """Samples of one block [10⁶ bytes]."""
    cpu_seconds: float = 120.0
    """For the identification of a window, in a run [s]; beyond, the window is rejected."""
    window_values: float = 1e7
    """Samples × channels of a window, of some 40 bytes while it is identified: sixteen channels
    at 1 kHz over ten minutes."""
    units: int = 16
    """Names of units of a turbine."""
    turbines: int = 300
    """Names of turbines; an updater of each holds 3 MB."""

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if not value > 0:
                raise LimitError(f"[limits] {each.name} is {value:g}; it must be > 0")
