"""Create matplotlib figures.

Pictures for a page are SVG, so that they stay sharp on every screen and on paper and their text
can be searched; text and axes have the page's own text colour, dark or light. Clouds of points are
pixels inside them: a thousand vector points would be larger than the rest of the page.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from io import StringIO
from typing import Any

from pipeline.viewer.pictures.colours import Colour

INK = "#010203"  # stands for the page's text colour until the SVG is written
PAPER = "#fdfcfb"  # stands for the page's background
FIGURE_WIDTH = 4.2  # of a figure on a page [inch]: readable on a phone without zooming
DOTS_PER_INCH = 200  # of what is drawn as pixels


def new_figure(size: tuple[float, float]) -> Any:
    """Return an empty matplotlib figure.

    Parameters
    ----------
    size : tuple[float, float]
        Width and height [inch].
    """
    from matplotlib.figure import Figure

    return Figure(figsize=size, layout="constrained")


@contextmanager
def page_figure(height: float) -> Iterator["PageFigure"]:
    """Create a figure for a page, drawn and written within the `with` block.

    Parameters
    ----------
    height : float
        Height of the figure [inch].
    """
    figure = new_figure((FIGURE_WIDTH, height))
    from matplotlib import rc_context

    with rc_context(_STYLE):
        yield PageFigure(figure)


class PageFigure:
    """A matplotlib figure and the SVG that it becomes."""

    def __init__(self, figure: Any) -> None:
        self.figure = figure

    def svg(self) -> str:
        """Return the figure as SVG, its ink `currentColor`; the same figure gives the same text."""
        written = StringIO()
        self.figure.savefig(
            written, format="svg", dpi=DOTS_PER_INCH, transparent=True, metadata={"Date": None}
        )
        return written.getvalue().replace(INK, "currentColor").replace(PAPER, "Canvas")


def css_colour(colour: Colour) -> str:
    """Return a colour of the viewer as matplotlib and CSS write it."""
    red, green, blue = colour
    return f"#{red:02x}{green:02x}{blue:02x}"


_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "pilewatch",
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "text.color": INK,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": INK,
    "grid.alpha": 0.15,
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.3,
}
