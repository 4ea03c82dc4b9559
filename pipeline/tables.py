"""What the commands print for people: rich tables of modes and posteriors."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.markup import escape
from rich.table import Table
from rich.text import Text

from pipeline.combined_modes import CombinedMode
from pipeline.fleet.farm.farm import Farm
from pipeline.json_values import Json
from pipeline.messages import FoundationPosterior, ParameterSummary
from pipeline.model_modes import ModelModes, NearestMode
from pipeline.recording.info import RecordingInfo
from pipeline.scenario import Scenario
from pipeline.structure_figures import StructureFigures


def identified_modes_table(modes: Sequence[CombinedMode], windows: int) -> Table:
    """The identified modes, with the model's beside them where they were paired."""
    paired = any(mode.pair is not None for mode in modes)
    table = _table(f"Identified modes ({_counted(windows, 'window')})")
    for title in ("mode", "f [Hz]", "± std", "ζ [%]", "± std", "windows"):
        table.add_column(title, justify="right")
    if paired:
        for title in ("model f [Hz]", "MAC"):
            table.add_column(title, justify="right")
    for mode in modes:
        row = [
            mode.name + (" ≈" if mode.pair_id else ""),
            f"{mode.frequency:.4f}",
            f"{mode.frequency_std:.4f}",
            f"{100 * mode.damping_ratio:.2f}",
            f"{100 * mode.damping_ratio_std:.2f}",
            str(mode.seen_in_windows),
        ]
        if paired and mode.pair is not None:
            row += [f"{mode.pair.model_frequency:.4f}", f"{mode.pair.mac:.3f}"]
        table.add_row(*row)
    if any(mode.pair_id for mode in modes):
        table.caption = "≈ two modes that cannot be separated: what is known is their mean"
    return table


def posterior_table(posterior: Json) -> Table:
    """Median and 90 % interval of each spring, absolute and over nominal; whose, where it says."""
    whose = f" of {posterior['turbine']}" if "turbine" in posterior else ""
    doubt = "" if posterior.get("trusted", True) else ", NOT TRUSTED"
    table = _table(f"Foundation posterior{escape(whose)}{doubt}")
    for title in ("", "÷ nominal", "90 % interval", "truth", "median", "unit"):
        table.add_column(title, justify="right", no_wrap=True)
    for name in ("k11", "k22", "k12"):
        spring = posterior[name]
        table.add_row(
            name,
            _told(spring["ratio_median"], ".4f"),
            f"{_told(spring['ratio_p05'], '.4f')} to {_told(spring['ratio_p95'], '.4f')}",
            _told(spring["truth_ratio"], ".4f"),
            _told(spring["median"], ".4g"),
            spring["unit"],
        )
    sigma = posterior["sigma"]
    above = f"below {_told(sigma['p95'], '.1e')} (95 %)"
    table.add_row("σ", "", above, "", _told(sigma["median"], ".1e"), "-")
    for name, each in posterior["figures"].items():
        interval = f"{_told(each['p05'], '.4g')} to {_told(each['p95'], '.4g')}"
        median = _told(each["median"], ".4g")
        table.add_row(
            escape(name.replace("_", " ")), "", interval, "", median, escape(each["unit"])
        )
    table.caption = (
        f"{_counted(posterior['windows'], 'window')}, {posterior['sampler']}: "
        f"{_told(posterior['ess'], '.0f')} effective draws, R-hat {_told(posterior['rhat'], '.3f')}"
        "; σ: relative discrepancy of the model; probability of a new change: "
        f"{_told(posterior['change_probability'], '.2f')}"
    )
    return table


def posteriors_table(posteriors: Sequence[Json]) -> Table:
    """The springs of many turbines, one a row: median and half the 90 % interval over nominal."""
    table = _table("Foundation posteriors, ÷ nominal")
    for title in ("turbine", "windows", "k11", "k22", "k12", "change", ""):
        table.add_column(title, justify="right", no_wrap=True)
    for each in posteriors:
        springs = [_plus_minus(each[name]) for name in ("k11", "k22", "k12")]
        table.add_row(
            escape(each["turbine"]), str(each["windows"]), *springs,
            _told(each["change_probability"], ".2f"), "" if each["trusted"] else "NOT TRUSTED",
            style=None if each["trusted"] else "bold red",
        )  # fmt: skip
    table.caption = "± half a 90 % interval, %; change: probability of a new one"
    return table


def _plus_minus(spring: Json) -> str:
    low, high = spring["ratio_p05"], spring["ratio_p95"]
    half = None if low is None or high is None else 50 * (high - low)
    return f"{_told(spring['ratio_median'], '.3f')} ± {_told(half, '.1f')}"


def _told(figure: float | None, form: str) -> str:
    return "unknown" if figure is None else format(figure, form)


