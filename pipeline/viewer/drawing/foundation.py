"""Draw the foundation's posterior: bands over time, joint posterior, texts, events."""

import numpy as np
import rerun as rr

from pipeline.messages import FoundationEvent, FoundationPosterior, FoundationTruth, NodeStatus
from pipeline.state.posterior_json import STIFFNESSES
from pipeline.viewer.drawing.entities import (
    entity_part,
    log_band_style,
    log_line_style,
    median_path,
    parameter_path,
    strips,
    text_labels,
    width_path,
)
from pipeline.viewer.pictures import colours
from pipeline.viewer.pictures.corner import CornerPlot, corner_plot
from pipeline.viewer.pictures.pile import PilePicture


def log_foundation_styles(recording: rr.RecordingStream, root: str) -> None:
    """Names, units and colours of the posterior's bands; static."""
    for name in STIFFNESSES:
        names = (f"{name} 5 % [-]", f"{name} median [-]", f"{name} 95 % [-]")
        path = parameter_path(root, name)
        log_band_style(recording, f"{path}/posterior", names, colours.POSTERIOR)
        log_line_style(recording, f"{path}/truth", f"{name} truth [-]", colours.TRUTH)
    for slot, name in enumerate((*STIFFNESSES, "sigma")):
        shown = f"{'σ' if name == 'sigma' else name} [%]"
        log_line_style(recording, width_path(root, name), shown, colours.LEVELS[slot])
    log_line_style(
        recording, f"{root}/change/probability", "probability [-]", colours.POSTERIOR, width=1.5
    )
    log_line_style(
        recording, f"{root}/change/noticed", "detected change [-]", colours.FAULT, width=4.0
    )
    names = ("σ 5 % [-]", "σ median [-]", "σ 95 % [-]")
    log_band_style(
        recording, f"{parameter_path(root, 'sigma')}/posterior", names, colours.POSTERIOR
    )


def log_posterior_bands(
    recording: rr.RecordingStream,
    root: str,
    posterior: FoundationPosterior,
    truth: FoundationTruth | None,
) -> None:
    """5 %, 50 % and 95 % of each parameter, stiffness as ratio to nominal, with the truth."""
    for parameter in posterior.parameters:
        quantiles = np.array([parameter.p05, parameter.median, parameter.p95]) / parameter.nominal
        path = parameter_path(root, parameter.name)
        recording.log(f"{path}/posterior", rr.Scalars(quantiles))
        if truth is not None and parameter.name in STIFFNESSES:
            ratio = getattr(truth, parameter.name) / parameter.nominal
            recording.log(f"{path}/truth", rr.Scalars(ratio))


def log_medians(recording: rr.RecordingStream, posterior: FoundationPosterior) -> None:
    """Draw one turbine's medians, stiffness ÷ nominal, on the tab of all turbines."""
    for name in STIFFNESSES:
        parameter = posterior.parameter(name)
        ratio = parameter.median / parameter.nominal
        recording.log(median_path(name, posterior.turbine), rr.Scalars(ratio))


def log_median_styles(recording: rr.RecordingStream, turbine: str) -> None:
    """Name one turbine's series on the tab of all turbines; static."""
    for name in STIFFNESSES:
        log_line_style(recording, median_path(name, turbine), f"{turbine} [-]", colours.POSTERIOR)


def log_posterior_widths(
    recording: rr.RecordingStream, root: str, posterior: FoundationPosterior
) -> None:
    """Draw each parameter's posterior width over its prior width, 90 % intervals [%]."""
    for parameter in posterior.parameters:
        if np.isfinite(parameter.contraction):
            left = 100.0 * (1.0 - parameter.contraction)
            recording.log(width_path(root, parameter.name), rr.Scalars(left))


# Rerun has a colour for each of its own levels, whose contrast in the light theme is 2.6 (WARN) and
# 4.5 (INFO); words of one's own have the colour of text.
LEVEL_WORDS = {"INFO": "info", "WARN": "warning", "ERROR": "error"}
FIRST_DRAW_ORDER = 20.0  # of a picture's lines that lie above each other; Rerun's default of lines


def log_pile(recording: rr.RecordingStream, root: str, picture: PilePicture) -> None:
    """Draw the loaded tower on its springs: nominal, posterior, truth."""
    path = f"{root}/foundation/pile"
    for order, (name, lines, colour, radius) in enumerate(
        (
            ("fixed", picture.fixed, colours.NEUTRAL, 0.7),
            ("springs", picture.springs, colours.POSTERIOR, 1.0),
            ("nominal", (picture.nominal,), colours.MODEL, 1.2),
            ("posterior", picture.posterior, colours.POSTERIOR, 1.0),
            ("truth", picture.truth, colours.TRUTH, 1.0),  # above the posterior that hides it
        )
    ):
        width = rr.Radius.ui_points(radius)
        drawn = rr.LineStrips2D(
            strips(lines), radii=width, colors=colour, draw_order=FIRST_DRAW_ORDER + order
        )
        recording.log(f"{path}/{name}", drawn)
    recording.log(f"{path}/text", text_labels(picture.texts))


