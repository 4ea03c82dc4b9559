"""What the files of a folder that is replayed do not have in common: the newest layout is used for
all; time that two files hold is used twice."""

import logging
from collections.abc import Iterator, Sequence

from pipeline.recording.file_order import shared_times, stretch_of, utc_span
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


def report_shared_times(infos: Sequence[RecordingInfo]) -> None:
    """Log what two files hold of the same time of a unit, a line for each.

    Parameters
    ----------
    infos : sequence of RecordingInfo
        Of the files, oldest first.
    """
    stretches = [stretch_of(info.path, unit) for info in infos for unit in info.units]
    stretches.sort(key=lambda stretch: stretch.start_ns)
    for shared in shared_times(stretches):
        before, after = stretches[shared.before], stretches[shared.after]
        logger.warning(
            "%s: %s and %s both cover %s; both are used (`pilewatch reprocess` uses them once)",
            before.unit[0],
            before.path,
            after.path,
            utc_span(shared.start_ns, shared.end_ns),
        )
