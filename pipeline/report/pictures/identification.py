"""Pictures of how modes were identified: stabilisation diagram, spectra, AutoMAC, prediction.

Every function returns an SVG text, or "" where there is nothing to draw.
"""

from typing import Any

import numpy as np

from pipeline.messages import FoundationPosterior, ModePair
from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.report.canvas import INK, PAPER, css_colour, page_figure
from pipeline.report.pictures.axes import frequency_axis, mark_modes
from pipeline.report.recorded_session import TurbineRecord
from pipeline.state.phrases import in_hertz
from pipeline.state.run_modes import CombinedMode
from pipeline.viewer.pictures import colours
from sensors.arrays import FloatArray

FEW_IN_MAC = 14  # labels of the usual size do not overlap
MOST_IN_MAC = 24  # of the AutoMAC, so that its labels can be read
LASTING_SHARE = 0.25  # of the windows that see a mode that is marked [-]
LOWEST_SHARE = 0.6  # of the lowest mode's frequency: where the axis of frequencies begins [-]
SHORT_NAME, LONG_NAME = 14, 26  # of a channel in a legend [characters]
DECADES_SHOWN = 6.0  # of spectral density below the highest
WITHIN = 1.6449  # misfit within which 90 % of true modes lie [standard deviations]


def stabilisation(record: TurbineRecord) -> str:
    """Draw the poles of the last identified window over the model orders, and its modes."""
    diagram = record.signals.stabilisation
    if diagram is None or not len(diagram.frequencies):
        return ""
    modes = _frequencies_of_window(record, diagram.start_ns)
    with page_figure(3.6) as page:
        axes = page.figure.subplots()
        bands = diagram.bands.astype(int)
        for band in np.unique(bands):
            inside = bands == band
            axes.plot(
                diagram.frequencies[inside], diagram.orders[inside], ".", markersize=4,
                color=css_colour(colours.LEVELS[band % len(colours.LEVELS)]),
                markeredgewidth=0, label=f"band {band + 1}", rasterized=len(bands) > 1500,
            )  # fmt: skip
        mark_modes(axes, modes, written=True)
        _cross_refused(axes, [each.frequency for each in diagram.refused])
        frequency_axis(axes)
        _begin_at_lowest(axes, modes)
        axes.set_ylabel("model order [-]")
        axes.legend(loc="upper left", bbox_to_anchor=(0, -0.2), ncols=3, markerscale=2)
        return page.svg()


def _frequencies_of_window(record: TurbineRecord, start_ns: int) -> list[float]:
    for estimate in record.state.estimates:
        if estimate.start_ns == start_ns:
            return [mode.frequency for mode in estimate.modes]
    return []


def _cross_refused(axes: Any, frequencies: list[float]) -> None:
    """Mark at the upper edge what looked like a mode and is not reported."""
    if frequencies:
        axes.plot(
            frequencies, np.full(len(frequencies), 0.98), "x", markersize=4.5, label="refused",
            color=css_colour(colours.FAULT), transform=axes.get_xaxis_transform(),
        )  # fmt: skip


def _begin_at_lowest(axes: Any, modes: list[float]) -> None:
    if modes:
        axes.set_xlim(left=LOWEST_SHARE * min(modes))


