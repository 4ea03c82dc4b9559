"""A link that is made again whenever it is cut, with more patience each time."""

import asyncio
import logging
from collections.abc import Awaitable, Callable

from sensors.feeds.protocol import FeedCounts, FeedError

logger = logging.getLogger(__name__)

FIRST_RETRY = 0.5  # [s]; doubled from attempt to attempt
LONGEST_RETRY = 30.0  # [s]


class LinkError(Exception):
    """A link that could not be made, or was cut; one sentence states why."""


async def kept_connected(
    session: Callable[[], Awaitable[None]], name: str, counts: FeedCounts, *, once: bool
) -> None:
    """Run sessions of a link, one after the other, for ever.

    Parameters
    ----------
    session : callable
        Connects, records it in the counts, and takes what comes; LinkError ends it.
    name : str
        What to call the link.
    counts : FeedCounts
        Whose `connections` show that a session has connected.
    once : bool
        Give up where the first session cannot connect.

    Raises
    ------
    FeedError
        If `once` and the first session cannot connect.
    """
    attempt = 0
    while True:
        made = counts.connections
        try:
            await session()
            reason = "it was closed"
        except LinkError as error:
            reason = str(error)
        finally:
            counts.connected = False
        attempt = 1 if counts.connections > made else attempt + 1
        counts.problem = reason
        if once and not counts.connections:
            raise FeedError(f"{name} cannot be reached: {reason}")
        wait = min(FIRST_RETRY * 2 ** min(attempt - 1, 10), LONGEST_RETRY)
        if (
            attempt.bit_count() == 1
        ):  # the 1st, 2nd, 4th, 8th, …: a night without a link fills no log
            what = "the link was cut" if counts.connections > made else "cannot be reached"
            logger.warning("%s: %s (%s); trying again in %g s", name, what, reason, wait)
        await asyncio.sleep(wait)
