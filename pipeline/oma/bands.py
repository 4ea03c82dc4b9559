"""Which frequency bands a record is identified in, each at its own rate.

Why bands: the lag covariances must reach over a few periods of the slowest mode, and the model
order must leave room for every mode. At one rate both cannot be had: the covariances of a 0.16 Hz
tower sampled at 40 Hz would need hundreds of block rows. Two bands leave modes between them
biased (half a percent at 1.8 Hz on the 15 MW tower); three do not.

Why they overlap: a mode of high damping is best seen with short lags, which hold less noise. So
each band reports every mode that its lags reach, and `identification.merged` takes the slower
band's estimate unless the faster one is much sharper.
"""

from dataclasses import dataclass, replace
from math import sqrt

from pipeline.oma.settings import OmaSettings, OmaSettingsError

HIGHEST_RELATIVE = 0.45  # of a band's rate: above it the anti-alias filter or the sensor rolls off


@dataclass(frozen=True, slots=True)
class Band:
    """One decimated copy of the record and the modes looked for in it."""

    decimation: int  # q: the band's rate is the sampling rate / q
    sampling_rate: float  # of the band [Hz]
    lowest: float  # modes are reported from here [Hz]
    highest: float  # up to here [Hz]
    block_rows: int  # p: the Hankel matrix reaches to lag 2p
    orders: tuple[int, ...]  # model orders, ascending and even


@dataclass(frozen=True, slots=True)
class _BandShape:
    """A band relative to its own rate."""

    decimation: int
    upper: float  # highest frequency / band rate [-]
    block_rows: int
    orders: tuple[int, ...]


# Slow, middle and full-rate band of a record, proven on the 15 MW tower at 40 Hz, where they are
# 5 Hz with block rows over 13 s, 10 Hz over 3 s, and 40 Hz over 1.25 s.
_SHAPES = (
    _BandShape(decimation=8, upper=0.30, block_rows=64, orders=tuple(range(16, 62, 4))),
    _BandShape(decimation=4, upper=0.43, block_rows=32, orders=tuple(range(24, 82, 4))),
    _BandShape(
        decimation=1, upper=HIGHEST_RELATIVE, block_rows=50, orders=tuple(range(40, 112, 4))
    ),
)
_SAMPLES_PER_BLOCK_ROW = 6  # a band shorter than this many samples a block row is given fewer rows
_FEWEST_BLOCK_ROWS = 8
_REFERENCES_OF_FULL_ORDERS = 8


def plan_bands(
    *, n_samples: int, n_channels: int, sampling_rate: float, settings: OmaSettings
) -> tuple[Band, ...]:
    """Bands of a record, slowest first.

    Each reaches down to one period within the lags of its Hankel matrix. A record too short for
    its slow bands is identified in the faster ones alone. Asked for lower frequencies than the
    slow band reaches, the record gains further bands, each four times slower.
    Raises OmaSettingsError when the sampling rate is too low for the highest frequency asked for.
    """
    highest = settings.highest_frequency or HIGHEST_RELATIVE * sampling_rate
    if highest > 0.5 * sampling_rate:
        raise OmaSettingsError(
            f"[oma] highest_frequency is {highest:g} Hz; a sampling rate of {sampling_rate:g} Hz "
            f"reaches to {0.5 * sampling_rate:g} Hz"
        )
    shapes = _shapes_down_to(settings.lowest_frequency, sampling_rate)
    n_references = len(settings.reference_channels or range(n_channels))
    bands = [_band(shape, n_samples, n_references, sampling_rate) for shape in shapes]
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


def _shapes_down_to(lowest: float | None, sampling_rate: float) -> list[_BandShape]:
    shapes = list(_SHAPES)
    while lowest is not None and lowest < _reach(shapes[0], sampling_rate):
        shapes.insert(0, replace(shapes[0], decimation=4 * shapes[0].decimation))
    return shapes


def _reach(shape: _BandShape, sampling_rate: float) -> float:
    """Lowest frequency with one period inside the lags, 2p + 1 of them [Hz]."""
    return sampling_rate / shape.decimation / (2 * shape.block_rows)


def _band(
    shape: _BandShape, n_samples: int, n_references: int, sampling_rate: float
) -> Band | None:
    """The band as far as the record's length and references carry it; None when too short."""
    rate = sampling_rate / shape.decimation
    rows = min(shape.block_rows, n_samples // shape.decimation // (2 * _SAMPLES_PER_BLOCK_ROW))
    if rows < _FEWEST_BLOCK_ROWS:
        return None
    return Band(
        decimation=shape.decimation,
        sampling_rate=rate,
        lowest=rate / (2 * rows),
        highest=shape.upper * rate,
        block_rows=rows,
        orders=_orders(shape.orders, rank=rows * n_references, n_references=n_references),
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
