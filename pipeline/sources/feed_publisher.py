"""A live instrument on the bus: its blocks, SCADA samples and status.

instrument ──► [feed] ──► AccelerationBlock, ScadaSample     as of any other source
                     └──► NodeStatus, every second: what came, what never did, why the link is down
"""

import logging
import os
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.messages import (
    FEED_MESSAGE,
    Message,
    MessageCount,
    NodeStatus,
    QualityWarning,
    message_counts,
)
from pipeline.runtime.node_thread import STATUS_PERIOD, open_session
from pipeline.runtime.source_feed import BlockReport, with_end
from pipeline.runtime.watchdog import Watchdog
from pipeline.sources.publisher import kept_until_acknowledged
from pipeline.sources.spool import Spool
from pipeline.transport.awaited_bus import AwaitedBus
from pipeline.transport.zenoh_bus import ZenohBus, ZenohSettings
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import LayoutError, SensorLayout
from sensors.feeds.address import is_feed
from sensors.feeds.assembly.channel_map import sensor_layout
from sensors.feeds.live import LiveFeed
from sensors.feeds.open_feed import layout_file_of, open_feed
from sensors.feeds.protocol import FeedError
from sensors.files.layout_file import LayoutFile, load_layout

if TYPE_CHECKING:
    from pipeline.sources.sources import Source

logger = logging.getLogger(__name__)

NODE = "feed"
SCADA = "scada+"  # begins the address of a controller, which has no channels on the tower
QUIET_INSTRUMENT = 60.0  # of an instrument, before a link that is up is doubted [s]
NOTHING_CAME = "is the address right, is data sent, and may this user read it?"
QUIET_CONTROLLER = 3600.0  # the same: they speak every few minutes


@dataclass(frozen=True, slots=True)
class FeedResult:
    """What became of a feed."""

    status: NodeStatus
    """Its last status."""

    blocks: int
    """Blocks that were published."""

    scada_samples: int
    """SCADA samples that were published."""

    missing_blocks: int
    """Blocks that its gaps cost."""


def publish_feed(
    live: LiveFeed,
    layout: SensorLayout,
    settings: ZenohSettings,
    *,
    stopping: threading.Event,
    report: BlockReport | None = None,
    connected: Callable[[], None] = lambda: None,
    spool: Spool | None = None,
) -> FeedResult:
    """Publish what an instrument measures until `stopping` is set.

    It is heard while the session opens too, which waits for its router where its configuration has
    no limit of time; blocks are spooled meanwhile.

    Parameters
    ----------
    layout : SensorLayout
        Layout of its channels, with the turbine and the unit that it stands for.
    connected : Callable[[], None], optional
        Called once, when the instrument is reached.
    spool : Spool, optional
        Keeps blocks until a shore station has them, and is closed in the end.

    Raises
    ------
    FeedError
        If the feed cannot be opened.
    TransportError
        If the session cannot be opened.
    """
    kept = None if spool is None else spool.last_of(layout.turbine, layout.unit)
    if kept is not None:
        live.take_kept(kept.start_ns, kept.end_ns)
    account = FeedAccount(live, layout, connected=connected)
    watchdog = Watchdog(os.environ)
    with (
        open_session(lambda: AwaitedBus(partial(ZenohBus, settings))) as bus,
        kept_until_acknowledged(bus, spool, account.warn_of) as publish,
    ):
        for message in with_end(account.messages(stopping)):
            publish(message)
            watchdog.alive()
            if report and isinstance(message, AccelerationBlock):
                report(message)
    return account.fed()


def channels_of(
    address: str, layout: Path | None, scenario: str | None, turbine: str | None = None
) -> LayoutFile:
    """Return where an instrument's channels are: by a layout file, or as a scenario's sensors.

    Parameters
    ----------
    address : str
        Of the instrument; SCADA has no channels and needs a turbine only.
    layout : Path or None
        File that lists them.
    scenario : str or None
        Whose sensors they are.
    turbine : str, optional
        Its name; None: as layout or scenario have it.

    Raises
    ------
    LayoutError
        If nothing states where they are: it is never assumed.
    ScenarioError
    """
    channels = _stated_channels(address, layout, scenario, turbine)
    return channels if turbine is None else replace(channels, turbine=turbine)


def _stated_channels(
    address: str, layout: Path | None, scenario: str | None, turbine: str | None
) -> LayoutFile:
    if layout is not None:
        return load_layout(layout)
    if scenario is None and is_feed(address):
        if not address.startswith(SCADA):
            raise LayoutError(
                f"{address}: where on the tower are its channels? --layout FILE.toml says it"
            )
        if turbine is None:
            raise LayoutError(f"{address}: of which turbine? --turbine NAME says it")
    # here and not above: a tower unit with a layout file needs no structure and no updating
    from pipeline.scenario import DEFAULT_SCENARIO, load_scenario

    return layout_file_of(load_scenario(scenario or DEFAULT_SCENARIO).layout)


def feed_source(
    address: str, layout: Path | None, scenario: str | None, state: Path | None = None
) -> "Source":
    """Return a live instrument as the source of a session that listens to it itself.

    Parameters
    ----------
    layout : Path or None
        File that lists where its channels are; None: they are the scenario's sensors.
    scenario : str or None
        What is made of them; None: modes are tracked, nothing is updated.
    state : Path, optional
        Folder in which it is remembered how far the source was published.

    Raises
    ------
    FeedError
    LayoutError
    ScenarioError
    """
    from pipeline.scenario import load_scenario, modes_only, require_stated_structure
    from pipeline.sources.sources import Source, report_modes_only

    channels = channels_of(address, layout, scenario)
    live = open_feed(address, channels, state=state)
    if not live.gives_blocks:
        raise FeedError(f"{address} measures no accelerations; run `pilewatch feed {address}`")
    if scenario is None:
        report_modes_only(address)
        chosen = modes_only(channels.turbine)
    else:
        chosen = require_stated_structure(load_scenario(scenario))
    return Source(address, chosen, sensor_layout(channels), truth=None, duration=None, feed=live)


