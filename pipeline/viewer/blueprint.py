"""The tabs of a session; one blueprint for one or more turbines, on a wide or a narrow screen."""

from collections.abc import Sequence

import rerun.blueprint as rrb

from pipeline.viewer.drawing.entities import TIMELINE, turbine_path
from pipeline.viewer.tabs.farm import farm, narrow_farm
from pipeline.viewer.tabs.foundation import foundation, narrow_foundation
from pipeline.viewer.tabs.health import health, narrow_health
from pipeline.viewer.tabs.modes import modes, narrow_modes
from pipeline.viewer.tabs.narrow import in_tabs
from pipeline.viewer.tabs.overview import narrow_overview, overview
from pipeline.viewer.tabs.signals import narrow_signals, signals
from pipeline.viewer.view_parameters import NARROW_MARGINS, ViewParameters, with_margins

NARROW_NAME = "narrow screen"  # of the layout, by which the page knows it


def session_blueprint(
    parameters: Sequence[ViewParameters],
    *,
    playback_speed: float,
    span_ns: tuple[int, int] | None = None,
    narrow: bool = False,
) -> rrb.Blueprint:
    """Return the tabs of one turbine; of several, a tab of all and one per turbine.

    Parameters
    ----------
    playback_speed : float
        Sensor seconds per second of playback [-].
    span_ns : tuple of int, optional
        Start and end of a session that is over [ns since 1970]; while it runs, plots grow with it.
    narrow : bool, optional
        For a narrow screen: views in tabs, not side by side.
    """
    listing = next((each.turbine for each in parameters if each.lists_nodes), None)
    top = _narrow_tabs(parameters, listing) if narrow else _wide_tabs(parameters, listing)
    if span_ns is not None and span_ns[0] < span_ns[1]:
        with_margins(top, span_ns, *(NARROW_MARGINS if narrow else ()))
    return rrb.Blueprint(
        top,
        rrb.TimePanel(
            state="collapsed",
            timeline=TIMELINE,
            play_state="following",  # opens at the end, where everything is; a loop_mode ends that
            playback_speed=playback_speed,
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )


def _wide_tabs(parameters: Sequence[ViewParameters], listing: str | None) -> rrb.Tabs:
    each = [turbine_tabs(each, nodes_of=listing) for each in parameters]
    return each[0] if len(each) == 1 else rrb.Tabs(farm(parameters), *each, active_tab=0)


def _narrow_tabs(parameters: Sequence[ViewParameters], listing: str | None) -> rrb.Tabs:
    each = [turbine_tabs(each, nodes_of=listing, narrow=True) for each in parameters]
    if len(each) == 1:
        return in_tabs(NARROW_NAME, *each[0].contents)
    return in_tabs(NARROW_NAME, narrow_farm(parameters), *each)


def turbine_tabs(
    parameters: ViewParameters, *, nodes_of: str | None = None, narrow: bool = False
) -> rrb.Tabs:
    """Return Overview, Signals, Modes, Foundation and Health of one turbine.

    Parameters
    ----------
    nodes_of : str, optional
        Turbine under whose name the session's nodes report, for one that lists none.
    narrow : bool, optional
        For a narrow screen.
    """
    root = turbine_path(parameters.turbine)
    own = parameters.lists_nodes or nodes_of is None
    nodes = root if own else turbine_path(str(nodes_of))
    tabs = [
        (narrow_overview if narrow else overview)(root, parameters),
        (narrow_signals if narrow else signals)(root, parameters),
        (narrow_modes if narrow else modes)(root, parameters),
    ]
    if parameters.has_structure:
        tabs.append((narrow_foundation if narrow else foundation)(root, parameters))
    tabs.append((narrow_health if narrow else health)(root, nodes=nodes))
    return in_tabs(parameters.turbine, *tabs)
