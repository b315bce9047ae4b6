"""The engine on a real dask cluster of two worker processes: the same bytes, and the same faults."""

from __future__ import annotations

import logging
import os
import signal
import socket
import sys
from collections.abc import Iterator
from pathlib import Path

import dask
import pytest
from campaign_jobs import Draw, store
from distributed import LocalCluster
from test_campaign_faults import PATIENCE, chunk_files, driver, some_way, whole

from sagnac.campaign import cluster as clusters
from sagnac.campaign.engine import run
from sagnac.campaign.progress import Watch
from sagnac.errors import DataError, InputError


def start(workers: int) -> LocalCluster:
    with dask.config.set({"distributed.scheduler.allowed-failures": 2}):
        return LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address=":0",  # of several clusters at once
            silence_logs=logging.CRITICAL,  # it says at length that workers die
        )


@pytest.fixture(scope="module")
def cluster() -> Iterator[LocalCluster]:
    with start(2) as made:
        yield made


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Results of 400 runs by one process of this machine."""
    folder = tmp_path_factory.mktemp("reference")
    with store(folder, 400) as held:
        run(Draw(), held, workers=1, chunk=100)
    return whole(folder)


@pytest.mark.parametrize("chunk", [10, None])
def test_a_cluster_gives_the_same_bytes(tmp_path, cluster, reference, chunk):
    notes = []
    with store(tmp_path, 400) as held:
        run(Draw(), held, scheduler=cluster.scheduler_address, chunk=chunk, watch=Watch(note=notes.append))
    assert whole(tmp_path) == reference
    assert not notes


def test_a_worker_killed_by_its_process_id_in_the_middle(tmp_path, cluster, reference):
    killed = []

    def progress(done: int, runs: int) -> None:
        if done >= 40 and not killed:
            killed.append(next(iter(cluster.workers.values())).pid)
            os.kill(killed[0], signal.SIGKILL)

    with store(tmp_path, 400) as held:
        run(Draw(), held, scheduler=cluster.scheduler_address, chunk=10, watch=Watch(progress))
    assert killed
    assert whole(tmp_path) == reference
    assert len(chunk_files(tmp_path)) == 40


def test_runs_that_kill_every_worker_are_named(tmp_path, cluster, reference):
    with store(tmp_path, 400) as held, pytest.raises(DataError) as caught:
        run(Draw(kill=205), held, scheduler=cluster.scheduler_address, chunk=400)
    assert str(caught.value).startswith("runs 0 to 399 were on 3 workers that died (the dask worker died)")
    with store(tmp_path, 400) as held:
        run(Draw(), held, scheduler=cluster.scheduler_address)
    assert whole(tmp_path) == reference


def test_a_killed_driver_goes_on_at_the_next_start(tmp_path, cluster, reference):
    with driver(tmp_path, cluster.scheduler_address) as process:
        some_way(process)
        process.kill()
        process.wait(PATIENCE)
    before = chunk_files(tmp_path)
    with store(tmp_path, 400) as held:
        run(Draw(), held, scheduler=cluster.scheduler_address)
    assert whole(tmp_path) == reference
    assert before.items() <= chunk_files(tmp_path).items()


def test_what_dask_has_begun_the_processes_here_can_end(tmp_path, cluster, reference):
    with (
        store(tmp_path, 400) as held,
        pytest.raises(DataError, match="run 333 stopped the campaign: ZeroDivisionError"),
    ):
        run(Draw(fail=333), held, scheduler=cluster.scheduler_address, chunk=20)
    before = chunk_files(tmp_path)
    assert 0 < len(before) < 20
    with store(tmp_path, 400) as held:
        run(Draw(), held, workers=1)
    assert whole(tmp_path) == reference
    assert before.items() <= chunk_files(tmp_path).items()


def test_a_scheduler_that_goes_away_ends_the_campaign(tmp_path):
    gone = []
    with start(1) as other, store(tmp_path, 400) as held:

        def progress(done: int, runs: int) -> None:
            if done >= 40 and not gone:
                gone.append(True)
                other.close()

        with pytest.raises(InputError, match="the dask scheduler at .* is gone.*of 400 runs are safe"):
            run(Draw(), held, scheduler=other.scheduler_address, chunk=10, watch=Watch(progress))


# ------------------------------------------------------------------------------------------- what cannot be used


def refused(folder: Path, scheduler: str) -> str:
    with store(folder, 400) as held, pytest.raises(InputError) as caught:
        run(Draw(), held, scheduler=scheduler)
    return str(caught.value)


def test_workers_with_another_version_are_refused(tmp_path, cluster, monkeypatch):
    ours = clusters.__version__
    monkeypatch.setattr(clusters, "__version__", "99.0")
    words = refused(tmp_path, cluster.scheduler_address)
    assert words.startswith("the dask worker tcp://")
    assert words.endswith(f"has Sagnac {ours}, the driver has 99.0; install the same on both")


def test_workers_without_sagnac_are_refused(tmp_path, cluster, monkeypatch):
    monkeypatch.setattr(clusters, "_QUESTION", "{'sagnac': None}")
    assert "has no Sagnac, the driver has" in refused(tmp_path, cluster.scheduler_address)


def test_workers_that_calculate_otherwise_are_named(tmp_path, cluster, reference, monkeypatch):
    theirs = clusters._answer()
    monkeypatch.setattr(clusters, "_answer", lambda: theirs | {"numpy": "1.0"})
    notes = []
    with store(tmp_path, 400) as held:
        run(Draw(), held, scheduler=cluster.scheduler_address, watch=Watch(note=notes.append))
    assert len(notes) == 2
    assert f"numpy {theirs['numpy']}, here 1.0: the last bits of results may depend on it" in notes[0]


def test_a_cluster_without_workers_is_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr(clusters, "_JOIN", 0.2)
    with start(0) as other:
        assert "no worker is at the dask scheduler" in refused(tmp_path, other.scheduler_address)


@pytest.mark.parametrize("address", ["127.0.0.1:8786", "http://127.0.0.1:8786", "tcp://127.0.0.1", "nonsense"])
def test_addresses_that_are_none_are_refused(tmp_path, address):
    assert refused(tmp_path, address).startswith(f"no dask scheduler answers at {address}: ")


def test_a_port_where_nobody_or_somebody_else_listens(tmp_path, monkeypatch):
    monkeypatch.setattr(clusters, "_CONNECT", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        assert "timed out" in refused(tmp_path, address)
    assert "Connection refused" in refused(tmp_path, address)


def test_without_dask_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert refused(tmp_path, "tcp://127.0.0.1:8786") == "a dask cluster needs dask: pip install 'sagnac[cluster]'"


def test_a_late_worker_with_another_version_gets_no_work(tmp_path, reference, monkeypatch):
    """The one that joins answers as if it had another Sagnac."""
    monkeypatch.setattr(clusters, "_REFRESH", 0.0)
    unlike, notes, there = clusters._unlike, [], []
    with start(1) as other, store(tmp_path, 400) as held:
        there += [w.worker_address for w in other.workers.values()]

        def progress(done: int, runs: int) -> None:
            if done >= 40 and len(other.workers) == 1:
                monkeypatch.setattr(clusters, "_unlike", lambda found: unlike({**found, "sagnac": "0.0.1"}))
                other.scale(2)
                other.sync(other._correct_state)

        run(Draw(), held, scheduler=other.scheduler_address, chunk=4, watch=Watch(progress, notes.append))
        late = next(w.worker_address for w in other.workers.values() if w.worker_address not in there)
    assert whole(tmp_path) == reference
    assert notes == [f"the dask worker {late} has Sagnac 0.0.1, the driver has {clusters.__version__}; it gets no work"]


def test_a_cluster_that_all_workers_leave_is_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr(clusters, "_REFRESH", 0.1)
    notes, gone = [], []
    with start(1) as other, store(tmp_path, 400) as held:

        def progress(done: int, runs: int) -> None:
            if done >= 40 and not gone:
                gone.append(True)
                monkeypatch.setattr(clusters, "_JOIN", 0.5)
                other.scale(0)

        with pytest.raises(InputError, match=r"no worker that can be used has been at .* runs are safe"):
            run(
                Draw(pause=0.002),
                held,
                scheduler=other.scheduler_address,
                chunk=10,
                watch=Watch(progress, notes.append),
            )
    assert notes == [f"no worker is left at {other.scheduler_address}; waiting 0.5 s for one"]