def log_change_probability(
    recording: rr.RecordingStream, root: str, posterior: FoundationPosterior
) -> None:
    """Draw the probability that the modes have changed since the last event."""
    recording.log(f"{root}/change/probability", rr.Scalars(posterior.change_probability))


def log_change_styles(recording: rr.RecordingStream, root: str) -> None:
    """Names, units and colours of the size of changes; static."""
    path = f"{root}/change"
    for slot, name in enumerate(STIFFNESSES):
        names = (f"{name} 5 % [%]", f"{name} change [%]", f"{name} 95 % [%]")
        log_band_style(recording, f"{path}/size/{name}", names, colours.LEVELS[slot])


def log_change(recording: rr.RecordingStream, root: str, event: FoundationEvent) -> None:
    """Draw a change's probability and size at the end of the window that detected it."""
    recording.log(f"{root}/change/noticed", rr.Scalars(event.probability))
    for change in event.changes:
        _log_size(recording, root, change.name, (change.p05, change.median, change.p95))


def log_revised_sizes(
    recording: rr.RecordingStream, root: str, posterior: FoundationPosterior
) -> None:
    """Draw what all windows since the last change make of its size."""
    for ratio in posterior.relative:
        shares = (ratio.p05 - 1.0, ratio.median - 1.0, ratio.p95 - 1.0)
        _log_size(recording, root, ratio.name, shares)


def _log_size(
    recording: rr.RecordingStream, root: str, name: str, shares: tuple[float, float, float]
) -> None:
    """Draw 5 %, median and 95 % of a change, shares of what a stiffness was before it."""
    recording.log(f"{root}/change/size/{name}", rr.Scalars(100.0 * np.array(shares)))


def log_joint_posterior(
    recording: rr.RecordingStream,
    root: str,
    posterior: FoundationPosterior,
    truth: FoundationTruth | None,
) -> None:
    """Draw the corner plot of k11, k22, k12, with the truth where it is known."""
    nominal = np.array([posterior.parameter(name).nominal for name in STIFFNESSES])
    ratios = posterior.draws[:, : len(STIFFNESSES)] / nominal
    known = np.array([truth.k11, truth.k22, truth.k12]) / nominal if truth else None
    contraction = np.array([posterior.parameter(name).contraction for name in STIFFNESSES])
    plot = corner_plot(
        *(ratios, STIFFNESSES),
        truth=known,
        contraction=contraction,
        flat_prior=not posterior.population,
    )
    _log_corner(recording, f"{root}/foundation/joint", plot)


def _log_corner(recording: rr.RecordingStream, path: str, plot: CornerPlot) -> None:
    recording.log(
        f"{path}/draws",
        rr.Points2D(plot.draws, radii=rr.Radius.ui_points(1.3), colors=colours.POSTERIOR),
    )
    thin, thick = rr.Radius.ui_points(0.5), rr.Radius.ui_points(1.0)
    recording.log(
        f"{path}/frames", rr.LineStrips2D(strips(plot.frames), radii=thin, colors=colours.NEUTRAL)
    )
    recording.log(
        f"{path}/marginals",
        rr.LineStrips2D(strips(plot.histograms), radii=thick, colors=colours.POSTERIOR),
    )
    for name, lines, colour in (
        ("prior", plot.priors, colours.MODEL),
        ("truth", plot.truth, colours.TRUTH),
    ):
        drawn = rr.LineStrips2D(strips(lines) if lines else [], radii=thick, colors=colour)
        recording.log(f"{path}/{name}", drawn)
    recording.log(f"{path}/text", text_labels(plot.texts))


def log_status(recording: rr.RecordingStream, root: str, markdown: str) -> None:
    """Write the status text."""
    recording.log(f"{root}/status", rr.TextDocument(markdown, media_type="text/markdown"))


def log_health(recording: rr.RecordingStream, root: str, markdown: str) -> None:
    """Write the text about windows, gaps and nodes."""
    recording.log(f"{root}/health/text", rr.TextDocument(markdown, media_type="text/markdown"))


def log_node_styles(recording: rr.RecordingStream, root: str, name: str, slot: int) -> None:
    """Name and colour of one node's series; static."""
    colour = colours.LEVELS[slot % len(colours.LEVELS)]
    for quantity, unit in (("behind", "s"), ("lost", "-")):
        path = f"{root}/health/{quantity}/{entity_part(name)}"
        log_line_style(recording, path, f"{name} [{unit}]", colour, width=1.5)


def log_node(recording: rr.RecordingStream, root: str, node: NodeStatus, *, behind: float) -> None:
    """Draw a node's losses so far and its delay behind the newest block [s]."""
    part = entity_part(node.node)
    recording.log(f"{root}/health/behind/{part}", rr.Scalars(behind))
    recording.log(f"{root}/health/lost/{part}", rr.Scalars(node.lost + node.late))


def log_event(recording: rr.RecordingStream, root: str, text: str, *, level: str = "INFO") -> None:
    """Write one line of the event list; level is INFO, WARN or ERROR."""
    recording.log(f"{root}/events", rr.TextLog(text, level=LEVEL_WORDS[level]))
