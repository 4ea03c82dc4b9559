"""Which frequency bands a record is identified in, each at its own rate.

Why bands: the lag covariances must reach over a few periods of the slowest mode, and the model
order must leave room for every mode. At one rate both cannot be had: the covariances of a 0.16 Hz
tower sampled at 40 Hz would need hundreds of block rows. Two bands leave modes between them
biased (half a percent at 1.8 Hz on the 15 MW tower); three do not.

Why most come with a high pass: what is much stronger than a mode and far below it, as a sea's
response below a tower's second bending mode, takes the strongest singular vectors. At the model
orders that are left the mode does not show, or is mixed with a neighbour. Of the 15 MW tower at
sea the .63 Hz mode is found in no window without a high pass, and in nearly all with it.

Why they overlap: a mode of high damping, and one of a structure with few modes, is best seen with
short lags, which hold less noise; for these the faster ones are also taken whole, at low orders. So
each band reports every mode that its lags reach, and `band_merging.merged` takes the
sharpest estimate.
"""

from dataclasses import dataclass, replace
from math import ceil, inf, sqrt

from pipeline.oma.preprocessing import HIGH_PASS_BAND, high_pass_taps
from pipeline.oma.settings import HIGHEST_RELATIVE, OmaSettings, OmaSettingsError


@dataclass(frozen=True, slots=True)
class Band:
    """One decimated copy of the record and the modes looked for in it."""

    decimation: int
    """q: the band's rate is the sampling rate / q."""
    sampling_rate: float
    """Of the band [Hz]."""
    lowest: float
    """Modes are reported from here [Hz]."""
    highest: float
    """Up to here [Hz]."""
    block_rows: int
    """p: the Hankel matrix reaches to lag 2p."""
    orders: tuple[int, ...]
    """Model orders, ascending and even."""
    high_passed: bool = False
    """Free of what lies below."""


@dataclass(frozen=True, slots=True)
class _BandShape:
    """A band relative to its own rate."""

    decimation: int
    upper: float  # highest frequency / band rate [-]
    block_rows: int
    orders: tuple[int, ...]
    high_passed: bool = False


# Slow, middle and full-rate bands of a record, proven on the 15 MW tower at 40 Hz, where they are
# 5 Hz with block rows over 13 s, 10 Hz over 3 s, and 40 Hz over 1.25 s; free of what lies below
# .5, 1 and 4 Hz.
_SLOW = _BandShape(decimation=8, upper=0.30, block_rows=64, orders=tuple(range(16, 62, 4)))
_MIDDLE = _BandShape(decimation=4, upper=0.43, block_rows=32, orders=tuple(range(24, 82, 4)))
_FULL = _BandShape(
    decimation=1, upper=HIGHEST_RELATIVE, block_rows=50, orders=tuple(range(40, 112, 4))
)
_SHAPES = (
    _SLOW,
    replace(_SLOW, high_passed=True),
    replace(_MIDDLE, orders=tuple(range(16, 52, 4))),
    replace(_MIDDLE, high_passed=True),
    replace(_FULL, orders=tuple(range(20, 72, 4))),
    replace(_FULL, high_passed=True),
)
# A tower's modes lie where they lie, however fast a logger samples: at 100 Hz bands of the record's
# own rate are free of what lies below 1.25 Hz, and of the mode at .63 Hz with it. So a faster
# record has these bands at its rate divided by a whole number, and full ones above them. Of 67
# records faster than 41 Hz (`records`, seeds 5001 to 5020, 5201 to 5240, 5301 to 5339) 323 of 335
# modes were found so, and 296 of their intervals held; with the bands of its own rate 322 and 294,
# with both 321 and 289.
_FASTEST_PROVEN = 41.0  # rate up to which a record's own rate is the full band's [Hz]
_FULL_BANDS_APART = 4  # most by which their rates differ: each reaches over a factor of 4.3 [-]
_SAMPLES_PER_BLOCK_ROW = 6  # a band shorter than this many samples a block row is given fewer rows
_FEWEST_BLOCK_ROWS = 8
_REFERENCES_OF_FULL_ORDERS = 8


def plan_bands(
    *, n_samples: int, n_channels: int, sampling_rate: float, settings: OmaSettings
) -> tuple[Band, ...]:
    """Bands of a record, slowest first.

    Parameters
    ----------
    n_samples : int
        Of the record.
    n_channels : int
        Of the record; all are references where the settings name none.
    sampling_rate : float
        [Hz].
    settings : OmaSettings
        Lowest and highest frequency, and reference channels.

    Raises
    ------
    OmaSettingsError
        If the sampling rate is too low for the highest frequency asked for.

    Notes
    -----
    The first reaches down to one period within the lags of its Hankel matrix: .02 to .04 Hz of
    records from 20 Hz on, so that what is found does not depend on the logger. A record too short
    for its slow bands is identified in the faster ones alone. Asked for lower frequencies than
    the slow band reaches, the record gains further bands, each four times slower. Frequencies
    beyond the record's reach leave no band at all (`why_no_band`).
    """
    highest = settings.highest_frequency or HIGHEST_RELATIVE * sampling_rate
    if highest > 0.5 * sampling_rate:
        raise OmaSettingsError(
            f"[oma] highest_frequency is {highest:g} Hz; a sampling rate of {sampling_rate:g} Hz "
            f"reaches to {0.5 * sampling_rate:g} Hz"
        )
    shapes = _shapes_down_to(settings.lowest_frequency, sampling_rate)
    n_references = len(settings.reference_channels or range(n_channels))
    carried = [
        shape
        for shape in shapes
        if _band(shape, n_samples, n_references, sampling_rate) is not None
    ]
    if carried and carried[0].high_passed:
        carried.insert(0, replace(carried[0], high_passed=False))
    bands = [_band(shape, n_samples, n_references, sampling_rate) for shape in carried]
    return tuple(
        replace(
            band,
            lowest=max(band.lowest, settings.lowest_frequency or 0.0),
            highest=min(band.highest, highest),
        )
        for band in bands
        if band is not None
        and band.lowest < highest
        and band.highest > (settings.lowest_frequency or 0.0)
    )


