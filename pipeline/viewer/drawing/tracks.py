"""Draw what is measured and identified over time: accelerations, frequencies, damping."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from pipeline.messages import ModalEstimate, Mode
from pipeline.state.phrases import in_hertz
from pipeline.viewer.drawing.entities import (
    entity_part,
    log_band_style,
    log_line_style,
    mode_path,
    time_column,
)
from pipeline.viewer.pictures import colours
from pipeline.viewer.pictures.display_signals import DisplaySignal
from pipeline.viewer.pictures.scene import deflection
from sensors.acquisition.layout import SensorLayout

BAND = 2.0  # standard deviations either side


def log_signal_style(recording: rr.RecordingStream, path: str, layout: SensorLayout) -> None:
    """Names with units and a colour for each level."""
    levels = sorted({channel.elevation for channel in layout.channels})
    palette = [
        colours.LEVELS[levels.index(channel.elevation) % len(colours.LEVELS)]
        for channel in layout.channels
    ]
    names = [f"{channel.name} [{channel.unit or '-'}]" for channel in layout.channels]
    recording.log(
        path,
        rr.SeriesLines(
            names=names, colors=palette, widths=[1.0] * len(names), aggregation_policy="MinMax"
        ),
        static=True,
    )


def log_signal(recording: rr.RecordingStream, path: str, signals: Sequence[DisplaySignal]) -> None:
    """Display samples of consecutive blocks of as many channels as one chunk."""
    times = np.concatenate([signal.times_ns for signal in signals])
    samples = np.concatenate([signal.samples for signal in signals])
    if len(times):
        recording.send_columns(path, [time_column(times)], rr.Scalars.columns(scalars=samples))


def log_estimate(
    recording: rr.RecordingStream,
    root: str,
    estimate: ModalEstimate,
    layout: SensorLayout | None,
    *,
    styled: set[str],
    first: dict[str, float],
) -> None:
    """Every identified frequency as a point; untracked modes share entities by rank.

    Parameters
    ----------
    styled : set[str]
        Entities whose colour and name are already written; it grows here.
    first : dict[str, float]
        First frequency of each track [Hz], the reference of its change; it grows here.
    """
    for rank, mode in enumerate(estimate.modes):
        name = mode.name or f"untracked {rank}"
        path = f"{root}/frequencies/identified/{entity_part(name)}"
        if path not in styled:
            styled.add(path)
            _log_identified_style(recording, path, name, _direction(mode, estimate, layout))
        recording.log(path, rr.Scalars(mode.frequency))
        if mode.name:
            _log_change(recording, root, mode, styled=styled, first=first)


def _log_change(
    recording: rr.RecordingStream,
    root: str,
    mode: Mode,
    *,
    styled: set[str],
    first: dict[str, float],
) -> None:
    """Draw a track's frequency relative to its first one [%]: on one axis for all modes."""
    path = f"{root}/frequencies/change/{entity_part(mode.name)}"
    reference = first.setdefault(mode.name, mode.frequency)
    if path not in styled:
        styled.add(path)
        colour = colours.LEVELS[list(first).index(mode.name) % len(colours.LEVELS)]
        name = f"{mode.name}, {in_hertz(reference)} Hz [%]"
        log_line_style(recording, path, name, colour, width=1.5)
    recording.log(path, rr.Scalars(100.0 * (mode.frequency / reference - 1.0)))


def _direction(mode: Mode, estimate: ModalEstimate, layout: SensorLayout | None) -> str:
    return deflection(layout, estimate.channels, mode.shape).direction if layout else ""


def _log_identified_style(
    recording: rr.RecordingStream, path: str, name: str, direction: str
) -> None:
    colour = {"FA": colours.SKY_BLUE, "SS": colours.REDDISH_PURPLE}.get(direction, colours.NEUTRAL)
    recording.log(
        path,
        rr.SeriesPoints(
            names=[f"identified {name} {direction} [Hz]"],
            colors=[colour],
            markers=["circle"],
            marker_sizes=[2.5],
        ),
        static=True,
    )


def log_mode_styles(recording: rr.RecordingStream, root: str, label: str, slot: int) -> None:
    """Names and colours of one model mode's tracks; static."""
    path = mode_path(root, label)
    log_band_style(
        recording,
        f"{path}/identified",
        ("identified −2 std [Hz]", "identified [Hz]", "identified +2 std [Hz]"),
        colours.MEASURED,
    )
    log_line_style(recording, f"{path}/model", f"model {label} [Hz]", colours.MODEL, width=1.5)
    colour = colours.LEVELS[slot % len(colours.LEVELS)]
    log_line_style(recording, f"{path}/damping", f"mode {label} [%]", colour)


def log_model_frequency(
    recording: rr.RecordingStream, root: str, label: str, frequency: float
) -> None:
    """Draw where the updated model has one mode [Hz]."""
    recording.log(f"{mode_path(root, label)}/model", rr.Scalars(frequency))


def log_identified(recording: rr.RecordingStream, root: str, label: str, mode: Mode) -> None:
    """An identified mode over the model's of that label: frequency with its band, and damping."""
    path = mode_path(root, label)
    recording.log(f"{path}/identified", _band(mode.frequency, mode.frequency_std))
    recording.log(f"{path}/damping", rr.Scalars(mode.damping_ratio * 100.0))


def _band(value: float, std: float) -> rr.Scalars:
    return rr.Scalars([value - BAND * std, value, value + BAND * std])
