"""Tables of modes: identified, of the model, of a structure."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rich.table import Table

from pipeline.cli.tables.cells import table_of
from pipeline.state.phrases import count_noun

if TYPE_CHECKING:  # their modules load the model, which a table of measured modes does not need
    from pipeline.offline.describe_structure import StructureFigures
    from pipeline.offline.identify_file import RefusedCandidate
    from pipeline.offline.model_modes import ModelModes, NearestMode
    from pipeline.oma.cross_check import CrossCheck
    from pipeline.state.run_modes import CombinedMode


def identified_modes_table(
    modes: "Sequence[CombinedMode]",
    windows: int,
    cross_checks: "Mapping[str, CrossCheck] | None" = None,
) -> Table:
    """Return the identified modes, beside the paired modes of the model and a second estimate of
    each from its spectral peak."""
    paired = any(mode.pair is not None for mode in modes)
    headings = ["mode", "f [Hz]", "± std", "ζ [%]", "± std", "windows"]
    headings += ["model f [Hz]", "MAC"] if paired else []
    headings += ["EFDD f [Hz]", "ζ [%]"] if cross_checks is not None else []
    table = table_of(f"Identified modes ({count_noun(windows, 'window')})", figures=headings)
    for mode in modes:
        row = [
            mode.name + (" ≈" if mode.pair_id else ""),
            f"{mode.frequency:.4f}",
            f"{mode.frequency_std:.4f}",
            f"{100 * mode.damping_ratio:.2f}",
            f"{100 * mode.damping_ratio_std:.2f}",
            str(mode.seen_in_windows),
        ]
        if paired:
            pair = mode.pair
            row += ["", ""] if pair is None else [f"{pair.model_frequency:.4f}", f"{pair.mac:.3f}"]
        if cross_checks is not None:
            check = cross_checks.get(mode.name)
            row += (
                ["–", "–"]
                if check is None
                else [f"{check.frequency:.4f}", f"{100 * check.damping_ratio:.2f}"]
            )
        table.add_row(*row)
    if any(mode.pair_id for mode in modes):
        table.caption = "≈ one of two modes that cannot be separated: only their mean is sure"
    return table


def refused_table(candidates: "Sequence[RefusedCandidate]") -> Table:
    """Return what looked like a mode and is not reported, with the reasons."""
    headings = ("window", "f [Hz]", "ζ [%]")
    table = table_of("Candidates that are no modes", figures=headings, no_wrap=True)
    table.add_column("code", no_wrap=True)
    table.add_column("reason")
    for each in candidates:
        refused = each.refused
        table.add_row(
            str(each.window + 1),
            f"{refused.frequency:.4f}",
            f"{100 * refused.damping_ratio:.2f}",
            refused.code,
            refused.text,
        )
    table.caption = "window: counted from the start of the record, the first is 1"
    return table


def nearest_modes_table(nearest: "Sequence[NearestMode]") -> Table:
    """Return identified modes beside the model's nearest ones at the nominal foundation."""
    table = table_of(
        "Misfit mode by mode: the model's nearest mode at the nominal foundation",
        figures=("mode", "f [Hz]", "model's", "f [Hz]", "difference [%]", "MAC"),
        no_wrap=True,
    )
    for each in nearest:
        apart = 100 * (each.identified.frequency / each.frequency - 1)
        table.add_row(
            each.identified.name,
            f"{each.identified.frequency:.4f}",
            each.label,
            f"{each.frequency:.4f}",
            f"{apart:+.2f}",
            f"{each.mac:.3f}",
        )
    return table


def model_modes_table(found: "ModelModes") -> Table:
    """Return the model's modes, beside the published frequencies of a description that has some."""
    description = found.model.description
    ratios = ", ".join(f"{ratio:g}" for ratio in found.ratios)
    modes = found.as_json()
    compared = any(mode["table1_hz"] is not None for mode in modes)
    published = ("published [Hz]", "difference") if compared else ()
    table = table_of(
        f"{description.title or description.name}: modes at k11, k22, k12 = {ratios} × nominal "
        f"(sign of k12: {description.foundation.sign})",
        figures=("mode", "direction", "f [Hz]", *published, "blade energy"),
    )
    for mode in modes:
        table.add_row(
            mode["name"],
            mode["direction"],
            f"{mode['frequency_hz']:.4f}",
            *(_beside(mode["frequency_hz"], mode["table1_hz"]) if compared else ()),
            f"{100 * mode['blade_energy_share']:.0f} %",
        )
    return table


def _beside(frequency: float, published: float | None) -> tuple[str, str]:
    """A published frequency [Hz] and how far the model's is from it; empty where there is none."""
    if published is None:
        return "", ""
    return f"{published:.4f}", f"{100 * (frequency / published - 1):+.2f} %"


def structure_tables(figures: "StructureFigures") -> list[Table]:
    """Return key figures of a description, and its first modes."""
    title = figures.description.title or figures.description.name
    described = table_of(title, "what", figures=("figure",))
    for row in figures.rows():
        described.add_row(*row)
    headings = ("f [Hz]", "direction", "blade energy")
    modes = table_of("First modes, at these springs", figures=headings)
    for frequency, direction, blades in figures.first:
        modes.add_row(f"{frequency:.4f}", direction, f"{100 * blades:.0f} %")
    return [described, modes]
