"""What a person may choose about a session, beside its source."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from pipeline.monitoring.alarms.settings import AlarmSettings
from pipeline.transport.zenoh_bus import ZenohSettings
from pipeline.viewer.outputs.outputs import ViewerOutput

Way = Literal["threads", "processes", "lock-step"]


@dataclass(frozen=True, slots=True)
class SessionOptions:
    """What a person may choose about a session, beside its source."""

    out: Path = Path("out")
    speed: float = float("inf")
    """1: real time; infinity: as fast as the nodes follow."""
    way: Way = "threads"
    rrd: bool = True
    """Write out/session.rrd."""
    view: ViewerOutput | None = None
    """A viewer beside it."""
    zenoh: ZenohSettings = field(default_factory=ZenohSettings)
    fresh: bool = False
    """Start from the beginning, whatever checkpoint there is."""
    shards: int = 1
    """Processes that share the turbines, of each node that can be shared."""
    elsewhere: tuple[str, ...] = ()
    """Nodes of a live session that run on other machines."""
    metrics: int | None = None
    """Port on this machine where Prometheus may ask."""
    notices: AlarmSettings | None = None
    """Whom to notify of what; None: no one."""
