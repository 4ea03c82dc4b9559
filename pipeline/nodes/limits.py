"""What a unit or a turbine may cost, so that none costs the others' windows, how many of them there
may be, and which blocks are beyond that."""

from dataclasses import dataclass, field, fields

from pipeline.messages import QualityWarning
from sensors.acquisition.blocks import AccelerationBlock
from sensors.errors import InputError
from sensors.settings import NO_KEY

# Codes of refusals, as they are counted in a NodeStatus.
TOO_LARGE = "window-too-large"
TOO_MANY_CHANNELS = "too-many-channels"
TOO_FAST = "sampled-too-fast"
TOO_LARGE_BLOCK = "block-too-large"


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


DEFAULT_LIMITS = LimitSettings()


def window_refusal(
    block: AccelerationBlock, duration: float, limits: LimitSettings = DEFAULT_LIMITS
) -> QualityWarning | None:
    """Return why a window of such blocks cannot be identified; None where it can.

    Parameters
    ----------
    duration : float
        Of a window [s].
    """
    n_channels, rate = block.samples.shape[1], block.sampling_rate
    if n_channels > limits.channels:
        return QualityWarning(
            TOO_MANY_CHANNELS,
            f"{n_channels} channels; a unit has at most {limits.channels} that are identified "
            "([limits] channels)",
        )
    n_values = duration * rate * n_channels
    if n_values > limits.window_values:
        return QualityWarning(
            TOO_LARGE,
            f"a window of {duration:g} s would hold {n_values:.3g} values at {rate:g} Hz; at most "
            f"{limits.window_values:g} are held ([limits] window_values)",
        )
    if rate > limits.sampling_rate:
        return QualityWarning(
            TOO_FAST, f"{rate:g} Hz; at most {limits.sampling_rate:g} Hz are identified"
        )
    if block.samples.nbytes > 1e6 * limits.block_megabytes:
        return QualityWarning(
            TOO_LARGE_BLOCK,
            f"a block of {1e-6 * block.samples.nbytes:.1f} MB; at most {limits.block_megabytes:g} "
            "MB are identified",
        )
    return None
