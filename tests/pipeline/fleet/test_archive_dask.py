"""Processes of this machine do what one process does; one that dies costs only what it was at."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from pipeline.fleet.archive import reprocessed
from pipeline.fleet.archive_dask import cluster_workers, local_workers
from pipeline.fleet.archive_work import Call, Failed, Workers
from sensors.errors import InputError
from tests.pipeline.fleet.calls import killed_always, killed_once, refused, squared

TABLES = ("modes", "mode_shapes", "posterior", "pairs")


@pytest.fixture(scope="module")
def two_workers() -> Iterator[Workers]:
    with local_workers(2) as workers:
        yield workers


def test_two_processes_give_the_bits_of_one(
    two_workers: Workers, archive: list[Path], results: Path, tmp_path: Path
) -> None:
    reprocessed(archive, tmp_path, two_workers)

    for table in TABLES:
        series = (results / f"{table}.parquet").read_bytes()
        assert (tmp_path / f"{table}.parquet").read_bytes() == series


def test_a_worker_that_is_killed_costs_only_its_task(two_workers: Workers, tmp_path: Path) -> None:
    calls = [Call(f"square-{n}", squared, n) for n in range(8)]
    calls.insert(3, Call("fatal once", killed_once, tmp_path / "marker"))

    found = {each.call.key: each.result for each in two_workers.outcomes(calls)}

    assert found.pop("fatal once") == "done"
    assert found == {f"square-{n}": n * n for n in range(8)}


def test_a_task_that_kills_every_worker_fails_alone(two_workers: Workers) -> None:
    calls = [Call("fatal", killed_always, 0), Call("wrong", refused, 7), Call("good", squared, 3)]

    found = {each.call.key: each.result for each in two_workers.outcomes(calls)}

    assert isinstance(found["fatal"], Failed)
    assert "workers have died of it" in found["fatal"].text
    assert found["wrong"] == Failed("7 is wrong")
    assert found["good"] == 9


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


def test_a_scheduler_that_is_not_there_is_one_line() -> None:
    with pytest.raises(InputError, match="no Dask scheduler answers there"):
        cluster_workers("tcp://127.0.0.1:9", patience=0.2).__enter__()
