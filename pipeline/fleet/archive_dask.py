"""The one door to Dask.distributed: calls on workers of this machine or of a cluster.

A worker that dies costs the calls it was at, which other workers begin again; a call by which
several workers have died fails alone. Nothing listens beyond this machine unless a cluster's
scheduler is named.
"""

import logging
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from pipeline.fleet.archive_work import Call, Failed, Outcome, Workers, attempted
from sensors.errors import InputError

AHEAD = 2  # calls for every thread of the workers, so that none waits for the next
CONNECTING = 30.0  # how long a scheduler is waited for [s]
LOOPBACK = "127.0.0.1"


class DaskWorkers:
    """The workers that a Dask client knows."""

    def __init__(self, client: Any) -> None:
        self._client = client

    def outcomes(self, calls: Iterable[Call]) -> Iterator[Outcome]:
        from distributed import as_completed

        waiting: dict[Any, Call] = {}
        ready = as_completed()
        pulled = iter(calls)
        while True:
            for call in pulled:
                future = self._client.submit(
                    attempted, call.function, call.argument, key=call.key, pure=False
                )
                waiting[future] = call
                ready.add(future)
                if len(waiting) >= self._room:
                    break
            if not waiting:
                return
            future = next(ready)
            yield Outcome(waiting.pop(future), _result_of(future))

    @property
    def _room(self) -> int:
        """Calls that are under way at a time; workers may come and go."""
        return max(1, AHEAD * sum(self._client.nthreads().values()))


def _result_of(future: Any) -> Any:
    from distributed.scheduler import KilledWorker

    try:
        return future.result()
    except KilledWorker as error:
        return Failed(f"{error.allowed_failures + 1} workers have died of it")
    finally:
        future.release()


def usable_cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0))


@contextmanager
def local_workers(count: int) -> Iterator[Workers]:
    """So many processes of this machine, one thread each; only this machine can reach them."""
    _require_dask()
    from distributed import Client, LocalCluster

    with (
        LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            processes=True,
            host=LOOPBACK,
            dashboard_address=f"{LOOPBACK}:0",
            scheduler_kwargs={"dashboard": False},
            worker_dashboard_address=f"{LOOPBACK}:0",
            silence_logs=logging.ERROR,
            preload=["pipeline.fleet.archive_worker"],
        ) as cluster,
        Client(cluster) as client,
    ):
        yield DaskWorkers(client)


@contextmanager
def cluster_workers(address: str, *, patience: float = CONNECTING) -> Iterator[Workers]:
    """The workers of a scheduler, e.g. tcp://10.0.0.5:8786. All of them must be able to read the
    archive under the same paths and have this pilewatch.

    patience   how long the scheduler is waited for [s]

    Raises InputError where nobody answers there, or none of its workers.
    """
    _require_dask()
    from distributed import Client

    with _opened(lambda: Client(address, timeout=patience), address) as client:
        if not client.nthreads():
            raise InputError(f"--cluster {address}: the scheduler has no workers")
        yield DaskWorkers(client)


@contextmanager
def _opened(connect: Callable[[], Any], address: str) -> Iterator[Any]:
    try:
        client = connect()
    except (OSError, ValueError) as error:
        raise InputError(
            f"--cluster {address}: no Dask scheduler answers there: {error}"
        ) from error
    with client:
        yield client


def _require_dask() -> None:
    """Dask, loaded so that it speaks of nothing but errors."""
    try:
        import dask

        dask.config.set({"logging": {"distributed": "error", "distributed.client": "error"}})
        import distributed  # noqa: F401
    except ImportError:
        raise InputError(
            "processes and clusters need the extra `cluster`: pip install 'pilewatch[cluster]'; "
            "--serial goes without"
        ) from None
