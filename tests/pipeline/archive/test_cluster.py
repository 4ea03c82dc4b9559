"""Processes of this machine do what one process does; one that dies costs only what it was at."""

import threading
from collections.abc import Callable, Iterator
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from types import SimpleNamespace

import dask
import pytest
from distributed import LocalCluster
from distributed.client import FutureCancelledError
from distributed.core import Status

from pipeline.archive import cluster
from pipeline.archive.cluster import (
    ClusterLost,
    DaskWorkers,
    cluster_workers,
    local_workers,
)
from pipeline.archive.reprocessing import reprocessed
from pipeline.archive.work import Call, Failed, ThisProcess, Workers
from sensors.errors import InputError
from tests.conftest import SHORT_SCENARIO
from tests.pipeline.archive.archives import tables_of
from tests.pipeline.archive.calls import killed_always, killed_once, refused, squared

TABLES = {"modes", "mode_shapes", "posterior", "pairs"}
ONE_STRUCTURE = 'blade_model = "exact"\ntube_shear = "exact"\n'


@pytest.fixture(scope="module")
def two_processes() -> Iterator[Workers]:
    """As the command starts them: each imports everything again."""
    with local_workers(2) as workers:
        yield workers


@pytest.fixture(scope="module")
def forked_workers() -> Iterator[None]:
    """A process that has imported everything gives those that die a quick successor.

    Of which kind a worker's process is does not matter to what becomes of its calls.
    """
    with dask.config.set({"distributed.worker.multiprocessing-method": "forkserver"}):
        yield


@pytest.fixture(scope="module")
def two_workers(forked_workers: None) -> Iterator[Workers]:
    with local_workers(2) as workers:
        yield workers


@pytest.mark.usefixtures("identified_before")  # here; the workers know nothing of it
def test_two_processes_give_the_bits_of_one(
    two_processes: Workers, archive: list[Path], tmp_path: Path
) -> None:
    """Each window, each pass and each posterior; one structure takes every step of several."""
    scenario = tmp_path / "one.toml"
    scenario.write_text(SHORT_SCENARIO + ONE_STRUCTURE, encoding="utf-8")
    one, two = tmp_path / "one", tmp_path / "two"

    reprocessed(archive, one, ThisProcess(), scenario=str(scenario))
    reprocessed(archive, two, two_processes, scenario=str(scenario))

    assert {path.split("/")[0] for path in tables_of(one)} >= TABLES
    assert tables_of(two) == tables_of(one)


def test_a_worker_that_is_killed_costs_only_its_task(
    two_processes: Workers, tmp_path: Path
) -> None:
    calls = [Call(f"square-{n}", squared, n) for n in range(8)]
    calls.insert(3, Call("fatal once", killed_once, tmp_path / "marker"))

    found = {each.call.key: each.result for each in two_processes.outcomes(calls)}

    assert found.pop("fatal once") == "done"
    assert found == {f"square-{n}": n * n for n in range(8)}


@pytest.mark.nightly
def test_a_task_that_kills_every_worker_fails_alone(two_workers: Workers) -> None:
    """Those that wait behind it at the same worker are blamed by Dask, and done all the same."""
    calls = [Call("fatal", killed_always, 0), Call("wrong", refused, 7), Call("good", squared, 3)]

    found = {each.call.key: each.result for each in two_workers.outcomes(calls)}

    assert isinstance(found["fatal"], Failed)
    assert "workers have died of it" in found["fatal"].text
    assert found["wrong"] == Failed("7 is wrong")
    assert found["good"] == 9


def test_what_waits_for_a_call_goes_on_also_where_that_call_kills_its_workers(
    two_workers: Workers,
) -> None:
    """A day's pass waits for the one of the day before."""
    over: set[str] = set()

    def calls() -> Iterator[Call | None]:
        yield Call("fatal at first", killed_always, 0)
        while "fatal at first" not in over:
            yield None
        yield Call("afterwards", squared, 4)

    found = {}
    for outcome in two_workers.outcomes(calls()):
        over.add(outcome.call.key)
        found[outcome.call.key] = outcome.result

    assert isinstance(found["fatal at first"], Failed)
    assert found["afterwards"] == 16


def test_calls_are_pulled_only_when_there_is_room(two_workers: Workers) -> None:
    """An archive of any size never waits in memory."""
    pulled = []

    def calls() -> Iterator[Call]:
        for number in range(50):
            pulled.append(number)
            yield Call(f"lazy-{number}", squared, number)

    outcomes = two_workers.outcomes(calls())
    next(outcomes)

    assert len(pulled) <= 5
    assert len(list(outcomes)) == 49


