"""OmaSettings: everything about identification that a scenario may set."""

from dataclasses import dataclass, field
from typing import ClassVar

from sensors.errors import InputError
from sensors.settings import NO_KEY

HIGHEST_RELATIVE = (
    0.45  # of a sampling rate: above it the anti-alias filter or the sensor rolls off
)


class OmaSettingsError(InputError):
    """An identification setting that cannot be right; the message names the setting."""


@dataclass(frozen=True, slots=True)
class OmaSettings:
    """Settings of the identification; the defaults need no change for most structures.

    Bands and block rows follow from the sampling rate and the two frequencies (`bands.py`), so
    one set of defaults serves a tower of 0.15 Hz and a laboratory frame of 40 Hz.
    """

    window_duration: float = 600.0
    """Length of a window [s]."""
    hop: float = 600.0
    """Time from one window's start to the next one's [s]."""
    lateness: float = 5.0
    """Time for which a late block is waited for [s]."""
    lowest_frequency: float | None = None
    """Lowest frequency of a mode [Hz]; absent: as low as the window's length resolves."""
    highest_frequency: float | None = None
    """Highest frequency of a mode [Hz]; absent: 0.45 × the sampling rate."""
    reference_channels: tuple[str, ...] | None = None
    """Names of the channels that all are correlated with; absent: all channels."""
    n_blocks: int = field(default=40, metadata=NO_KEY)
    """Time blocks for the uncertainty; std scatters by 1/sqrt(2(n_blocks − 1))."""

    maximum_damping: ClassVar[float] = 0.1
    """ζ of a structural mode [-]."""
    minimum_presence: ClassVar[float] = 0.7
    """Share of the orders in which a mode must be stable [-],"""
    confirmed_presence: ClassVar[float] = 0.5
    """and where two bands report it [-]."""

    minimum_collinearity: ClassVar[float] = 0.6
    """Modal phase collinearity of a structural mode [-]."""
    maximum_frequency_std: ClassVar[float] = 0.03
    """Relative to the frequency [-]."""
    maximum_bound_ratio: ClassVar[float] = 10.0
    """Frequency std over the attainable bound √(ζ/(2π f T)) [-]."""

    maximum_shape_std: ClassVar[float] = 0.25
    """Of any component; a mixture of neighbours has more [-]."""

    maximum_bandwidth_share: ClassVar[float] = 0.6
    """Stds of f and ζ over the half bandwidth: ζ f and ζ [-]."""

    def __post_init__(self) -> None:
        for name in ("window_duration", "hop"):
            if not getattr(self, name) > 0:
                raise OmaSettingsError(f"[oma] {name} is {getattr(self, name)}; it must be > 0")
        if not self.lateness >= 0:
            raise OmaSettingsError(f"[oma] lateness is {self.lateness} s; it must be >= 0")
        if self.hop > self.window_duration:
            raise OmaSettingsError(
                f"[oma] hop is {self.hop:g} s, longer than window_duration "
                f"({self.window_duration:g} s): samples between the windows would be unused"
            )
        if self.n_blocks < 10:
            raise OmaSettingsError(
                f"[oma] n_blocks is {self.n_blocks}; fewer than 10 blocks give no uncertainty"
            )
        if self.reference_channels is not None:
            self._check_references(self.reference_channels)
        low, high = self.lowest_frequency, self.highest_frequency
        if low is not None and not low > 0:
            raise OmaSettingsError(f"[oma] lowest_frequency is {low:g} Hz; it must be > 0")
        if high is not None and not high > 0:
            raise OmaSettingsError(f"[oma] highest_frequency is {high:g} Hz; it must be > 0")
        if low is not None and high is not None and not high > low:
            raise OmaSettingsError(
                f"[oma] highest_frequency is {high:g} Hz, not above lowest_frequency ({low:g} Hz)"
            )

    def _check_references(self, names: tuple[str, ...]) -> None:
        if not names:
            raise OmaSettingsError(
                "[oma] reference_channels is empty; name one channel or more, or leave the key out"
            )
        repeated = next((name for name in names if names.count(name) > 1), None)
        if repeated is not None:
            raise OmaSettingsError(f"[oma] reference_channels names {repeated!r} twice")
