"""Format figures and times for sentences."""

from datetime import UTC, datetime

from sensors.acquisition.blocks import NANOSECONDS, has_clock


def elapsed(time_ns: int) -> str:
    """Return "0:08:20", the time since the start of a recording without a clock."""
    minutes, seconds = divmod(time_ns // NANOSECONDS, 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{seconds:02}"


def day(time_ns: int) -> str:
    """Return "3 March 2026", UTC."""
    moment = _datetime(time_ns)
    return f"{moment.day} {moment:%B %Y}"


def clock(time_ns: int) -> str:
    """Return "14:10", UTC."""
    return f"{_datetime(time_ns):%H:%M}"


def instant(time_ns: int) -> str:
    """Return "3 March 2026 14:10 UTC"."""
    if not has_clock(time_ns):
        return f"{elapsed(time_ns)} after the start"
    return f"{day(time_ns)} {clock(time_ns)} UTC"


def stamp(time_ns: int) -> str:
    """Return "2026-03-03 14:10:05", UTC, for tables."""
    if not has_clock(time_ns):
        return elapsed(time_ns)
    return f"{_datetime(time_ns):%Y-%m-%d %H:%M:%S}"


def between_instants(start_ns: int, end_ns: int) -> str:
    """Return "3 March 2026 14:10 to 15:10 UTC", over midnight with both days."""
    if not has_clock(start_ns):
        return f"{elapsed(start_ns)} to {elapsed(end_ns)} after the start"
    if day(start_ns) == day(end_ns):
        return f"{day(start_ns)} {clock(start_ns)} to {clock(end_ns)} UTC"
    return f"{instant(start_ns)} to {instant(end_ns)}"


def period(start_ns: int, end_ns: int) -> str:
    """Return "on 3 March 2026 between 14:10 and 14:30 UTC", or over midnight with both days."""
    if not has_clock(start_ns):
        return f"between {elapsed(start_ns)} and {elapsed(end_ns)} after the start"
    if clock(start_ns) == clock(end_ns) and day(start_ns) == day(end_ns):
        return f"on {day(start_ns)} at about {clock(start_ns)} UTC"
    if day(start_ns) == day(end_ns):
        return f"on {day(start_ns)} between {clock(start_ns)} and {clock(end_ns)} UTC"
    return f"between {instant(start_ns)} and {instant(end_ns)}"


def span(seconds: float) -> str:
    """Return "45 s", "12 min", "1 h 5 min", "3 d 4 h": two units at most."""
    if seconds < 120:
        return f"{seconds:.3g} s"
    minutes = round(seconds / 60)
    hours, minutes = divmod(minutes, 60)
    days, hours = divmod(hours, 24)
    parts = [(days, "d"), (hours, "h"), (minutes, "min")]
    return (
        " ".join(f"{number} {unit}" for number, unit in parts if number)
        if days == 0
        else (f"{days} d {hours} h")
    )


def percent(share: float) -> str:
    """Return a share with two significant digits: "0.72 %", "9.1 %", "34 %"."""
    value = 100 * abs(share)
    decimals = 0 if value >= 9.95 else 1 if value >= 0.995 else 2
    return f"{value:.{decimals}f} %"


def join_with_and(texts: list[str]) -> str:
    """Return "a", "a and b", "a, b and c"."""
    return texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])} and {texts[-1]}"


def _datetime(time_ns: int) -> datetime:
    """Return the nearest second: a clock fitted to rounded stamps begins just before midnight."""
    return datetime.fromtimestamp(round(time_ns / NANOSECONDS), UTC)
