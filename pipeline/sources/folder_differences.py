"""Where the files of a folder that is replayed state other layouts: the newest is used for all."""

import logging
from collections.abc import Iterator, Sequence

from pipeline.recording.info import RecordingInfo
from sensors.acquisition.layout import SensorLayout, layout_difference

logger = logging.getLogger(__name__)

MOST_LAYOUT_LINES = 5  # that are reported


def report_other_layouts(infos: Sequence[RecordingInfo]) -> None:
    """Log where older files state another layout than the newest, a line for each unit.

    Parameters
    ----------
    infos : sequence of RecordingInfo
        Of the files, oldest first.
    """
    newest = infos[-1]
    for layout in newest.layouts[:MOST_LAYOUT_LINES]:
        for older, other in _older(infos, layout):
            changed = layout_difference(other, layout)
            if changed is not None:
                logger.warning(
                    "%s: channel %s %s in %s, %s in %s; all windows are read at the layout of the "
                    "newest file (`pilewatch reprocess` reads each at its own)",
                    layout.turbine,
                    changed.channel,
                    changed.before,
                    older.path,
                    changed.after,
                    newest.path,
                )
                break


def _older(
    infos: Sequence[RecordingInfo], layout: SensorLayout
) -> Iterator[tuple[RecordingInfo, SensorLayout]]:
    """Yield the unit's layouts in older files, the newest first."""
    for info in reversed(infos[:-1]):
        for other in info.layouts:
            if (other.turbine, other.unit) == (layout.turbine, layout.unit):
                yield info, other
