"""NodeScreen: what the nodes of one turbine lose, and how far they are behind."""

import rerun as rr

from pipeline.messages import NodeStatus
from pipeline.viewer import foundation_views
from sensors.acquisition.blocks import NANOSECONDS


class NodeScreen:
    """Draws a row of a node at most every `period` [s], with the worst since the last one."""

    def __init__(self, recording: rr.RecordingStream, root: str, *, period: float) -> None:
        self._recording = recording
        self._root = root
        self._period = period
        self._rows: dict[str, int] = {}  # node → time of its latest row; has its style
        self._behind_most: dict[str, float] = {}  # node → most since its latest row [s]

    def show(self, node: NodeStatus, now_ns: int, *, behind: float, news: bool) -> None:
        """A row where one is due, or where there is news; `behind` the newest block [s]."""
        behind = max(behind, self._behind_most.get(node.node, 0.0))
        if self._is_due(node.node, now_ns) or news:
            foundation_views.log_node(self._recording, self._root, node, behind=behind)
            behind = 0.0
        self._behind_most[node.node] = behind

    def _is_due(self, node: str, now_ns: int) -> bool:
        """Whether a node's plots get their next row now; the first comes with their style."""
        if node not in self._rows:
            slot = len(self._rows)
            foundation_views.log_node_styles(self._recording, self._root, node, slot)
        elif now_ns - self._rows[node] < self._period * NANOSECONDS:
            return False
        self._rows[node] = now_ns
        return True
