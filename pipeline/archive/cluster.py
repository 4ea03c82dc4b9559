"""The one door to Dask.distributed: calls on workers of this machine or of a cluster.

A worker that dies costs the calls it was at, which other workers begin again; a call by which
several workers have died fails alone. Nothing listens beyond this machine unless a cluster's
scheduler is named.
"""

import logging
import os
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from queue import Empty, SimpleQueue
from typing import Any

from pipeline.archive.work import Call, Failed, Outcome, Workers, attempted
from sensors.constants import LOOPBACK
from sensors.errors import InputError
from sensors.extras import import_extra

logger = logging.getLogger(__name__)

AHEAD = 2  # calls for every thread of the workers, so that none waits for the next
CONNECTING = 30.0  # how long a scheduler is waited for [s]
QUIET_WORKERS = 20.0  # without a result, after which the workers are counted [s]
DEATHS_TOLD_APART = 1  # a call at which a second worker dies is tried once more, alone
# A worker works in a thread of its own, where the C library would return every window's arrays to
# the system and fetch them again, a tenth of its time.
ALLOCATION = {
    "MALLOC_ARENA_MAX": 1,
    "MALLOC_TRIM_THRESHOLD_": 2**28,  # [bytes]
    "MALLOC_MMAP_THRESHOLD_": 2**27,
}


class ClusterLost(InputError):  # noqa: N818  # it says what happened
    """A scheduler that is gone in the midst of the work."""


class DaskWorkers:
    """The workers that a Dask client knows.

    Parameters
    ----------
    client : distributed.Client
        Of the scheduler.
    missed : callable
        Called with how many there are when nothing has come for a while.

    Raises
    ------
    ClusterLost
        From `outcomes`, where the scheduler goes.
    """

    def __init__(self, client: Any, missed: Callable[[int], None]) -> None:
        self._client = client
        self._missed = missed

    def outcomes(self, calls: Iterable[Call | None]) -> Iterator[Outcome]:
        """Yield the outcome of each call as it ends; what kills a worker is tried again alone."""
        waiting: dict[Any, Call] = {}
        ready: SimpleQueue[Any] = SimpleQueue()
        suspects: deque[Call] = deque()
        pulled = iter(calls)
        while True:
            more = self._submit(pulled, waiting, ready)
            if waiting:
                future = self._next(ready)
                call, result = waiting.pop(future), self._result_of(future)
                if isinstance(result, _WorkersDied):
                    suspects.append(call)
                else:
                    yield Outcome(call, result)
            elif suspects:
                call = suspects.popleft()
                yield Outcome(call, self._alone(call))
            elif not more:
                return

    def _submit(
        self, calls: Iterator[Call | None], waiting: dict[Any, Call], ready: "SimpleQueue[Any]"
    ) -> bool:
        """Submit as many calls as there is room for; return whether more may come."""
        while len(waiting) < self._room:
            try:
                call = next(calls)
            except StopIteration:
                return False
            if call is None:
                break
            future = self._submitted(call, call.key)
            waiting[future] = call
            future.add_done_callback(ready.put)
        return True

    def _next(self, ready: "SimpleQueue[Any]") -> Any:
        """The next that is ready. While nothing comes, workers that have gone are missed."""
        while True:
            try:
                return ready.get(timeout=QUIET_WORKERS)
            except Empty:
                self._missed(len(self._client.nthreads()))

    def _result_of(self, future: Any) -> Any:
        """What a future that was ready gives. A worker that dies with a result before it is fetched
        takes it along, and workers that have gone are missed here too."""
        try:
            while True:
                try:
                    return _ready_result(future)
                except TimeoutError:
                    self._missed(len(self._client.nthreads()))
        finally:
            future.release()

    def _alone(self, call: Call) -> Any:
        """Once more with nothing else under way. Why: Dask blames every call that waits at a worker
        that dies, so that one deadly call may take innocent ones with it."""
        ready: SimpleQueue[Any] = SimpleQueue()
        future = self._submitted(call, f"{call.key}-alone")  # forgotten by Dask unless held
        future.add_done_callback(ready.put)
        self._next(ready)
        result = self._result_of(future)
        if isinstance(result, _WorkersDied):
            return Failed(f"{result.count} workers have died of it")
        return result

    def _submitted(self, call: Call, key: str) -> Any:
        return self._client.submit(attempted, call.function, call.argument, key=key, pure=False)

    @property
    def _room(self) -> int:
        """Calls that are under way at a time; workers may come and go."""
        return max(1, AHEAD * sum(self._client.nthreads().values()))


@dataclass(frozen=True, slots=True)
class _WorkersDied:
    """So many workers died of one call, one after the other."""

    count: int


