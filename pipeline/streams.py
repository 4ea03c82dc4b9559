"""The table: which message travels on which key, how often, and whether it is recorded."""

from dataclasses import dataclass

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    FoundationTruth,
    Message,
    ModalEstimate,
    NodeStatus,
    PooledPosterior,
    RecordedUntil,
    StabilisationDiagram,
    StreamEnd,
    StreamGap,
    WindowRejected,
)
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.scada import ScadaSample


@dataclass(frozen=True, slots=True)
class Stream:
    """One kind of message on its way through the system."""

    message: type
    key: str
    """Zenoh key and MCAP topic; {turbine}, {unit}, {node} are the message's own fields."""

    period: float | None = None
    """Expected between two messages [s]; None: when it happens."""

    cached: int = 1
    """Messages that a late or interrupted subscriber can still get; 0: a message that is lost is
    made up for by the next one."""

    recorded: bool = True

    def key_of(self, message: Message) -> str:
        """Return the key of one message, e.g. pilewatch/iea15mw/tower/acceleration."""
        fields = {name: getattr(message, name, "") for name in ("turbine", "unit", "node")}
        return self.key.format(**fields)

    @property
    def key_expression(self) -> str:
        """The Zenoh key expression that matches every turbine, unit and node."""
        return self.key.format(turbine="*", unit="*", node="*")


STREAMS = (
    # A link may be cut for twenty minutes, and an identification that is started again refills its
    # window from what is cached; what a longer window lacks it takes from the recording.
    Stream(AccelerationBlock, "pilewatch/{turbine}/{unit}/acceleration", period=1.0, cached=1200),
    Stream(SensorLayout, "pilewatch/{turbine}/{unit}/layout"),
    Stream(ScadaSample, "pilewatch/{turbine}/scada", period=10.0, cached=100),
    Stream(StreamGap, "pilewatch/{turbine}/{unit}/gap", cached=100),
    Stream(StreamEnd, "pilewatch/{turbine}/{unit}/end"),
    # From the recorder to the unit: what it no longer needs to keep.
    Stream(RecordedUntil, "pilewatch/{turbine}/{unit}/recorded", cached=0, recorded=False),
    Stream(FoundationTruth, "pilewatch/{turbine}/truth"),
    # 140 kB each: three hours of windows, 3 MB a turbine. An updating that is started again later
    # takes what it lacks from the recording.
    Stream(ModalEstimate, "pilewatch/{turbine}/modal-estimate", period=600.0, cached=20),
    Stream(StabilisationDiagram, "pilewatch/{turbine}/stabilisation-diagram", period=600.0),
    Stream(WindowRejected, "pilewatch/{turbine}/window-rejected", cached=100),
    Stream(
        FoundationPosterior, "pilewatch/{turbine}/foundation-posterior", period=600.0, cached=10
    ),
    Stream(PooledPosterior, "pilewatch/{turbine}/pooled-posterior"),
    Stream(FoundationEvent, "pilewatch/{turbine}/foundation-event", cached=100),
    Stream(NodeStatus, "pilewatch/{turbine}/status/{node}", period=1.0),
)

_BY_MESSAGE = {stream.message: stream for stream in STREAMS}


def stream_of(message: type) -> Stream:
    """Return the stream on which a message type travels; KeyError for a type not in the table."""
    return _BY_MESSAGE[message]


def key_of(message: Message) -> str:
    """Return the key on which this message travels."""
    return stream_of(type(message)).key_of(message)


def time_of(message: Message) -> int | None:
    """Time to file a message under [ns since 1970-01-01 UTC]; None for one that holds for ever.

    Samples and gaps are filed under their beginning, results under the end of the window they
    come from; a NodeStatus has the time of its machine.
    """
    match message:
        case AccelerationBlock() | StreamGap():
            return message.start_ns
        case ModalEstimate() | StabilisationDiagram() | WindowRejected():
            return message.end_ns
        case FoundationPosterior() | PooledPosterior() | FoundationEvent() | FoundationTruth():
            return message.time_ns
        case ScadaSample() | StreamEnd() | RecordedUntil() | NodeStatus():
            return message.time_ns
        case _:
            return None
