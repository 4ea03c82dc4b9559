"""The tab "Health": lost blocks, delays, windows and nodes."""

import rerun.blueprint as rrb

from pipeline.viewer.tabs.narrow import alone, in_tabs
from pipeline.viewer.view_parameters import time_series


def health(root: str, *, nodes: str) -> rrb.Horizontal:
    """Return the tab for a wide screen; `nodes`: the path below which the nodes report."""
    return rrb.Horizontal(rrb.Vertical(*node_views(root, nodes)), windows_view(root), name="Health")


def narrow_health(root: str, *, nodes: str) -> rrb.Tabs:
    """Return the tab for a narrow screen."""
    return in_tabs(
        "Health",
        alone("State", windows_view(root)),
        rrb.Vertical(*node_views(root, nodes), name="Loss and delay"),
    )


def node_views(root: str, nodes: str) -> list[rrb.TimeSeriesView]:
    """Return plots of loss and delay with one line per node."""
    shared = "" if nodes == root else ", nodes of the session"
    return [
        time_series(f"{nodes}/health/lost", f"Blocks lost or late [-]{shared}", "LeftTop"),
        time_series(
            f"{nodes}/health/behind", f"Delay behind the newest block [s]{shared}", "LeftTop"
        ),
    ]


def windows_view(root: str) -> rrb.TextDocumentView:
    """Return what became of the windows, as text."""
    return rrb.TextDocumentView(origin=f"{root}/health/text", name="Windows, gaps, nodes")
