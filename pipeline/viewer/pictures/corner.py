"""The joint posterior as a corner plot: pairs of stiffnesses, their marginals on the diagonal.

Drawn in picture units, y down: every panel is a unit square. No rerun here.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sensors.arrays import FloatArray

Point = tuple[float, float]

PITCH = 1.5  # from one panel's corner to the next one's [panel widths]
HISTOGRAM_BINS = 24
PEAK = 0.92  # height of a marginal's highest bin [panel heights]


@dataclass(frozen=True, slots=True)
class Axis:
    """The range of one stiffness, as ratio to nominal, over one panel."""

    low: float
    """Lower end [-]."""
    high: float
    """Upper end [-]."""

    def position(self, values: FloatArray) -> FloatArray:
        """Return 0 at the low end, 1 at the high end."""
        return (values - self.low) / (self.high - self.low)

    @property
    def ticks(self) -> FloatArray:
        """Two or three round numbers inside the range, a little away from its ends."""
        step = _round_step((self.high - self.low) / 4)
        first = np.ceil((self.low + 0.05 * (self.high - self.low)) / step)
        last = np.floor((self.high - 0.05 * (self.high - self.low)) / step)
        return np.arange(first, last + 1) * step


@dataclass(frozen=True, slots=True)
class Text:
    """A text of the picture, centred on its position."""

    position: Point
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class CornerPlot:
    """Everything to draw, in picture units."""

    draws: FloatArray
    """(n, 2) points of all pair panels [picture units]."""
    frames: tuple[FloatArray, ...]
    """Outlines of panels and ticks."""
    histograms: tuple[FloatArray, ...]
    """Outlines of the marginals."""
    priors: tuple[FloatArray, ...]
    """The flat prior's density in each marginal; empty for another prior."""
    truth: tuple[FloatArray, ...]
    """Lines at the true ratio; empty where it is not known."""
    texts: tuple[Text, ...]


def corner_plot(
    ratios: FloatArray,
    names: Sequence[str],
    *,
    truth: FloatArray | None = None,
    contraction: FloatArray | None = None,
    flat_prior: bool = True,
) -> CornerPlot:
    """Draw pairs below the diagonal, marginals on it.

    Parameters
    ----------
    ratios : ndarray, shape (n_draws, n_parameters)
        Stiffness over nominal [-].
    truth : ndarray, shape (n_parameters,) | None, optional
        True stiffness over nominal [-]; None: unknown.
    contraction : ndarray, shape (n_parameters,) | None, optional
        1 − width of the 90 % interval over the prior's [-]; None: unknown. Written as a text and,
        for a flat prior, drawn as its density on the marginal's scale.
    flat_prior : bool, optional
        False for another prior, e.g. a farm's: its density is then not drawn.
    """
    axes = [_axis(ratios[:, i], None if truth is None else truth[i]) for i in range(len(names))]
    pairs = [(row, column) for row in range(len(names)) for column in range(row)]
    panels = pairs + [(i, i) for i in range(len(names))]
    return CornerPlot(
        draws=np.concatenate([_pair(ratios, axes, row, column) for row, column in pairs]),
        frames=tuple(_frame(row, column) for row, column in panels) + _tick_marks(axes),
        histograms=tuple(_histogram(ratios[:, i], axis, i) for i, axis in enumerate(axes)),
        priors=() if contraction is None or not flat_prior else _priors(ratios, axes, contraction),
        truth=() if truth is None else _truth_lines(truth, axes),
        texts=_texts(axes, names) + _prior_texts(contraction),
    )


def _axis(values: FloatArray, truth: float | None) -> Axis:
    low, high = np.quantile(values, [0.005, 0.995])
    if truth is not None:
        low, high = min(low, truth), max(high, truth)
    margin = max(0.12 * (high - low), 1e-6)
    return Axis(float(max(low - margin, 0.0)), float(high + margin))  # a ratio is positive


def _round_step(step: float) -> float:
    """Return the nearest 1, 2 or 5 times a power of ten that is not smaller."""
    power = 10.0 ** np.floor(np.log10(step))
    return float(next(factor * power for factor in (1, 2, 5, 10) if factor * power >= step - 1e-12))


def _panel_point(row: int, column: int, x: FloatArray, y: FloatArray) -> FloatArray:
    """(n, 2) picture positions of panel positions 0..1, y up inside the panel."""
    return np.stack([column * PITCH + x, row * PITCH + 1.0 - y], axis=-1)