def is_asked_for(frequency: float, settings: OmaSettings) -> bool:
    """Whether a frequency [Hz] is within the settings' limits; where none is stated all are."""
    low, high = settings.lowest_frequency or 0.0, settings.highest_frequency or inf
    return low <= frequency <= high


def why_no_band(
    *, n_samples: int, n_channels: int, sampling_rate: float, settings: OmaSettings
) -> str:
    """Return why `plan_bands` finds no band: the setting that is out of reach, and the reach."""

    def planned(within: OmaSettings) -> tuple[Band, ...]:
        return plan_bands(
            n_samples=n_samples,
            n_channels=n_channels,
            sampling_rate=sampling_rate,
            settings=within,
        )

    lowest, duration = settings.lowest_frequency, n_samples / sampling_rate
    all_bands = planned(replace(settings, lowest_frequency=None, highest_frequency=None))
    top = max((band.highest for band in all_bands), default=0.0)
    if lowest is not None and lowest >= top:
        return (
            f"[oma] lowest_frequency is {lowest:g} Hz: nothing can be identified above {top:.3g} "
            f"Hz in {duration:.6g} s at {sampling_rate:g} Hz"
        )
    bottom = min(band.lowest for band in planned(replace(settings, highest_frequency=None)))
    return (
        f"[oma] highest_frequency is {settings.highest_frequency:g} Hz: nothing can be identified "
        f"below {bottom:.3g} Hz in {duration:.6g} s at {sampling_rate:g} Hz"
    )


def _shapes_at(sampling_rate: float) -> list[_BandShape]:
    """The bands of a record without any limit, slowest first."""
    first = ceil(sampling_rate / _FASTEST_PROVEN)
    shapes = [replace(shape, decimation=first * shape.decimation) for shape in _SHAPES]
    decimation = first
    while decimation > 1:
        decimation = ceil(decimation / _FULL_BANDS_APART)
        shapes += [replace(shape, decimation=decimation) for shape in _SHAPES[-2:]]
    return [
        replace(shape, upper=min(shape.upper, _MIDDLE.upper)) if shape.decimation > 1 else shape
        for shape in shapes
    ]


def _shapes_down_to(lowest: float | None, sampling_rate: float) -> list[_BandShape]:
    shapes = _shapes_at(sampling_rate)
    while lowest is not None and lowest < _reach(shapes[0], sampling_rate):
        shapes.insert(0, replace(shapes[0], decimation=4 * shapes[0].decimation))
    return shapes


def _reach(shape: _BandShape, sampling_rate: float) -> float:
    """Lowest frequency with one period inside the lags, 2p + 1 of them [Hz]."""
    return sampling_rate / shape.decimation / (2 * shape.block_rows)


def _band(
    shape: _BandShape,
    n_samples: int,
    n_references: int,
    sampling_rate: float,
) -> Band | None:
    """The band as far as the record's length and references carry it; None when too short."""
    rate = sampling_rate / shape.decimation
    length = n_samples // shape.decimation
    if shape.high_passed:
        length -= len(high_pass_taps())
    rows = min(shape.block_rows, length // (2 * _SAMPLES_PER_BLOCK_ROW))
    if rows < _FEWEST_BLOCK_ROWS:
        return None
    return Band(
        decimation=shape.decimation,
        sampling_rate=rate,
        lowest=max(rate / (2 * rows), HIGH_PASS_BAND * rate if shape.high_passed else 0.0),
        highest=shape.upper * rate,
        block_rows=rows,
        orders=_orders(shape.orders, rank=rows * n_references, n_references=n_references),
        high_passed=shape.high_passed,
    )


def _orders(full: tuple[int, ...], *, rank: int, n_references: int) -> tuple[int, ...]:
    """Model orders for a number of references; `full` serves eight or more.

    Why fewer for fewer references (by default all channels are): a model of high order fits the
    noise of few channels with lightly damped poles, which split a heavily damped mode. The square
    root was found on measured and simulated records of two to eight channels. At most half the
    Hankel matrix's rank is used.
    """
    scale = min(1.0, sqrt(n_references / _REFERENCES_OF_FULL_ORDERS))
    orders = sorted({2 * round(order * scale / 2) for order in full})
    usable = tuple(order for order in orders if 2 <= order <= rank // 2)
    return usable or (max(2, rank // 4 * 2),)
