"""Tabs on a narrow screen: what stands side by side on a wide one is in tabs of its own.

Laid out for a window as wide as `outputs/web/page.js` makes it, NARROW_AS.
"""

from typing import Any, TypeVar

import rerun.blueprint as rrb

_View = TypeVar("_View", bound=rrb.View)
LONGEST_TITLE = 57  # beside a view's buttons [characters]


def in_tabs(name: str, *parts: Any) -> rrb.Tabs:
    """Return parts as tabs, the first one open."""
    return rrb.Tabs(*parts, active_tab=0, name=name)


def alone(name: str, view: rrb.View, title: str = "") -> rrb.Vertical:
    """Return a view in a tab with a short name, its own title below it."""
    return rrb.Vertical(titled(view, title) if title else view, name=name)


def titled(view: _View, title: str) -> _View:
    """Give a view a title of at most LONGEST_TITLE characters; more are cut."""
    view.name = title
    return view
