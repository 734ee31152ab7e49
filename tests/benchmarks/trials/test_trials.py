"""Trials on processes of this machine and on a Ray cluster."""

import os
import secrets
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest
from trial_functions import draw, fail, get_process, get_threads, kill, make_lock

from poil_drake.benchmarks.trials.pool import LostTrial, run_trials
from poil_drake.errors import DetectionError, InvalidValueError, MissingDependencyError

SEEDS = [(seed,) for seed in range(7)]
needs_ray = pytest.mark.skipif(find_spec("ray") is None, reason="Ray is not installed")


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """The address of a Ray cluster with two CPUs."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        # Without a token in the environment, Ray writes one to the user's home.
        patch.setenv("RAY_AUTH_MODE", "token")
        patch.setenv("RAY_AUTH_TOKEN", secrets.token_hex(32))
        # For the workers, which import the functions.
        patch.setenv("PYTHONPATH", str(Path(__file__).parent))
        # Ray reads these variables when it is imported.
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


@pytest.fixture(params=["1 job", "2 jobs", pytest.param("Ray", marks=needs_ray)])
def workers(request: pytest.FixtureRequest) -> dict:
    """Options of `run_trials` that choose the workers."""
    if request.param == "Ray":
        return {"ray_address": request.getfixturevalue("address")}
    return {"jobs": int(request.param[0])}


def test_results_do_not_depend_on_the_workers(workers: dict) -> None:
    ends = list(run_trials(draw, SEEDS, shared=(10.0,), **workers))

    assert len(ends) == len(SEEDS)
    assert dict(ends) == {seed: draw(10.0, seed) for (seed,) in SEEDS}


def test_no_trials_give_no_results() -> None:
    assert list(run_trials(draw, [])) == []


@pytest.mark.parametrize(
    ("trials_per_worker", "expected"), [(None, [7]), (3, [3, 3, 1])], ids=["kept", "replaced"]
)
def test_worker_runs_as_many_trials_as_allowed(
    trials_per_worker: int | None, expected: list[int]
) -> None:
    ends = run_trials(get_process, SEEDS, trials_per_worker=trials_per_worker)

    processes = [process for _, process in ends]
    assert [processes.count(process) for process in dict.fromkeys(processes)] == expected


def test_worker_computes_on_one_core(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "5")

    assert list(run_trials(get_threads, [(0,)])) == [(0, "1")]
    assert os.environ["OMP_NUM_THREADS"] == "5"


def test_trials_of_killed_workers_run_again_until_they_use_up_their_attempts(
    tmp_path: Path, workers: dict
) -> None:
    arguments = [(0, 1), (1, 0), (2, 9), (3, 0), (4, 1)]

    ends = list(run_trials(kill, arguments, shared=(tmp_path,), attempts=2, **workers))

    assert len(ends) == 5
    results = dict(ends)
    lost = results.pop(2)
    assert isinstance(lost, LostTrial)
    assert (lost.index, lost.arguments, lost.attempts) == (2, (2, 9), 2)
    assert "2 workers that ran trial 2 (2, 9)" in str(lost)
    assert results == {0: 0, 1: 1, 3: 3, 4: 4}
    runs = [len((tmp_path / f"{seed}.runs").read_text()) for seed in range(5)]
    assert runs == [2, 1, 2, 1, 2]


def test_lost_trial_describes_how_its_last_worker_ended(tmp_path: Path) -> None:
    ((_, lost),) = run_trials(kill, [(0, 9)], shared=(tmp_path,), attempts=1)

    assert "status -9" in lost.cause


def test_error_of_this_package_ends_the_run_unchanged(workers: dict) -> None:
    with pytest.raises(DetectionError, match="No mug in trial") as caught:
        list(run_trials(fail, [(0,), (1,)], trials_per_worker=1, **workers))

    assert type(caught.value) is DetectionError
    assert caught.value.remedy == "Look elsewhere."
    assert "in fail" in caught.value.__notes__[0]


def test_other_exception_ends_the_run_with_its_text(workers: dict) -> None:
    with pytest.raises(RuntimeError, match="TypeError: cannot pickle"):
        list(run_trials(make_lock, SEEDS, **workers))


@pytest.mark.parametrize("name", ["jobs", "attempts", "trials_per_worker"])
def test_number_that_is_not_positive_is_rejected_at_once(name: str) -> None:
    with pytest.raises(InvalidValueError, match=f"{name} is 0"):
        run_trials(draw, SEEDS, **{name: 0})


def test_missing_ray_is_reported_with_the_command_that_installs_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)

    with pytest.raises(MissingDependencyError, match=r"pip install 'poil_drake\[cluster\]'"):
        list(run_trials(draw, SEEDS, ray_address="auto"))


@needs_ray
def test_address_without_a_cluster_is_rejected() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]

    with pytest.raises(InvalidValueError, match=f"The Ray cluster at '127.0.0.1:{port}'"):
        list(run_trials(draw, [(10.0, 0)], ray_address=f"127.0.0.1:{port}"))


@needs_ray
def test_run_leaves_no_connection_to_ray_behind(address: str) -> None:
    import ray

    handler = signal.getsignal(signal.SIGTERM)

    list(run_trials(os.path.basename, [("a/b",)], ray_address=address))

    assert not ray.is_initialized()
    assert signal.getsignal(signal.SIGTERM) is handler


@needs_ray
def test_existing_connection_to_ray_is_kept(address: str) -> None:
    import ray

    ray.init(address=address, log_to_driver=False)
    try:
        ends = list(run_trials(os.path.basename, [("a/b",)], ray_address=address))

        assert ends == [(0, "b")]
        assert ray.is_initialized()
    finally:
        ray.shutdown()


SCRIPT = """
import signal
from poil_drake.benchmarks.trials.pool import run_trials
from trial_functions import run_forever

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for _ in run_trials(run_forever, [(seed,) for seed in range(4)], jobs=2):
        pass
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_signal_to_the_run_ends_all_workers(tmp_path: Path, number: signal.Signals) -> None:
    script = tmp_path / "study.py"
    script.write_text(SCRIPT)
    paths = [str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")]
    run = subprocess.Popen(
        [sys.executable, str(script)],
        env={"PYTHONPATH": os.pathsep.join(paths)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert run.stdout is not None
    assert [run.stdout.readline() for _ in range(2)] == ["begun\n", "begun\n"]

    if number == signal.SIGINT:
        os.killpg(run.pid, number)  # As a terminal does.
    else:
        run.send_signal(number)

    # The workers write to the same pipes, which end only when every process that could write to
    # them has ended.
    output, errors = run.communicate()
    assert output == ""
    assert run.returncode == -number
    if number == signal.SIGINT:  # Printed by the run, not by its workers.
        assert errors.count("KeyboardInterrupt") == 1