def _ready_result(future: Any) -> Any:
    from distributed.client import FutureCancelledError
    from distributed.scheduler import KilledWorker

    try:
        return future.result(timeout=QUIET_WORKERS)
    except KilledWorker as error:
        return _WorkersDied(error.allowed_failures + 1)
    except FutureCancelledError as error:  # nothing here cancels: the scheduler is gone
        raise ClusterLost(
            "the Dask scheduler has gone; what is finished is kept, and the same command goes on "
            "with it when a scheduler runs again"
        ) from error


def usable_cores() -> int:
    """Processors that this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def local_workers(count: int) -> Iterator[Workers]:
    """So many processes of this machine, one thread each; only this machine can reach them."""
    _require_dask()
    import dask
    from distributed import Client, LocalCluster

    with (
        dask.config.set({"distributed.scheduler.allowed-failures": DEATHS_TOLD_APART}),
        dask.config.set(_of_workers(ALLOCATION)),
        LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            processes=True,
            host=LOOPBACK,
            dashboard_address=f"{LOOPBACK}:0",
            scheduler_kwargs={"dashboard": False},
            worker_dashboard_address=f"{LOOPBACK}:0",
            silence_logs=logging.ERROR,
            preload=["pipeline.archive.worker"],
        ) as cluster,
        Client(cluster) as client,
    ):
        yield DaskWorkers(client, lambda _: _replace_lost(cluster, count))


def _of_workers(environment: dict[str, int]) -> dict[str, int]:
    """Dask's settings by which workers are started with these variables, beside its own."""
    return {f"distributed.nanny.pre-spawn-environ.{name}": v for name, v in environment.items()}


def _replace_lost(cluster: Any, count: int) -> None:
    """New processes for those that died while they were starting: nothing else restarts these.

    Nor those that took longer to come back than Dask waits (15 s): it closes their guards and
    forgets them, but still counts them among the workers it has, so that asking for as many as it
    counts starts them.
    """
    from distributed.core import Status

    ended = (Status.closed, Status.failed)
    guards = list(cluster.workers.values())
    lost = sum(guard.status in ended for guard in guards)
    if len(guards) < count + lost:
        cluster.scale(max(count + lost, len(cluster.worker_spec)))


@contextmanager
def cluster_workers(address: str, *, patience: float = CONNECTING) -> Iterator[Workers]:
    """The workers of a scheduler, e.g. tcp://10.0.0.5:8786.

    Parameters
    ----------
    address : str
        Of the scheduler.
    patience : float, optional
        How long the scheduler, and then a first worker, is waited for [s].

    Raises
    ------
    InputError
        If nothing answers there, or no worker.
    ClusterLost
        If the scheduler goes.

    Notes
    -----
    All of the workers must be able to read the archive under the same paths, have this pilewatch,
    and have one thread.
    """
    _require_dask()
    from distributed import Client

    with _opened(lambda: Client(address, timeout=patience), address) as client:
        _await_worker(client, address, patience)
        _require_alike(client, address)
        try:
            yield DaskWorkers(client, _wait_for_workers)
        except ClusterLost as error:
            raise ClusterLost(f"--cluster {address}: {error}") from error


def _wait_for_workers(alive: int) -> None:
    if not alive:
        logger.warning("the cluster has no worker left; waiting for one")


def _await_worker(client: Any, address: str, patience: float) -> None:
    """A first one: it may start just after the scheduler, or again after a failure."""
    try:
        client.wait_for_workers(1, timeout=patience)
    except TimeoutError as error:
        raise InputError(
            f"--cluster {address}: the scheduler has had no workers for {patience:g} s; start them "
            f"with dask worker {address} --nthreads 1"
        ) from error


def _require_alike(client: Any, address: str) -> None:
    """Whether the workers give this process' numbers: one thread each, the same pilewatch.

    Several threads of one process would share the setting that linear algebra uses one core.
    """
    for worker, count in client.nthreads().items():
        if count != 1:
            raise InputError(
                f"--cluster {address}: worker {worker} has {count} threads; start each worker with "
                "--nthreads 1, and more of them"
            )
    own = version("pilewatch")  # the standard library's function: a worker need not have ours
    for worker, theirs in client.run(version, "pilewatch", on_error="return").items():
        if theirs != own:
            has = f"pilewatch {theirs}" if isinstance(theirs, str) else "no pilewatch"
            raise InputError(
                f"--cluster {address}: worker {worker} has {has}, this is pilewatch {own}; install "
                "the same on every worker"
            )


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
    """Dask, loaded so that it speaks of nothing but errors; of a scheduler that has gone we do."""
    purpose = "processes and clusters (--serial goes without)"
    dask = import_extra("dask", "cluster", purpose)
    dask.config.set({"logging": {"distributed": "error", "distributed.client": "critical"}})
    import_extra("distributed", "cluster", purpose)
