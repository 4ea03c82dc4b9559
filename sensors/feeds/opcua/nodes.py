"""Which variable of a server is which channel.

A channel's variable is, in this order,

    the node id that is its name                        ns=2;s=Tower.ax
    the node id in the file of ?nodes=FILE.toml         [nodes]  ax = "ns=2;i=12"
    the pattern ?nodes=ns=2;s=Tower.{name}
    the one variable below Objects whose path ends so   Tower.ax, or ax where only one is called so

A namespace is given by its index (ns=2) or, as indices may differ after a server's restart, by its
name (nsu=http://maker.example/tower;s=ax).
"""

import difflib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sensors.feeds.protocol import FeedError
from sensors.settings import toml_table

MOST_NODES = 20_000  # that are looked through
NAMED_VARIABLES = 12  # in an error
_HIERARCHICAL, _PROPERTY = 33, 46  # node ids of reference types
_OBJECTS, _SERVER = "i=85", "i=2253"  # node ids
_VARIABLE = 2  # node class
_NODE_ID = re.compile(r"((ns=\d+|nsu=[^;]+);)?(i=\d+|[sgb]=.+)")


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable of a server."""

    path: str
    """Browse names from below Objects, joined by full stops."""
    node: Any
    """What reads it."""


@dataclass(frozen=True, slots=True)
class SeenVariable:
    """A variable of a server and what it holds."""

    path: str
    """Browse names from below Objects, joined by full stops."""
    node_id: str
    """As an address writes it."""
    content: Any
    """Its present value; None if it has none."""
    time_ns: int | None
    """When that was measured [ns since 1970-01-01 UTC]."""


def is_node_id(text: str) -> bool:
    """Whether a text is written as a node id is."""
    return _NODE_ID.fullmatch(text) is not None


def declared_nodes(option: str, names: Iterable[str]) -> dict[str, str]:
    """Node ids that are stated for channels, by name.

    Parameters
    ----------
    option : str
        A pattern with {name}, or a TOML file with the table [nodes]; "": nothing is stated.
    names : iterable of str
        Of the channels.

    Raises
    ------
    FeedError
        If it is neither, or states no node id.
    """
    stated = {name: name for name in names if is_node_id(name)}
    if not option:
        return stated
    if "{name}" in option:
        found = {name: option.replace("{name}", name) for name in names}
    else:
        found = _of_file(Path(option))
    for name, written in found.items():
        if not is_node_id(written):
            raise FeedError(
                f"nodes={option}: {name} = {written!r} is no node id; e.g. ns=2;s=Tower.{name}"
            )
    return found | stated


def _of_file(path: Path) -> dict[str, str]:
    try:
        text = path.read_text("utf-8")
    except OSError as error:
        raise FeedError(
            f"nodes={path}: {error.strerror}; a pattern such as ns=2;s=Tower.{{name}}, or a file "
            "with the table [nodes]"
        ) from error
    except UnicodeDecodeError as error:
        raise FeedError(f"{path}: not valid TOML: {error}") from error
    nodes = toml_table(text, str(path), FeedError).get("nodes")
    if not isinstance(nodes, dict) or not all(isinstance(each, str) for each in nodes.values()):
        raise FeedError(f'{path}: a table [nodes] is needed, with lines such as ax = "ns=2;i=12"')
    return dict(nodes)


async def found_nodes(client: Any, names: Iterable[str], declared: Mapping[str, str]) -> list[Any]:
    """The variables of the channels, in order.

    Parameters
    ----------
    client : asyncua.Client
        Connected.
    names : iterable of str
        Of the channels.
    declared : mapping of str to str
        Channel → id of its node, where the address states it.

    Raises
    ------
    FeedError
        If a channel has none or several.
    """
    wanted = tuple(names)
    searched = [name for name in wanted if name not in declared]
    variables = await variables_of(client) if searched else []
    return [
        await _declared(client, declared[name])
        if name in declared
        else chosen(name, variables).node
        for name in wanted
    ]


async def _declared(client: Any, written: str) -> Any:
    uri, _, rest = written.removeprefix("nsu=").partition(";")
    if not written.startswith("nsu="):
        return client.get_node(written)
    spaces = await client.get_namespace_array()
    if uri not in spaces:
        raise FeedError(f"{written}: the server has no such namespace; {', '.join(spaces)}")
    return client.get_node(f"ns={spaces.index(uri)};{rest}")


async def variables_of(client: Any) -> list[Variable]:
    """All variables below Objects but those of the server itself, breadth first."""
    found: list[Variable] = []
    seen: set[Any] = set()
    level = [("", client.get_node(_OBJECTS))]
    while level and len(seen) < MOST_NODES:
        below = []
        for path, node in level:
            for each in await node.get_children_descriptions(refs=_HIERARCHICAL):
                number = each.ReferenceTypeId.Identifier
                if each.NodeId in seen or number == _PROPERTY or each.NodeId.to_string() == _SERVER:
                    continue
                seen.add(each.NodeId)
                name = f"{path}.{each.BrowseName.Name}".lstrip(".")
                child = client.get_node(each.NodeId)
                below.append((name, child))
                if int(each.NodeClass) == _VARIABLE:
                    found.append(Variable(name, child))
        level = below
    return found


def chosen(name: str, variables: list[Variable]) -> Variable:
    """Return the variable that a channel's name means.

    Raises
    ------
    FeedError
        If none or several do.
    """
    fitting = [each for each in variables if f".{each.path}".endswith(f".{name}")]
    exact = [each for each in fitting if each.path == name]
    if len(exact or fitting) == 1:
        return (exact or fitting)[0]
    if fitting:
        raise FeedError(f"the server has several variables {name!r}: {_listed(fitting)}")
    near = difflib.get_close_matches(name, [each.path for each in variables], 3, 0.3)
    nearest_first = sorted(variables, key=lambda each: each.path not in near)
    known = _listed(nearest_first) or "none that can be seen"
    raise FeedError(
        f"the server has no variable {name!r}; it has {known}; a layout's `name` or ?nodes= "
        "names the right one"
    )


def _listed(variables: list[Variable]) -> str:
    shown = [f"{each.path} ({each.node.nodeid.to_string()})" for each in variables]
    more = len(shown) - NAMED_VARIABLES
    return ", ".join(shown[:NAMED_VARIABLES]) + (f" and {more} more" if more > 0 else "")