class FeedAccount:
    """A feed's messages with its books.

    Parameters
    ----------
    clock : Callable[[], int], optional
        Returns the time [ns since 1970-01-01 UTC].
    connected : Callable[[], None], optional
        Called once, when the instrument is reached.
    """

    def __init__(
        self,
        live: LiveFeed,
        layout: SensorLayout,
        clock: Callable[[], int] = time.time_ns,
        connected: Callable[[], None] = lambda: None,
    ) -> None:
        self.published: Counter[str] = Counter()
        self._live, self._layout, self._clock = live, layout, clock
        self._connected = connected
        self._last_sequence = -1
        self._last_received = (0, clock())  # messages so far, and when the last of them came [ns]
        self._quiet = False
        self._patience = QUIET_INSTRUMENT if live.gives_blocks else QUIET_CONTROLLER
        self._named: set[str] = set()  # channels that no layout lists, and that were logged
        self._others: Callable[[], tuple[QualityWarning, ...]] = tuple

    def warn_of(self, warnings: Callable[[], tuple[QualityWarning, ...]]) -> None:
        """Give these warnings too, of what else publishes the messages."""
        self._others = warnings

    def messages(self, stopping: threading.Event) -> Iterator[Message]:
        """Yield the layout, then what is measured as it comes.

        A status comes at the beginning, every second and at the end.
        """
        if self._live.gives_blocks:
            yield self._layout
        yield self.status("ready")
        reported_ns, reached = self._clock(), False
        for measured in self._live.measured(stopping):
            if measured is not None:
                self.published[type(measured).__name__] += 1
                if isinstance(measured, AccelerationBlock):
                    self._last_sequence = measured.sequence
                yield measured
            if self._live.counts.connected and not reached:
                reached = True
                self._connected()
            if self._clock() - reported_ns > STATUS_PERIOD * 1e9:
                reported_ns = self._clock()
                self._watch_silence(reported_ns)
                yield self.status("running")
                self._name_unknown()
        self._name_unknown()
        yield self.status("stopped")

    def _watch_silence(self, now_ns: int) -> None:
        """Log once whenever nothing comes over a link that is up."""
        counts = self._live.counts
        if counts.received != self._last_received[0] or not counts.connected:
            self._last_received, self._quiet = (counts.received, now_ns), False
        if not self._quiet and now_ns - self._last_received[1] > self._patience * NANOSECONDS:
            self._quiet = True
            logger.warning("%s", self._silence)

    @property
    def _silence(self) -> str:
        text = f"{self._live.name}: the link is up and nothing has"
        if self._last_received[0]:
            return f"{text} come for more than {self._patience:g} s"
        return f"{text} ever come; {NOTHING_CAME}"

    def fed(self) -> FeedResult:
        """Return the counts at the end."""
        return FeedResult(
            self.status("stopped"),
            self.published["AccelerationBlock"],
            self.published["ScadaSample"],
            self._live.missing_blocks,
        )

    def status(self, state: str) -> NodeStatus:
        """Return the feed's status now; `lost` counts its instrument's messages."""
        counts = self._live.counts
        unit = self._layout.unit if self._live.gives_blocks else "scada"
        return NodeStatus(
            turbine=self._layout.turbine,
            node=f"{NODE}-{unit}",
            time_ns=self._clock(),
            state=state,
            last_sequence=self._last_sequence,
            received=(MessageCount(FEED_MESSAGE, counts.received),),
            published=message_counts(self.published),
            lost=counts.lost,
            late=counts.late,
            duplicate=counts.duplicate,
            malformed=counts.malformed + counts.forged,
            warnings=(*self._warnings(state), *self._others()),
        )

    def _warnings(self, state: str) -> Iterator[QualityWarning]:
        counts, name = self._live.counts, self._live.name
        never = state == "stopped" and not counts.connections and bool(counts.problem)
        if (not counts.connected and state == "running") or never:
            yield QualityWarning("link-down", f"{name}: {counts.problem or 'not connected yet'}")
        if self._quiet:
            yield QualityWarning("quiet", self._silence)
        elif state == "stopped" and counts.connections and not counts.received:
            yield QualityWarning("quiet", f"{name}: nothing came; {NOTHING_CAME}")
        if counts.retained:
            yield QualityWarning(
                "retained",
                f"{name}: {counts.retained} measurements that the broker had kept were left out",
            )
        if counts.unknown:
            channels = ", ".join(sorted(counts.unknown))
            yield QualityWarning(
                "unknown-channels", f"{name} sends what no layout lists: {channels}"
            )
        if counts.malformed + counts.forged:
            yield QualityWarning(
                "malformed", f"{name}: messages were dropped, the last: {counts.refusal}"
            )
        if self._live.absent:
            yield QualityWarning(
                "gap",
                f"{name}: {self._live.absent:.3f} s before the feed's restart are missing; the "
                "source no longer had them",
            )
        missing = self._live.missing_blocks
        if missing:
            yield QualityWarning("gap", f"{name}: blocks that are missing in its gaps: {missing}")

    def _name_unknown(self) -> None:
        """Log each channel that is left out once."""
        for channel in sorted(self._live.counts.unknown.keys() - self._named):
            self._named.add(channel)
            logger.warning("%s: no layout lists the channel %r", self._live.name, channel)
