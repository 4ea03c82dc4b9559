"""Times as instruments write them → nanoseconds."""

import math
from datetime import UTC, datetime

from sensors.acquisition.blocks import NANOSECONDS

# Numbers since 1970: seconds, ms, µs, ns; today each is at least 10⁹ of its unit.
_STEPS = ((1e11, NANOSECONDS), (1e14, 1_000_000), (1e17, 1000), (1e20, 1))
LATEST_NS = 4 * 10**18  # the year 2096: times and their differences fit into 64 bits


def moment_ns(written: object) -> int:
    """A time [ns since 1970-01-01 UTC].

    Parameters
    ----------
    written : object
        A number since 1970 [s, ms, µs or ns, by its size], or a text in ISO 8601 (UTC where
        it names no zone), or such a number as text.

    Raises
    ------
    ValueError
        For anything else, in one sentence.
    """
    if isinstance(written, str):
        return _of_text(written.strip())
    if isinstance(written, bool) or not isinstance(written, int | float):
        raise ValueError(f"{written!r:.60} is no time")
    if isinstance(written, float) and not math.isfinite(written):
        raise ValueError(f"{written} is no time")
    for limit, factor in _STEPS:
        if 0 <= written < limit:
            time_ns = written * factor if isinstance(written, int) else round(written * factor)
            if time_ns < LATEST_NS:
                return int(time_ns)
    raise ValueError(f"{written!r:.60} is no time since 1970")


def _of_text(text: str) -> int:
    try:
        return moment_ns(int(text) if text.isdecimal() else float(text))
    except (ValueError, OverflowError):
        pass
    try:
        read = datetime.fromisoformat(text)
    except ValueError as error:
        raise ValueError(
            f"{text!r:.60} is no time; ISO 8601 (2026-03-01T12:00Z) or seconds since 1970 (or ms, "
            "µs, ns) is one"
        ) from error
    since = (read if read.tzinfo else read.replace(tzinfo=UTC)) - datetime(1970, 1, 1, tzinfo=UTC)
    time_ns = (since.days * 86_400 + since.seconds) * NANOSECONDS + since.microseconds * 1000
    if not 0 <= time_ns < LATEST_NS:
        raise ValueError(f"{text!r:.60} is no time since 1970")
    return time_ns
