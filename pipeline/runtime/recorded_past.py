"""What an identification that is started again needs of the recordings."""

from collections.abc import Sequence
from pathlib import Path

from pipeline.messages import Message
from pipeline.oma.settings import OmaSettings
from pipeline.oma.windows.unit_alignment import FITTED_STAMPS
from pipeline.recording.latest_messages import latest_messages
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.scada import ScadaSample

MEASUREMENTS = (SensorLayout, AccelerationBlock, ScadaSample)
MARGIN = 10.0 + FITTED_STAMPS  # [s] of blocks that a clock's line is fitted to


def recorded_past(files: Sequence[Path], settings: OmaSettings) -> tuple[Message, ...]:
    """The samples of an open window, and of one before it that may not have been answered."""
    horizon = 2 * (settings.window_duration + settings.hop) + settings.lateness + MARGIN
    return latest_messages(files, MEASUREMENTS, horizon=horizon)
