"""The same trials on a Ray cluster of one machine with two CPUs."""

import os
import secrets
import signal
import socket
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest
from trial_functions import drawn, killed, undetected

from poil_drake.benchmarks.trials.pool import LostTrial, run_trials
from poil_drake.errors import DetectionError, InvalidValueError

pytestmark = pytest.mark.skipif(find_spec("ray") is None, reason="Ray is not installed")


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        # A token of its own, so that Ray writes none to the user's home.
        patch.setenv("RAY_AUTH_MODE", "token")
        patch.setenv("RAY_AUTH_TOKEN", secrets.token_hex(32))
        # Workers import what they run, too.
        patch.setenv("PYTHONPATH", str(Path(__file__).parent))
        # Only now, as Ray looks at these when it is imported.
        from ray.cluster_utils import Cluster

        cluster = Cluster(
            initialize_head=True,
            head_node_args={
                "num_cpus": 2,
                "object_store_memory": 80 * 2**20,
                "include_dashboard": False,
            },
        )
        yield cluster.address
        cluster.shutdown()


def test_results_are_those_of_processes_on_this_machine(address: str) -> None:
    import ray

    seeds = [(seed,) for seed in range(7)]
    handler = signal.getsignal(signal.SIGTERM)

    ends = list(run_trials(drawn, seeds, shared=(10.0,), ray_address=address))

    assert len(ends) == len(seeds)
    assert dict(ends) == dict(run_trials(drawn, seeds, shared=(10.0,)))
    assert not ray.is_initialized()
    assert signal.getsignal(signal.SIGTERM) is handler


def test_killed_workers_lose_nothing_and_a_trial_that_kills_every_one_is_named(
    address: str, tmp_path: Path
) -> None:
    arguments = [(0, 1), (1, 0), (2, 9), (3, 0), (4, 1)]

    ends = run_trials(killed, arguments, shared=(tmp_path,), ray_address=address, attempts=2)

    known = dict(ends)
    lost = known.pop(2)
    assert isinstance(lost, LostTrial)
    assert (lost.index, lost.arguments, lost.attempts) == (2, (2, 9), 2)
    assert known == {0: 0, 1: 1, 3: 3, 4: 4}
    runs = [len((tmp_path / f"{seed}.runs").read_text()) for seed in range(5)]
    assert runs == [2, 1, 2, 1, 2]


def test_an_exception_comes_through_as_it_was_raised(address: str) -> None:
    with pytest.raises(DetectionError, match="No mug in trial") as caught:
        list(run_trials(undetected, [(0,), (1,)], ray_address=address, trials_per_worker=1))

    assert type(caught.value) is DetectionError
    assert caught.value.remedy == "Look elsewhere."
    assert "in undetected" in caught.value.__notes__[0]


def test_an_address_where_nobody_listens_is_refused() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]

    with pytest.raises(InvalidValueError, match=f"The Ray cluster at '127.0.0.1:{port}'"):
        list(run_trials(drawn, [(10.0, 0)], ray_address=f"127.0.0.1:{port}"))


def test_a_cluster_that_is_there_already_stays(address: str) -> None:
    import ray

    ray.init(address=address, log_to_driver=False)
    try:
        ends = list(run_trials(os.path.basename, [("a/b",)], ray_address=address))

        assert ends == [(0, "b")]
        assert ray.is_initialized()
    finally:
        ray.shutdown()