def farm_table(farm: Farm) -> Table:
    """Every turbine's springs with the farm's help, and how unlike the others it is."""
    table = _table(f"Springs ÷ nominal, {_counted(len(farm.turbines), 'turbine')} pooled")
    for title in ("turbine", "windows", "k11", "k22", "k12", "outlier"):
        table.add_column(title, justify="right", no_wrap=True)
    for each in farm.turbines:
        springs = [f"{k.median / k.nominal:.3f} ± {100 * _half_width(k):.1f}" for k in each.pooled]
        style = "bold red" if each.outlying else None
        probability = f"{each.outlier_probability:.3f}"
        table.add_row(each.turbine, str(each.n_windows), *springs, probability, style=style)
    spreads = ", ".join(
        f"{name} {100 * each.median:.1f} % [{100 * each.p05:.1f}, {100 * each.p95:.1f}]"
        for name, each in zip(("k11", "k22", "k12"), farm.spread, strict=True)
    )
    table.caption = (
        f"± half a 90 % interval, %; turbines differ by {spreads} (standard deviation); outlier: "
        f"probability; R-hat {farm.rhat:.3f}"
    )
    return table


def _half_width(spring: ParameterSummary) -> float:
    """Of the 90 % interval, over nominal."""
    return abs((spring.p95 - spring.p05) / 2 / spring.nominal)


def misfit_table(posterior: FoundationPosterior) -> Table:
    """How well each paired mode fits the posterior, and how much it tells of the stiffness."""
    table = _table("Misfit mode by mode")
    for title in ("mode", "f [Hz]", "model f [Hz]", "apart [%]", "misfit", "MAC", "tells"):
        table.add_column(title, justify="right", no_wrap=True)
    for pair in sorted(posterior.pairs, key=lambda pair: pair.frequency):
        apart = 100 * (pair.frequency / pair.model_frequency - 1)
        table.add_row(
            pair.model,
            f"{pair.frequency:.4f}",
            f"{pair.model_frequency:.4f}",
            f"{apart:+.2f}",
            f"{pair.misfit:+.1f}",
            f"{pair.mac:.3f}" + ("" if pair.shape_used else " –"),
            f"{100 * pair.information:.0f} %",
        )
    table.caption = (
        f"misfit: in standard deviations of the posterior's prediction; –: shape not used; tells: "
        f"share of the information on the stiffness; {posterior.paired_share:.0%} of the "
        f"identified modes paired, reduced χ² {posterior.reduced_chi_square:.2f}"
    )
    return table


def nearest_modes_table(nearest: Sequence[NearestMode]) -> Table:
    """Identified modes beside the model's nearest ones at the nominal foundation."""
    table = _table("Misfit mode by mode: the model's nearest mode at the nominal foundation")
    for title in ("mode", "f [Hz]", "model's", "f [Hz]", "apart [%]", "MAC"):
        table.add_column(title, justify="right", no_wrap=True)
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


def model_modes_table(found: ModelModes) -> Table:
    """The model's modes beside the frequencies that the publication lists."""
    description = found.model.description
    ratios = ", ".join(f"{ratio:g}" for ratio in found.ratios)
    table = _table(
        f"{description.title or description.name}: modes at k11, k22, k12 = {ratios} × nominal "
        f"(sign of k12: {description.foundation.sign})"
    )
    for heading in ("mode", "direction", "f [Hz]", "published [Hz]", "difference", "blade energy"):
        table.add_column(heading, justify="right")
    for mode in found.as_json():
        frequency, published = mode["frequency_hz"], mode["table1_hz"]
        table.add_row(
            mode["name"],
            mode["direction"],
            f"{frequency:.4f}",
            "" if published is None else f"{published:.4f}",
            "" if published is None else f"{100 * (frequency / published - 1):+.2f} %",
            f"{100 * mode['blade_energy_share']:.0f} %",
        )
    return table


def structure_tables(figures: StructureFigures) -> list[Table]:
    """Key figures of a description, and its first modes."""
    described = _table(figures.description.title or figures.description.name)
    described.add_column("what")
    described.add_column("figure", justify="right")
    for row in figures.rows():
        described.add_row(*row)
    modes = _table("First modes, at these springs")
    for heading in ("f [Hz]", "direction", "blade energy"):
        modes.add_column(heading, justify="right")
    for frequency, direction, blades in figures.first:
        modes.add_row(f"{frequency:.4f}", direction, f"{100 * blades:.0f} %")
    return [described, modes]


def recording_tables(info: RecordingInfo) -> list[Table]:
    """Channels, units with their gaps, and nodes of a recording."""
    channels = _table(f"{info.path} · {info.size / 1e6:.2f} MB · {info.duration:.1f} s")
    for title in ("key", "message", "count"):
        channels.add_column(title, justify="right" if title == "count" else "left")
    for channel in info.channels:
        channels.add_row(channel.key, channel.message, str(channel.count))
    units = _table("Acquisition units")
    for title in ("unit", "session", "rate [Hz]", "channels", "blocks", "duration [s]", "gaps"):
        units.add_column(escape(title), justify="right")
    for unit in info.units:
        missing = sum((gap.end_ns - gap.start_ns) * 1e-9 for gap in unit.gaps)
        units.add_row(
            f"{unit.turbine}/{unit.unit}",
            unit.session,
            f"{unit.sampling_rate:g}",
            str(unit.n_channels),
            str(unit.n_blocks),
            f"{unit.duration:.1f}",
            f"{len(unit.gaps)} ({missing:.1f} s)" if unit.gaps else "none",
        )
    nodes = _table("Nodes, as they last said")
    accounts = ("recovered", "lost", "late", "duplicate")
    for title in ("node", "state", "last block", *accounts, "busy [s]"):
        nodes.add_column(escape(title), justify="right")
    for status in info.health:
        nodes.add_row(
            status.node,
            status.state,
            str(status.last_sequence) if status.last_sequence >= 0 else "",
            *(str(getattr(status, name)) for name in accounts),
            f"{status.busy_s:.2f}",
        )
    return [channels, units] + ([nodes] if info.health else [])