def spectra(record: TurbineRecord) -> str:
    """Draw the spectra of all channels, averaged over the recording, with the modes marked."""
    lines = _lines_by_direction(record)
    if not lines:
        return ""
    modes = [mode.frequency for mode in lasting_modes(record)]
    with page_figure(0.7 + 1.7 * len(lines)) as page:
        panels = page.figure.subplots(len(lines), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (name, curves) in zip(panels, lines.items(), strict=True):
            for number, (label, f, density) in enumerate(curves):
                colour = css_colour(colours.LEVELS[number % len(colours.LEVELS)])
                axes.plot(f[1:], density[1:], linewidth=0.7, color=colour, label=label)
            axes.set_yscale("log")
            top = max(float(density[1:].max()) for _, _, density in curves)
            axes.set_ylim(top * 10**-DECADES_SHOWN, 3 * top)
            axes.set_ylabel(f"{name}\n[{_unit(record)}]")
            mark_modes(axes, modes, written=axes is panels[0])
            _name_curves(axes)
        frequency_axis(panels[-1])
        _begin_at_lowest(panels[-1], modes)
        return page.svg()


def _name_curves(axes: Any) -> None:
    """The legend of an axes' channels, within the axes however long their names are."""
    handles, labels = axes.get_legend_handles_labels()
    short = [shortened(label) for label in labels]
    n_columns = 2 if max(map(len, short)) <= SHORT_NAME else 1
    legend = axes.legend(
        handles, short, loc="lower left", ncols=n_columns, frameon=True, framealpha=0.8,
        edgecolor="none", facecolor=PAPER, borderpad=0.2, labelspacing=0.2,
    )  # fmt: skip
    legend.set_in_layout(False)


def shortened(name: str) -> str:
    """Return a channel's name with its middle left out where it is long."""
    half = LONG_NAME // 2
    return name if len(name) <= LONG_NAME else f"{name[:half]}…{name[-half:]}"


def lasting_modes(record: TurbineRecord) -> list[CombinedMode]:
    """Modes seen in a quarter of the windows or more; others would hide them."""
    fewest = LASTING_SHARE * len(record.state.estimates)
    return [mode for mode in record.state.modes if mode.seen_in_windows >= fewest]


Curve = tuple[str, FloatArray, FloatArray]  # channel, frequencies [Hz], density


def _lines_by_direction(record: TurbineRecord) -> dict[str, list[Curve]]:
    """Fore-aft, side-side and other channels, each with its spectrum at each rate."""
    lines: dict[str, list[Curve]] = {}
    for unit, layout in sorted(record.state.layouts.items()):
        found = record.signals.samples[unit].spectra() if unit in record.signals.samples else ()
        for each in found:
            if each.densities.shape[1] != len(layout.channels):
                continue
            rate = f", {each.sampling_rate:g} Hz" if len(found) > 1 else ""
            for channel, density in zip(layout.channels, each.densities.T, strict=True):
                name = _direction_name(channel.direction, of_tower=record.has_structure)
                if density[1:].max(initial=0.0) > 0:
                    curve = (f"{channel.name}{rate}", each.frequencies, density)
                    lines.setdefault(name, []).append(curve)
    return lines


def _direction_name(direction: tuple[float, float, float], *, of_tower: bool) -> str:
    names = ("fore-aft", "side-side", "vertical") if of_tower else ("along x", "along y", "along z")
    largest = int(np.argmax(np.abs(direction)))
    return names[largest] if abs(direction[largest]) > 0.7 else "oblique"


def _unit(record: TurbineRecord) -> str:
    units = {
        channel.unit for layout in record.state.layouts.values() for channel in layout.channels
    }
    unit = units.pop() if len(units) == 1 else ""
    return f"({unit})²/Hz" if unit else "1/Hz, unscaled"


def auto_mac(record: TurbineRecord) -> str:
    """Draw the MAC of every identified mode's shape with every other's."""
    modes = _with_shapes(record)[:MOST_IN_MAC]
    if len(modes) < 2 or len({len(mode.shape) for mode in modes}) > 1:
        return ""
    shapes = np.array([mode.shape for mode in modes])
    values = modal_assurance_criterion(shapes, shapes)
    labels = [in_hertz(mode.frequency) for mode in modes]
    with page_figure(4.0) as page:
        axes = page.figure.subplots()
        image = axes.imshow(values, vmin=0.0, vmax=1.0, cmap="cividis")
        size = 8.0 if len(modes) <= FEW_IN_MAC else 5.5
        axes.set_xticks(range(len(modes)), labels, rotation=90, fontsize=size)
        axes.set_yticks(range(len(modes)), labels, fontsize=size)
        axes.grid(False)
        axes.set_xlabel("mode [Hz]")
        axes.set_ylabel("mode [Hz]")
        bar = page.figure.colorbar(image, shrink=0.8)
        bar.set_label("MAC [-]")
        return page.svg()


def mac_limit(record: TurbineRecord) -> str:
    """Return a sentence where not all modes are in the AutoMAC."""
    more = len(_with_shapes(record)) > MOST_IN_MAC
    return f" Drawn: the {MOST_IN_MAC} lowest modes that last." if more else ""


def _with_shapes(record: TurbineRecord) -> list[CombinedMode]:
    return [mode for mode in lasting_modes(record) if len(mode.shape) > 1]


def prediction(posterior: FoundationPosterior | None) -> str:
    """Draw how far each paired mode lies from what the posterior predicts of its frequency."""
    pairs = [] if posterior is None else [p for p in posterior.pairs if np.isfinite(p.misfit)]
    if not pairs:
        return ""
    pairs.sort(key=lambda pair: pair.frequency)
    with page_figure(0.8 + 0.16 * len(pairs)) as page:
        axes = page.figure.subplots()
        places = np.arange(len(pairs))
        misfits = np.array([pair.misfit for pair in pairs])
        outside = np.abs(misfits) > WITHIN
        axes.axvspan(-WITHIN, WITHIN, color=css_colour(colours.POSTERIOR), alpha=0.15, linewidth=0)
        axes.axvline(0.0, color=INK, linewidth=0.6)
        for chosen, colour in ((~outside, colours.MEASURED), (outside, colours.FAULT)):
            axes.plot(
                misfits[chosen], places[chosen], "o", markersize=3.5, color=css_colour(colour)
            )
        axes.set_yticks(places, [_pair_label(pair) for pair in pairs], fontsize=7)
        axes.invert_yaxis()
        largest = max(3.0, 1.1 * float(np.abs(misfits).max()))
        axes.set_xlim(-largest, largest)
        axes.set_xlabel("measured − predicted [std]")
        return page.svg()


def _pair_label(pair: ModePair) -> str:
    return f"mode {pair.model}, {in_hertz(pair.frequency)} Hz"
