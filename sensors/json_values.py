"""Numbers as JSON can say them: it knows neither NaN nor infinity."""

import math
from typing import Any

Json = dict[str, Any]


def known(value: float | None) -> float | None:
    """JSON knows no NaN: what is not finite is unknown, null."""
    return float(value) if value is not None and math.isfinite(value) else None


def fields_of(record: object, *names: str) -> Json:
    """Return attributes by their names; a number that is not finite is null."""
    return {name: with_nulls(getattr(record, name)) for name in names}


def with_nulls(value: Any) -> Any:
    """The same, dicts and lists all through, with null for every number that is not finite: an
    untrusted sender may send any."""
    match value:
        case dict():
            return {name: with_nulls(each) for name, each in value.items()}
        case list():
            return [with_nulls(each) for each in value]
        case float():
            return known(value)
        case _:
            return value
