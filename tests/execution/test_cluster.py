"""Tasks on a cluster: the same function as on one machine, through Dask's pool."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from execution.actions import act

from resim.core.errors import InputError
from resim.execution.child import Failure
from resim.execution.cluster import Cluster, cluster
from resim.execution.workers import run_all

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def pool() -> Iterator[Cluster]:
    """A scheduler and two workers, each a process, on this machine."""
    os.environ["PYTHONPATH"] = str(Path(__file__).parents[1])
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local,
        cluster(local.scheduler_address) as found,
    ):
        yield found
    del os.environ["PYTHONPATH"]


@pytest.mark.slow
def test_what_breaks_on_a_cluster_costs_its_own_task_only(pool: Cluster) -> None:
    assert pool.threads == 2
    names = ["do", "kill", "do", "refuse", "do", "hang"]
    tasks = [(name, k) for k, name in enumerate(names)]
    found = dict(run_all(act, tasks, workers=pool.threads, time_limit=5.0, pool=pool.pool))
    assert {k: r[0] for k, r in found.items() if not isinstance(r, Failure)} == {0: 0, 2: 2, 4: 4}
    assert found[1] == Failure("the process was ended by SIGKILL", crashed=True)
    assert found[3] == Failure("the input is wrong", crashed=False)
    assert found[5] == Failure("took longer than 5 s", crashed=True)


@pytest.mark.slow
def test_no_scheduler_is_told_of() -> None:
    with pytest.raises(InputError, match="no scheduler answers"), cluster("tcp://127.0.0.1:9"):
        pass
