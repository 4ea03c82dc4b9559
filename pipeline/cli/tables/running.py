"""Tables of the status of a running session."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from rich.table import Table

from pipeline.cli.tables.cells import table_of
from pipeline.cli.tables.posteriors import posterior_table, posteriors_table


def status_tables(status: Mapping[str, Any]) -> list[Table]:
    """Return nodes and their warnings, streams, posteriors, gaps of a running session."""
    rare = ("recovered", "late", "duplicate", "malformed")  # shown where there are any
    shown = (name for name in rare if any(each[name] for each in status["nodes"]))
    counts = ("received", "lost", *shown)
    headings = ("silent [s]", "behind [blocks]", *counts)
    nodes = table_of(f"nodes of {status['source']}", "node", "condition", figures=headings)
    nodes.columns[0].no_wrap = True  # shares of a node differ in the last letters
    named = Counter(each["node"] for each in status["nodes"])
    for each in status["nodes"]:
        node = each["node"] if named[each["node"]] == 1 else f"{each['node']} of {each['turbine']}"
        behind = "" if each["behind_blocks"] is None else str(each["behind_blocks"])
        cells = (str(each[name]) for name in counts)
        nodes.add_row(node, each["condition"], f"{each['silence_s']:.1f}", behind, *cells)
    headings = ("silent [s]", "messages", "rate [1/s]")
    streams = table_of("streams", "key", "condition", figures=headings)
    streams.columns[0].overflow = "fold"
    for each in status["streams"]:
        rate = "" if each["rate_hz"] is None else f"{each['rate_hz']:.2f}"
        silence, messages = f"{each['silence_s']:.1f}", str(each["messages"])
        streams.add_row(each["key"], each["condition"], silence, messages, rate)
    known = status["posteriors"]
    posteriors = [posteriors_table(known)] if len(known) > 1 else [*map(posterior_table, known)]
    links = table_of("connections, by certificate or address", "who", figures=("links",))
    for who, count in status["connections"].items():
        links.add_row(who, str(count))
    connected = [links] if status["connections"] else []
    warnings = _alarm_tables(status["books"]["alarms"]) + _warning_tables(status["nodes"])
    return [nodes, *warnings, streams, *connected, *posteriors, *_gap_tables(status["gaps"])]


def _alarm_tables(alarms: Sequence[Mapping[str, str]]) -> list[Table]:
    """Return what a person must look into although nothing has failed."""
    if not alarms:
        return []
    table = table_of("alarms of the books", "turbine", "alarm")
    for alarm in alarms:
        table.add_row(alarm["turbine"], alarm["text"])
    return [table]


def _warning_tables(nodes: Sequence[Mapping[str, Any]]) -> list[Table]:
    """Return the warnings of nodes, verbatim."""
    rows = [(each["node"], text) for each in nodes for text in each["warnings"]]
    if not rows:
        return []
    table = table_of("warnings of nodes", "node", "warning")
    for row in rows:
        table.add_row(*row)
    return [table]


def _gap_tables(gaps: Sequence[Mapping[str, Any]]) -> list[Table]:
    if not gaps:
        return []
    table = table_of("latest gaps", "turbine", "unit", "missing [s]", "blocks")
    for gap in gaps:
        table.add_row(gap["turbine"], gap["unit"], f"{gap['duration_s']:.1f}", str(gap["blocks"]))
    return [table]