def status_tables(status: Mapping[str, Any]) -> list[Table]:
    """What a running session answered: nodes and what they say, streams, posteriors, gaps."""
    nodes = _table(f"nodes of {status['source']}")
    rare = ("recovered", "late", "duplicate", "malformed")  # shown where there are any
    counted = ("received", "lost", *(n for n in rare if any(each[n] for each in status["nodes"])))
    nodes.add_column("node", no_wrap=True)  # shares of a node differ in the last letters
    nodes.add_column("condition")
    for title in ("silent [s]", "behind [blocks]", *counted):
        nodes.add_column(escape(title), justify="right")
    for each in status["nodes"]:
        behind = "" if each["behind_blocks"] is None else str(each["behind_blocks"])
        counts = (str(each[name]) for name in counted)
        nodes.add_row(each["node"], each["condition"], f"{each['silence_s']:.1f}", behind, *counts)
    streams = _table("streams")
    streams.add_column("key", overflow="fold")
    streams.add_column("condition")
    for title in ("silent [s]", "messages", "rate [1/s]"):
        streams.add_column(escape(title), justify="right")
    for each in status["streams"]:
        rate = "" if each["rate_hz"] is None else f"{each['rate_hz']:.2f}"
        silence, messages = f"{each['silence_s']:.1f}", str(each["messages"])
        streams.add_row(each["key"], each["condition"], silence, messages, rate)
    known = status["posteriors"]
    posteriors = [posteriors_table(known)] if len(known) > 1 else [*map(posterior_table, known)]
    links = _table("connections, by certificate or address")
    links.add_column("who")
    links.add_column("links", justify="right")
    for who, count in status["connections"].items():
        links.add_row(who, str(count))
    connected = [links] if status["connections"] else []
    said = _said_tables(status["nodes"])
    return [nodes, *said, streams, *connected, *posteriors, *_gap_tables(status["gaps"])]


def _said_tables(nodes: Sequence[Mapping[str, Any]]) -> list[Table]:
    """What nodes doubt, word by word: some words are strangers', and no markup."""
    said = [(each["node"], Text(text)) for each in nodes for text in each["warnings"]]
    if not said:
        return []
    table = _table("what nodes say")
    for title in ("node", "doubt"):
        table.add_column(title)
    for row in said:
        table.add_row(*row)
    return [table]


def _gap_tables(gaps: Sequence[Mapping[str, Any]]) -> list[Table]:
    if not gaps:
        return []
    table = _table("latest gaps")
    for title in ("turbine", "unit", "missing [s]", "blocks"):
        table.add_column(escape(title))
    for gap in gaps:
        table.add_row(gap["turbine"], gap["unit"], f"{gap['duration_s']:.1f}", str(gap["blocks"]))
    return [table]


def _table(title: str) -> Table:
    return Table(title=title, title_justify="left", caption_justify="left", header_style="bold")


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}" + ("" if count == 1 else "s")


def scenarios_table(scenarios: Sequence[Scenario]) -> Table:
    """The scenarios that come with pilewatch: name, duration, title."""
    table = _table("Scenarios")
    table.add_column("name")
    table.add_column("duration", justify="right")
    table.add_column("what it is")
    for scenario in scenarios:
        table.add_row(
            scenario.name, duration_in_words(scenario.simulation.duration), scenario.title
        )
    table.caption = "pilewatch simulate --describe NAME says more of one"
    return table


def duration_in_words(duration: float) -> str:
    """3 h 20 min of 12000 s. duration: [s]"""
    hours, minutes = divmod(round(duration / 60.0), 60)
    words = [f"{hours} h"] * (hours > 0) + [f"{minutes} min"] * (minutes > 0)
    return " ".join(words) or f"{duration:g} s"


def scenario_description(scenario: Scenario) -> str:
    """A scenario in words: its title, then what it simulates and needs, a line a paragraph."""
    paragraphs = scenario.description.strip().split("\n\n")
    words = [" ".join(paragraph.split()) for paragraph in paragraphs]
    return "\n\n".join([f"{scenario.name}: {scenario.title}", *words])


def scenario_settings(scenario: Scenario) -> str:
    """What a scenario's file sets, after its description."""
    return scenario.text.rpartition('"""')[2].strip()
