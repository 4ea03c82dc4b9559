"""How well 64 workers are used by an archive: a simulation of measured costs.

    python -m tests.benchmarks workers [--workers 64] [--turbines 100] [--days 30]
        [--identification 1.1] [--write]

    first    every file identified: tasks that need nothing of each other
    then     each turbine's days, one after the other, each followed by its posteriors

A worker that is free takes the first task that is ready, as Dask's do. What the process that asks
does alone (looking at files, writing months) is added in full. Costs of a day are those of
`history` (results/history.json), of a window's identification those of `reprocess` [CPU s].
"""

import argparse
import heapq
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from tests.benchmarks._results import keep, kept

WINDOWS_A_DAY = 144
WINDOWS_A_FILE = 6
POSTERIORS_AT_ONCE = 35  # of a day's, in one task
DAYS_A_MONTH = 30


@dataclass(frozen=True, slots=True)
class Costs:
    """CPU times [s]."""

    identification: float
    """Of a window."""
    day: float
    """Of a day's tracking and sums, after the day before."""
    posterior: float
    """Of a window."""
    look: float
    """At one unchanged file, in the process that asks."""
    month: float
    """Of a month's tables, in the process that asks."""


def main(arguments: list[str]) -> None:
    """Print the efficiency."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks workers")
    parser.add_argument("--workers", type=int, default=64)
    parser.add_argument("--turbines", type=int, default=100)
    parser.add_argument("--days", type=int, default=30)
    parser.add_argument("--identification", type=float, default=1.1)
    parser.add_argument("--write", action="store_true")
    chosen = parser.parse_args(arguments)
    figures = simulated(chosen.workers, chosen.turbines, chosen.days, costs(chosen.identification))
    print(json.dumps(figures, indent=1))
    if chosen.write:
        command = (
            f"python -m tests.benchmarks workers --workers {chosen.workers} --turbines "
            f"{chosen.turbines} --days {chosen.days} --identification {chosen.identification:g} "
            "--write"
        )
        keep("workers", figures, command=command, depends=("pipeline/archive",))


def costs(identification: float) -> Costs:
    """As they were measured."""
    history = (kept("history") or {})["figures"]
    return Costs(
        identification=identification,
        day=history["pass_cpu"],
        posterior=history["posterior_cpu"],
        look=history["survey_ms_a_file"] / 1000,
        month=history["tables_cpu"],
    )


def simulated(workers: int, turbines: int, days: int, cost: Costs) -> dict[str, float]:
    """Time, work and efficiency of a whole archive."""
    files = turbines * days * WINDOWS_A_DAY // WINDOWS_A_FILE
    file = WINDOWS_A_FILE * cost.identification
    first = duration_of(workers, [[file]] * files, ())
    posteriors = (POSTERIORS_AT_ONCE * cost.posterior,) * (WINDOWS_A_DAY // POSTERIORS_AT_ONCE)
    then = duration_of(workers, [[cost.day] * days] * turbines, posteriors)
    alone = files * cost.look + turbines * -(-days // DAYS_A_MONTH) * cost.month
    work = files * file + turbines * days * (cost.day + sum(posteriors))
    total = first + then + alone
    return {
        "workers": workers,
        "turbines": turbines,
        "days": days,
        "work_h": round(work / 3600, 2),
        "wall_h": round(total / 3600, 2),
        "alone_h": round(alone / 3600, 3),
        "efficiency": round(work / (workers * total), 3),
    }


def duration_of(workers: int, chains: Iterable[list[float]], after: tuple[float, ...]) -> float:
    """Time until all links of all chains, and what follows each link, are done."""
    ready: list[tuple[float, int, Iterator[float] | None, float]] = []
    number = 0
    for chain in chains:
        links = iter(chain)
        number += 1
        ready.append((0.0, number, links, next(links)))
    heapq.heapify(ready)
    free = [0.0] * workers
    end = 0.0
    while ready:
        since, _, links, cost = heapq.heappop(ready)
        done = max(since, heapq.heappop(free)) + cost
        heapq.heappush(free, done)
        end = max(end, done)
        if links is None:
            continue
        following = next(links, None)
        for each in ((links, following), *((None, each) for each in after)):
            if each[1] is not None:
                number += 1
                heapq.heappush(ready, (done, number, each[0], each[1]))
    return end
