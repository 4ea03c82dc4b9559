"""The report of a session: one page with sentences, figures, pictures and settings.

Most important first: is the foundation known and has it changed (for the manager), then how well
and from what (for the engineer), last with which settings (to run it again).
"""

import html
import json
from collections.abc import Sequence
from pathlib import Path

from pipeline.report import figures
from pipeline.report.html import (
    REPORT_STYLE,
    TextTable,
    bullet_list,
    document,
    heading,
    paragraph,
    preformatted,
    svg_figure,
    table_html,
)
from pipeline.report.pictures import identification, operation
from pipeline.report.recorded_session import RecordedSession, TurbineRecord
from pipeline.report.sentences import (
    axis_words,
    condition,
    findings,
    headline,
    reasons_for_distrust,
    revised_sentence,
    sentence,
    structure_sentence,
)
from pipeline.report.tables import (
    channels_table,
    events_table,
    figures_table,
    gaps_table,
    modes_table,
    nodes_table,
    overview_table,
    refused_modes_table,
    rejected_table,
    springs_table,
    warnings_table,
)
from pipeline.report.wording import between_instants, percent, span
from pipeline.sources.session_files import not_included_line
from pipeline.state.phrases import FIGURES_NOTE, count_noun
from pipeline.state.posterior_json import plus_minus
from pipeline.updating.prior import PARAMETER_NAMES, PriorSettings
from sensors.errors import InputError

CONDITION_MARKS = {"good": "✓", "doubt": "!", "bad": "✕", "unknown": "?"}  # as the colour says

SETTING_NAMES = {  # as recordings store them
    "pilewatch.version": "version of pilewatch",
    "pilewatch.source": "source",
    "scenario.name": "name of the scenario",
    "scenario.structure": "structure",
    "scenario.seed": "seed of the simulation",
    "scenario.duration": "duration of the simulation [s]",
    "truth.k11": "true k11 [N/m]",
    "truth.k22": "true k22 [N·m/rad]",
    "truth.k12": "true k12 [N/rad]",
    "run.epoch": "starts of the session in this folder",
    "run.fresh": "started with --fresh",
}
TRUE_SPRINGS = ("truth.k11", "truth.k22", "truth.k12")

KeyFigure = tuple[str, str]  # name, figure


