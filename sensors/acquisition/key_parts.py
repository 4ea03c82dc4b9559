"""Which names can be part of the key that a message is published on."""

_DIVIDE_OR_SELECT = frozenset("/*$?#")
_VERBATIM = "@"  # begins a chunk that no wildcard matches (Zenoh's key expressions)


def key_part_error(part: str) -> str:
    """Return why a name cannot be part of a key; "" where it can."""
    if not part or _DIVIDE_OR_SELECT.intersection(part):
        return (
            "it cannot be part of a key, which needs at least one character and none of / * $ ? #"
        )
    if part.startswith(_VERBATIM):
        return (
            f"it cannot be part of a key that others find: a name does not begin with {_VERBATIM}"
        )
    return ""


def named_key_part_error(name: str) -> str:
    """The same of a name in a layout or a scenario, which has no space in it either."""
    if " " in name:
        return "a name without spaces is needed"
    return key_part_error(name)