def _pair(ratios: FloatArray, axes: Sequence[Axis], row: int, column: int) -> FloatArray:
    x = axes[column].position(ratios[:, column])
    y = axes[row].position(ratios[:, row])
    inside = (x >= 0) & (x <= 1) & (y >= 0) & (y <= 1)
    return _panel_point(row, column, x[inside], y[inside])


def _frame(row: int, column: int) -> FloatArray:
    return _panel_point(row, column, np.array([0.0, 1, 1, 0, 0]), np.array([0.0, 0, 1, 1, 0]))


def _histogram(values: FloatArray, axis: Axis, i: int) -> FloatArray:
    counts, edges = np.histogram(values, bins=HISTOGRAM_BINS, range=(axis.low, axis.high))
    heights = np.repeat(counts / max(counts.max(), 1) * PEAK, 2)
    x = np.repeat(axis.position(edges), 2)
    return _panel_point(i, i, x, np.concatenate([[0.0], heights, [0.0]]))


def _priors(
    ratios: FloatArray, axes: Sequence[Axis], contraction: FloatArray
) -> tuple[FloatArray, ...]:
    lines = zip(ratios.T, axes, contraction, strict=True)
    return tuple(
        _flat_prior(values, axis, i, learned)
        for i, (values, axis, learned) in enumerate(lines)
        if np.isfinite(learned) and learned < 1.0
    )


def _flat_prior(values: FloatArray, axis: Axis, i: int, contraction: float) -> FloatArray:
    """Return a uniform prior's density on the scale of a marginal's histogram.

    The prior's 90 % interval is w = (q₉₅ − q₀₅) / (1 − contraction) wide, so its density 0.9 / w.
    It is drawn over the whole panel, though its support may end inside it.
    """
    counts, edges = np.histogram(values, bins=HISTOGRAM_BINS, range=(axis.low, axis.high))
    highest = counts.max() / len(values) / (edges[1] - edges[0])  # the histogram's density
    low, high = np.quantile(values, [0.05, 0.95])
    density = 0.9 * (1.0 - contraction) / (high - low)
    return _panel_point(i, i, np.array([0.0, 1.0]), np.full(2, min(1.0, PEAK * density / highest)))


def _truth_lines(truth: FloatArray, axes: Sequence[Axis]) -> tuple[FloatArray, ...]:
    ends = np.array([0.0, 1.0])
    lines = []
    for row, axis in enumerate(axes):
        at_row = np.repeat(axis.position(truth[row : row + 1]), 2)
        for column in range(row + 1):
            at_column = np.repeat(axes[column].position(truth[column : column + 1]), 2)
            lines.append(_panel_point(row, column, at_column, ends))
            if column < row:
                lines.append(_panel_point(row, column, ends, at_row))
    return tuple(lines)


def _tick_marks(axes: Sequence[Axis]) -> tuple[FloatArray, ...]:
    last = len(axes) - 1
    mark = np.array([0.0, -0.03])
    marks = []
    for i, axis in enumerate(axes):
        for position in axis.position(axis.ticks):
            marks.append(_panel_point(last, i, np.full(2, position), mark))
            if i > 0:
                marks.append(_panel_point(i, 0, mark, np.full(2, position)))
    return tuple(marks)


def _texts(axes: Sequence[Axis], names: Sequence[str]) -> tuple[Text, ...]:
    last = len(axes) - 1
    texts = []
    for i, (axis, name) in enumerate(zip(axes, names, strict=True)):
        texts.append(Text((i * PITCH + 0.5, i * PITCH - 0.24), f"{name} / nominal [-]"))
        for tick, position in zip(axis.ticks, axis.position(axis.ticks), strict=True):
            label = f"{tick + 0.0:.4g}"  # 0, not -0
            if tick in axis.ticks[[0, -1]]:  # side by side there is room for two
                texts.append(Text((i * PITCH + float(position), last * PITCH + 1.1), label))
            if i > 0:
                texts.append(Text((-0.16, i * PITCH + 1.0 - float(position)), label))
    return tuple(texts)


def _percent(value: float) -> str:
    return f"{value:.2g}" if value < 99.5 else f"{value:.0f}"  # 110, not 1.1e+02


def _prior_texts(contraction: FloatArray | None) -> tuple[Text, ...]:
    left = np.empty(0) if contraction is None else 100.0 * (1.0 - contraction)
    return tuple(
        Text((i * PITCH + 0.5, i * PITCH - 0.45), f"{_percent(percent)} % of prior width")
        for i, percent in enumerate(left)
        if np.isfinite(percent)
    )
