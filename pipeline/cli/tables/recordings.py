"""Tables of the content of a recording and of the shipped scenarios."""

import tomllib
from collections.abc import Sequence

from rich.table import Table

from pipeline.cli.tables.cells import table_of
from pipeline.recording.info import RecordingInfo, UnitInfo
from pipeline.scenario import NO_STRUCTURE, Scenario
from sensors.files.block_builder import FIRST_DAY_NS, moment
from sensors.json_values import Json, fields_of

SIMULATE = "simulate:"  # beginning of the source of what is simulated


def recording_tables(info: RecordingInfo) -> list[Table]:
    """Return channels, units with their gaps, and nodes of a recording."""
    title = f"{info.path} · {info.size / 1e6:.2f} MB · {info.duration:.1f} s"
    channels = table_of(title, "key", "message", figures=("count",))
    for channel in info.channels:
        channels.add_row(channel.key, channel.message, str(channel.count))
    headings = ("unit", "session", "rate [Hz]", "channels", "blocks", "duration [s]", "gaps")
    units = table_of("Acquisition units", figures=headings)
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
    counts = ("recovered", "lost", "late", "duplicate")
    nodes = table_of(
        "Last status of the nodes", figures=("node", "state", "last block", *counts, "busy [s]")
    )
    for status in info.health:
        nodes.add_row(
            status.node,
            status.state,
            str(status.last_sequence) if status.last_sequence >= 0 else "",
            *(str(getattr(status, name)) for name in counts),
            f"{status.busy_s:.2f}",
        )
    return [channels, units] + ([nodes] if info.health else [])


def span_line(info: RecordingInfo) -> str:
    """Return when the samples begin and end, in UTC; "" without samples.

    Parameters
    ----------
    info : RecordingInfo
        Of a recording.
    """
    if not info.units:
        return ""
    begin = min(unit.start_ns for unit in info.units)
    end = max(unit.end_ns for unit in info.units)
    zone = "UTC" if begin >= FIRST_DAY_NS else "of a clock without a date"
    return f"samples = {moment(begin)} to {moment(end)} {zone}"


def metadata_lines(info: RecordingInfo) -> list[str]:
    """Return what a recording states of itself, "section.key = text".

    Without what would mislead: the structure's settings of a scenario that has no structure, and
    the duration of the scenario's simulation where the samples are not simulated.
    """
    scenario = dict(info.metadata.get("scenario", {}))
    if _described(scenario.get("toml", "")) == NO_STRUCTURE:
        scenario["structure"] = NO_STRUCTURE
    if not info.metadata.get("pilewatch", {}).get("source", "").startswith(SIMULATE):
        scenario.pop("duration", None)
    return [
        f"{section}.{key} = {text}"
        for section, texts in info.metadata.items()
        for key, text in (scenario if section == "scenario" else texts).items()
        if "\n" not in text
    ]


def _described(scenario: str) -> str:
    """The description that the text of a scenario names; "" where it does not."""
    try:
        turbine = tomllib.loads(scenario).get("turbine", {})
    except tomllib.TOMLDecodeError:
        return ""
    return str(turbine.get("description", "")) if isinstance(turbine, dict) else ""


def info_json(info: RecordingInfo) -> Json:
    """Return the content of a recording for `info --json`; times [ns since 1970-01-01 UTC]."""
    return {
        "file": str(info.path),
        "size_bytes": info.size,
        "duration_s": info.duration,
        "metadata": info.metadata,
        "channels": [fields_of(each, "key", "message", "count") for each in info.channels],
        "units": [_unit_json(unit) for unit in info.units],
        "nodes": [fields_of(each, "node", "state", "lost", "late") for each in info.health],
    }


def _unit_json(unit: UnitInfo) -> Json:
    return {
        **fields_of(unit, "turbine", "unit", "session"),
        "sampling_rate_hz": unit.sampling_rate,
        "channels": unit.n_channels,
        "blocks": unit.n_blocks,
        **fields_of(unit, "start_ns", "end_ns"),
        "gaps": [
            fields_of(gap, "start_ns", "end_ns") | {"blocks": gap.n_blocks} for gap in unit.gaps
        ],
    }


def scenarios_table(scenarios: Sequence[Scenario]) -> Table:
    """Return the scenarios that come with pilewatch: name, duration, title."""
    table = table_of("Scenarios")
    table.add_column("name")
    table.add_column("duration", justify="right")
    table.add_column("title")
    for scenario in scenarios:
        duration = duration_in_words(scenario.simulation.duration)
        table.add_row(scenario.name, duration if scenario.has_structure else "–", scenario.title)
    table.caption = (
        "pilewatch simulate --describe NAME: details of one; –: without a structure, for run and "
        "import only"
    )
    return table


def duration_in_words(duration: float) -> str:
    """Return "3 h 20 min" for 12000 s.

    Parameters
    ----------
    duration : float
        Duration [s].
    """
    hours, minutes = divmod(round(duration / 60.0), 60)
    words = [f"{hours} h"] * (hours > 0) + [f"{minutes} min"] * (minutes > 0)
    return " ".join(words) or f"{duration:g} s"


def scenario_description(scenario: Scenario) -> str:
    """Return a scenario as text: its title, then one line per paragraph."""
    paragraphs = scenario.description.strip().split("\n\n")
    words = [" ".join(paragraph.split()) for paragraph in paragraphs]
    head = ": ".join(part for part in (scenario.name, scenario.title) if part)
    return "\n\n".join([head, *(each for each in words if each)])


def scenario_settings(scenario: Scenario) -> str:
    """Return the settings of a scenario's file, after its description."""
    return scenario.text.rpartition('"""')[2].strip()