def write_page(session: RecordedSession, out: Path) -> None:
    """Write the report of a session as one HTML file.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    text = page(session)
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot write the report {out}: {error.strerror or error}") from error


def page(session: RecordedSession) -> str:
    """Return the whole report as HTML."""
    records = session.turbines
    several = len(records) > 1
    parts = [_provenance(session)]
    if several:
        links = [f"#{_anchor(number)}" for number in range(len(records))]
        parts += [heading("All turbines"), table_html(overview_table(records), links)]
    for number, record in enumerate(records):
        if several:
            parts.append(heading(record.turbine, anchor=_anchor(number)))
        parts.append(_turbine(record, session.prior, f"t{number}", level=3 if several else 2))
    parts.append(_settings(session))
    what = "Foundation" if any(record.has_structure for record in records) else "Modes"
    title = f"{what} of " + (f"{len(records)} turbines" if several else records[0].turbine)
    return document(title, "".join(parts), REPORT_STYLE)


def _anchor(number: int) -> str:
    return f"turbine-{number + 1}"


def _provenance(session: RecordedSession) -> str:
    spans = [record.span_ns for record in session.turbines]
    start_ns, end_ns = min(span_[0] for span_ in spans), max(span_[1] for span_ in spans)
    made = session.metadata.get("pilewatch", {})
    version = f" pilewatch {made['version']}." if "version" in made else ""
    files = f" in {count_noun(len(session.files), 'file')}" if len(session.files) > 1 else ""
    text = f"{session.name}{files}, {between_instants(start_ns, end_ns)}.{version}"
    parts = [paragraph(text, "quiet")]
    if session.unread:
        names = ", ".join(path.name for path in session.unread)
        parts.append(paragraph(f"Still being written, not in this report: {names}.", "quiet"))
    if session.others:
        parts.append(paragraph(f"In the folder, {not_included_line(session.others)}.", "quiet"))
    return "".join(parts)


def _turbine(record: TurbineRecord, prior: PriorSettings | None, name: str, *, level: int) -> str:
    return "".join(
        [
            _verdict(record),
            bullet_list(findings(record)),
            _cards(_key_figures(record)),
            _foundation(record, prior, name, level),
            _changes(record, level),
            _modes(record, name, level),
            _identification(record, name, level),
            _operation(record, name, level),
            _quality(record, name, level),
        ]
    )


def _verdict(record: TurbineRecord) -> str:
    kind = condition(record)
    reasons = reasons_for_distrust(record.state.posterior)
    return paragraph(
        f"{CONDITION_MARKS[kind]} {headline(record)}", f"verdict {kind}"
    ) + bullet_list(reasons)


def _key_figures(record: TurbineRecord) -> list[KeyFigure]:
    summary = record.state
    cards: list[KeyFigure] = []
    if (posterior := summary.posterior) is not None:
        cards = [
            (f"{name} ÷ nominal", plus_minus(posterior.parameter(name))) for name in PARAMETER_NAMES
        ]
        cards.append(("probability of a new change", percent(posterior.change_probability)))
    used = 0 if posterior is None else posterior.n_windows
    cards += [
        ("measured", span(summary.measured_time)),
        ("missing", span(summary.missing)),
        ("windows identified", str(len(summary.estimates))),
        ("modes", str(len(summary.modes))),
    ]
    if record.has_structure:
        cards.append(("windows in the last posterior", str(used)))
    return cards


def _cards(cards: Sequence[KeyFigure]) -> str:
    items = "".join(
        f"<div><dt>{html.escape(name)}</dt><dd>{html.escape(figure)}</dd></div>"
        for name, figure in cards
    )
    return f'<dl class="cards">{items}</dl>\n'


def _foundation(record: TurbineRecord, prior: PriorSettings | None, name: str, level: int) -> str:
    posterior = record.state.posterior
    if posterior is None:
        return ""
    pictures = (
        (
            figures.stiffness_over_time(record),
            "Stiffness over time",
            "Stiffness over its nominal value after every window: median and 90 % interval"
            + _prior_text(None if posterior.structure == "uncertain" else prior),
        ),
        (
            figures.joint_posterior(posterior, record),
            "Joint posterior of the springs",
            "The last posterior: pairs of springs, marginals on the diagonal"
            + (", truth as lines." if record.state.truth else "."),
        ),
        (
            identification.prediction(posterior),
            "Measured against predicted frequency of each mode",
            "Predictive check: how far each mode's frequency lies from what the posterior "
            "predicts; shaded: where 90 % of the modes lie if the model is right.",
        ),
    )
    rhat = f", R-hat {posterior.rhat:.3f}" if posterior.rhat == posterior.rhat else ""
    fit = (
        f"{count_noun(posterior.n_windows, 'window')}; "
        f"{percent(posterior.paired_share)} of the identified modes within the model's range are "
        "modes of the model; "
        f"reduced χ² of their frequencies "
        f"{posterior.reduced_chi_square:.2f}; {posterior.sampler}: {posterior.ess:.0f} effective "
        f"draws{rhat}. σ: relative discrepancy of the model."
    )
    return (
        heading("Foundation", level)
        + table_html(springs_table(record))
        + paragraph("narrowed by: of the prior's 90 % interval; 0: as wide, or wider.", "quiet")
        + paragraph(fit, "quiet")
        + paragraph(structure_sentence(posterior))
        + (table_html(figures_table(record)) if posterior.figures else "")
        + (paragraph(f"{FIGURES_NOTE}.", "quiet") if posterior.figures else "")
        + _pair(pictures, f"{name}-foundation")
    )


def _prior_text(prior: PriorSettings | None) -> str:
    if prior is None:  # or, where the structure is inferred with the springs, no box
        return "."
    return f"; prior {prior.lowest_ratio:g} to {prior.highest_ratio:g}."


def _pair(pictures: Sequence[tuple[str, str, str]], name: str) -> str:
    """Pictures side by side where there is room; empty ones are left out."""
    drawn = [
        svg_figure(svg, description, caption=caption, name=f"{name}-{number}")
        for number, (svg, description, caption) in enumerate(pictures)
        if svg
    ]
    return f'<div class="pair">{"".join(drawn)}</div>\n' if drawn else ""


def _changes(record: TurbineRecord, level: int) -> str:
    if not record.state.events:
        return ""
    events = record.state.events
    words = bullet_list(
        f"{sentence(event.text)}{revised_sentence(record.state, event)}" for event in events
    )
    return heading("Changes", level) + words + table_html(events_table(events))


def _modes(record: TurbineRecord, name: str, level: int) -> str:
    if not record.state.estimates:
        return ""
    pictures = (
        (
            figures.most_informative_frequencies(record),
            *_frequency_captions(record),
        ),
        (
            figures.all_frequencies(record),
            "All identified frequencies over time",
            "All identified modes of all windows.",
        ),
        (
            figures.mode_shapes(record),
            "Mode shapes",
            f"Identified mode shapes at the sensors, largest component 1{axis_words(record)}.",
        ),
    )
    legend = []
    if record.state.posterior is not None:
        legend = [
            "misfit: in standard deviations of the posterior's prediction",
            "information: share of the information on the stiffness",
            "– beside MAC: shape not used",
        ]
    if any(mode.pair_id for mode in record.state.modes):
        legend.append("≈: one of two modes that cannot be separated, only their mean is sure")
    return (
        heading("Modes", level)
        + _pair(pictures, f"{name}-modes")
        + table_html(modes_table(record))
        + (paragraph(f"{'; '.join(legend)}.", "quiet") if legend else "")
    )


def _identification(record: TurbineRecord, name: str, level: int) -> str:
    """Return what the modes were identified from; "" where nothing of it was recorded."""
    diagram = record.signals.stabilisation
    refused = () if diagram is None else diagram.refused
    pictures = (
        (
            identification.spectra(record),
            "Spectra of the channels with the modes marked",
            "Spectra of all channels, averaged over the recording; lines: identified modes.",
        ),
        (
            identification.stabilisation(record),
            "Stabilisation diagram of the last identified window",
            "Stabilisation diagram of the last identified window: stable poles over the model "
            "orders, in a colour for each frequency band; lines: modes, where a pole returns in "
            "most orders" + ("; crosses: refused, with the reason below." if refused else "."),
        ),
        (
            identification.auto_mac(record),
            "AutoMAC: how alike the identified shapes are",
            "AutoMAC: 1 beside the diagonal are shapes that these sensors cannot distinguish."
            + identification.mac_limit(record),
        ),
    )
    drawn = _pair(pictures, f"{name}-identification")
    reasons = table_html(refused_modes_table(refused)) if refused else ""
    return heading("Identification", level) + drawn + reasons if drawn else ""


def _operation(record: TurbineRecord, name: str, level: int) -> str:
    """Return samples and modes over time and operation; "" of a short recording."""
    charts = operation.control_charts(record)
    limits = f"; {operation.beyond_limits(record)}" if charts else ""
    pictures = (
        (
            operation.spectrogram(record),
            "Spectrogram of all channels",
            "Spectrogram: the densities of all channels of a unit together, over the recording.",
        ),
        (
            charts,
            "Control charts of stiffnesses and frequencies",
            "Control charts: departure from the median before the first change; dashed: three "
            f"robust standard deviations, diamonds beyond the edge{limits}.",
        ),
        (
            operation.frequencies_against(record, "water_level"),
            "Frequencies against the water level",
            "Frequencies against the water level.",
        ),
        (
            operation.frequencies_against(record, "wind_speed"),
            "Frequencies against the wind speed",
            "Frequencies against the wind speed.",
        ),
        (
            operation.campbell(record),
            "Frequencies against the rotor speed",
            "Campbell diagram: identified frequencies against the rotor speed; dashed: 1, 3 and 6 "
            "per revolution.",
        ),
    )
    drawn = _pair(pictures, f"{name}-operation")
    return heading("Over time and operation", level) + drawn if drawn else ""


def _frequency_captions(record: TurbineRecord) -> tuple[str, str]:
    """Return description and caption of the picture of the chosen frequencies."""
    if record.state.posterior is None:
        name = "Frequencies of the modes found most often"
        return name, f"{name}, with 90 % intervals."
    name = "Frequencies of the modes with most information on the stiffness"
    return name, f"{name}, 90 % intervals; dashed: model at the last posterior."


def _quality(record: TurbineRecord, name: str, level: int) -> str:
    picture = svg_figure(
        figures.windows_over_time(record),
        "Windows and gaps over time",
        caption="Identified windows, rejected windows, and gaps.",
        name=f"{name}-windows",
    )
    tables = (
        channels_table(record),
        rejected_table(record.state.rejected),
        gaps_table(record),
        warnings_table(record),
        nodes_table(record),
    )
    return (
        heading("Data quality", level)
        + f'<div class="pair">{picture}</div>\n'
        + _instruments(record)
        + "".join(table_html(each) for each in tables if each.rows)
    )


def _instruments(record: TurbineRecord) -> str:
    layout = record.layout
    if layout is None:
        return ""
    units = record.signals.samples.values()
    rates = sorted({f"{rate:g}" for unit in units for rate in unit.sampling_rates}, key=float)
    rate = f" at {' and '.join(rates)} Hz" if rates else ""
    names = ", ".join(layout.channel_names)
    return paragraph(f"{count_noun(len(layout.channels), 'channel')}{rate}: {names}.", "quiet")


def _settings(session: RecordedSession) -> str:
    """Return the settings stored in the recording, long texts verbatim."""
    short, long = [], []
    unused = _unused_settings(session)
    for section, texts in session.metadata.items():
        for key, text in texts.items():
            name = f"{section}.{key}"
            if name in unused:
                continue
            if name == "scenario.files":
                for file, content in json.loads(text).items():
                    long.append(heading(file, 3) + preformatted(content))
            elif "\n" in text:
                long.append(heading(SETTING_NAMES.get(name, name), 3) + preformatted(text))
            else:
                short.append((SETTING_NAMES.get(name, name), _in_digits(name, text)))
    if not short and not long:
        return ""
    table = TextTable("", ("setting", "value"), tuple(short), words=(1,))
    return heading("Settings") + (table_html(table) if short else "") + "".join(long)


def _in_digits(name: str, text: str) -> str:
    """Return a spring's truth in the digits of the tables; what else there is as it is stored."""
    return f"{float(text):.4g}" if name in TRUE_SPRINGS else text


def _unused_settings(session: RecordedSession) -> set[str]:
    """Return the stored settings that say nothing of this session."""
    unused = {"truth.time_ns"}  # the start, which the title has
    if not any(record.has_structure for record in session.turbines):
        unused.add("scenario.structure")
    if not any(record.state.truths for record in session.turbines):  # measured, not simulated
        unused |= {"scenario.seed", "scenario.duration"}
    return unused
