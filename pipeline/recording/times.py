"""When a message belongs to, on the sensor clock."""

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    FoundationTruth,
    Message,
    ModalEstimate,
    NodeStatus,
    PooledPosterior,
    StabilisationDiagram,
    StreamEnd,
    StreamGap,
    WindowRejected,
)
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.scada import ScadaSample


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
        case ScadaSample() | StreamEnd() | NodeStatus():
            return message.time_ns
        case _:
            return None