@pytest.mark.usefixtures("forked_workers")
def test_a_worker_that_nobody_restarts_is_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that dies while it starts takes its guard with it."""
    monkeypatch.setattr(cluster, "QUIET_WORKERS", 0.5)
    with local_workers(1) as workers:
        client = workers._client  # type: ignore[attr-defined]
        (guard,) = client.cluster.workers.values()
        client.sync(guard.close)

        (outcome,) = workers.outcomes([Call("after all", squared, 5)])

    assert outcome.result == 25


@pytest.mark.usefixtures("forked_workers")
def test_a_worker_that_is_forgotten_while_it_starts_again_is_replaced(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """On a loaded machine it takes longer than Dask waits, which then closes its guard."""
    monkeypatch.setattr(cluster, "QUIET_WORKERS", 0.5)
    with (
        dask.config.set({"distributed.deploy.lost-worker-timeout": "1 ms"}),
        local_workers(1) as workers,
    ):
        (outcome,) = workers.outcomes([Call("fatal once", killed_once, tmp_path / "marker")])

    assert outcome.result == "done"


def test_workers_of_a_cluster_do_the_same(two_workers: Workers) -> None:
    address = two_workers._client.scheduler.address  # type: ignore[attr-defined]

    with cluster_workers(address) as workers:
        (outcome,) = workers.outcomes([Call("elsewhere", squared, 12)])

    assert outcome.result == 144


def test_workers_of_several_threads_are_refused() -> None:
    """Threads of one process share how many cores linear algebra uses, and so the last bits."""
    with (
        LocalCluster(
            n_workers=1,
            threads_per_worker=2,
            processes=False,
            dashboard_address="127.0.0.1:0",
            silence_logs=50,
        ) as cluster,
        pytest.raises(InputError, match=r"has 2 threads; start each worker with --nthreads 1"),
        cluster_workers(cluster.scheduler_address),
    ):
        pass


def cluster_of(n_workers: int) -> LocalCluster:
    return LocalCluster(
        n_workers=n_workers,
        threads_per_worker=1,
        processes=False,
        dashboard_address="127.0.0.1:0",
        silence_logs=50,
    )


def test_a_cluster_whose_workers_start_after_the_scheduler_is_waited_for() -> None:
    with cluster_of(0) as started:
        later = threading.Timer(0.3, started.scale, [1])
        later.start()
        with cluster_workers(started.scheduler_address) as workers:
            (outcome,) = workers.outcomes([Call("later", squared, 11)])
        later.join()
    assert outcome.result == 121


def test_a_cluster_without_workers_is_one_line_with_how_to_start_them() -> None:
    with (
        cluster_of(0) as started,
        pytest.raises(InputError, match=r"no workers for 0.2 s; start them with dask worker "),
        cluster_workers(started.scheduler_address, patience=0.2),
    ):
        pass


def test_a_scheduler_that_is_not_there_is_one_line() -> None:
    with pytest.raises(InputError, match="no Dask scheduler answers there"):
        cluster_workers("tcp://127.0.0.1:9", patience=0.2).__enter__()


def test_a_scheduler_that_goes_in_the_midst_is_one_line() -> None:
    class Lost:
        """A call of which only the scheduler knew."""

        def add_done_callback(self, told: Callable[[object], None]) -> None:
            told(self)

        def result(self, timeout: float) -> object:
            raise FutureCancelledError("key", "scheduler-connection-lost")

        def release(self) -> None:
            pass

    client = SimpleNamespace(nthreads=lambda: {"worker": 1}, submit=lambda *_, **__: Lost())
    workers = DaskWorkers(client, missed=lambda _: None)
    with pytest.raises(ClusterLost, match="what is finished is kept"):
        list(workers.outcomes([Call("a", str, 1)]))


def test_workers_with_another_pilewatch_or_none_are_refused() -> None:
    for theirs, told in ((PackageNotFoundError("pilewatch"), "no pilewatch"), ("0.0.9", "0.0.9")):
        client = SimpleNamespace(nthreads=lambda: {"w": 1}, run=lambda *_, **__: {"w": theirs})  # noqa: B023
        with pytest.raises(InputError, match=f"worker w has .*{told}, this is pilewatch"):
            cluster._require_alike(client, "tcp://here:1")


def test_workers_are_missed_where_one_dies_with_a_result_that_is_not_fetched() -> None:
    """The call was over, its result went with the worker, and no other process takes it up."""

    class TakenAlong:
        waits = 0

        def result(self, timeout: float) -> int:
            self.waits += 1
            if self.waits == 1:
                raise TimeoutError
            return 16

        def release(self) -> None:
            pass

    class NobodyLeft:
        def nthreads(self) -> dict[str, int]:
            return {}

    missed: list[int] = []
    workers = DaskWorkers(NobodyLeft(), missed.append)
    assert workers._result_of(TakenAlong()) == 16
    assert missed == [0]


@pytest.mark.parametrize(
    ("states", "n_counted", "asked"),
    [
        (["running", "running"], 2, []),
        (["running", "closed"], 2, [3]),
        (["failed", "closed"], 2, [4]),
        (["running", "closed", "running"], 3, []),  # another one has been started already
        (["running"], 5, [5]),  # one is forgotten and still counted
    ],
)
def test_as_many_workers_are_asked_for_as_died_while_they_started(
    states: list[str], n_counted: int, asked: list[int]
) -> None:
    guards = {n: SimpleNamespace(status=Status[each]) for n, each in enumerate(states)}
    scaled: list[int] = []
    local = SimpleNamespace(
        workers=guards, worker_spec=dict.fromkeys(range(n_counted)), scale=scaled.append
    )
    cluster._replace_lost(local, 2)
    assert scaled == asked
