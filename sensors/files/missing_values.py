"""How loggers, controllers and spreadsheets write that there is no value."""

from typing import Any

MISSING = frozenset(
    {
        *("", "-", "--", "---", "*", "nan", "-nan", "null", "none", "nil", "n/a", "na", "missing"),
        *("invalid", "no data", "1.#qnan", "1.#ind", "-1.#ind"),  # the last three of Windows
        *("#n/a", "#nv", "#na", "#num!", "#zahl!", "#div/0!", "#value!", "#wert!", "#null!"),
        *("#ref!", "#bezug!"),  # of spreadsheets, English and German
    }
)


def is_missing(content: Any) -> bool:
    """Return whether a cell or a JSON value holds none."""
    return content is None or (isinstance(content, str) and content.strip().lower() in MISSING)
