"""Trials on processes of this machine: nothing is lost, doubled or left behind."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from trial_functions import drawn, killed, process, threads, undetected, unreadable, unwritable

from poil_drake.benchmarks.trials.pool import LostTrial, run_trials
from poil_drake.errors import DetectionError, InvalidValueError, MissingDependencyError

SEEDS = [(seed,) for seed in range(7)]


@pytest.mark.parametrize("jobs", [1, 2, 3])
def test_results_do_not_depend_on_the_number_of_workers(jobs: int) -> None:
    ends = list(run_trials(drawn, SEEDS, shared=(10.0,), jobs=jobs))

    assert len(ends) == len(SEEDS)
    assert dict(ends) == {seed: drawn(10.0, seed) for (seed,) in SEEDS}


def test_without_trials_there_is_no_result() -> None:
    assert list(run_trials(drawn, [])) == []


def test_a_worker_serves_many_trials() -> None:
    processes = [pid for _, pid in run_trials(process, SEEDS)]

    assert len(set(processes)) == 1


def test_a_worker_is_replaced_after_its_share_of_trials() -> None:
    processes = [pid for _, pid in run_trials(process, SEEDS, trials_per_worker=3)]

    # One at a time: three, three and one.
    assert [processes.count(pid) for pid in dict.fromkeys(processes)] == [3, 3, 1]


def test_a_worker_computes_on_one_core_and_nobody_else_does(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "5")

    assert list(run_trials(threads, [(0,)])) == [(0, "1")]
    assert os.environ["OMP_NUM_THREADS"] == "5"


@pytest.mark.parametrize("jobs", [1, 2])
def test_the_trials_of_a_killed_worker_are_run_again(tmp_path: Path, jobs: int) -> None:
    arguments = [(seed, 1 if seed in (0, 3) else 0) for seed in range(6)]

    ends = list(run_trials(killed, arguments, shared=(tmp_path,), jobs=jobs))

    assert sorted(ends) == [(seed, seed) for seed in range(6)]
    runs = [len((tmp_path / f"{seed}.runs").read_text()) for seed in range(6)]
    assert runs == [2, 1, 1, 2, 1, 1]


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_trial_that_kills_every_worker_is_named_and_concerns_no_other(
    tmp_path: Path, jobs: int
) -> None:
    arguments = [(seed, 9 if seed == 1 else 0) for seed in range(5)]

    ends = dict(run_trials(killed, arguments, shared=(tmp_path,), jobs=jobs, attempts=2))

    lost = ends.pop(1)
    assert lost == LostTrial(1, (1, 9), attempts=2, cause="was killed by SIGKILL")
    assert "trial 1 (1, 9)" in str(lost)
    assert ends == {0: 0, 2: 2, 3: 3, 4: 4}
    runs = [len((tmp_path / f"{seed}.runs").read_text()) for seed in range(5)]
    assert runs == [1, 2, 1, 1, 1]


def test_an_exception_comes_through_as_it_was_raised_and_with_its_place() -> None:
    with pytest.raises(DetectionError, match="No mug in trial") as caught:
        list(run_trials(undetected, SEEDS, jobs=2))

    assert caught.value.remedy == "Look elsewhere."
    assert "in undetected" in caught.value.__notes__[0]


def test_an_exception_that_cannot_cross_comes_as_its_text() -> None:
    with pytest.raises(RuntimeError, match="UnreadableError: strange trouble"):
        list(run_trials(unreadable, SEEDS))


def test_a_result_that_cannot_cross_says_so() -> None:
    with pytest.raises(TypeError, match="pickle"):
        list(run_trials(unwritable, SEEDS))


@pytest.mark.parametrize("name", ["jobs", "attempts", "trials_per_worker"])
def test_a_number_that_is_not_positive_is_refused_at_once(name: str) -> None:
    with pytest.raises(InvalidValueError, match=f"{name} is 0"):
        run_trials(drawn, SEEDS, **{name: 0})


def test_without_ray_it_is_told_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)

    with pytest.raises(MissingDependencyError, match=r"pip install 'poil_drake\[cluster\]'"):
        list(run_trials(drawn, SEEDS, ray_address="auto"))


SCRIPT = """
import signal
from poil_drake.benchmarks.trials.pool import run_trials
from trial_functions import endless

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for _ in run_trials(endless, [(seed,) for seed in range(4)], jobs=2):
        pass
"""


FIRST = """
import signal
from poil_drake.benchmarks.trials.pool import run_trials
from trial_functions import blocked

if __name__ == "__main__":
    for _, found in run_trials(blocked, [(0,)], jobs=1):
        print(signal.SIGINT in found)
"""


def test_ctrl_c_does_not_reach_the_very_first_worker(tmp_path: Path) -> None:
    script = tmp_path / "study.py"
    script.write_text(FIRST)

    done = subprocess.run(
        [sys.executable, str(script)],
        env={"PYTHONPATH": str(Path(__file__).parent)},
        capture_output=True,
        text=True,
        check=True,
    )

    assert done.stdout == "True\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_however_the_run_is_stopped_no_worker_is_left(
    tmp_path: Path, number: signal.Signals
) -> None:
    script = tmp_path / "study.py"
    script.write_text(SCRIPT)
    run = subprocess.Popen(
        [sys.executable, str(script)],
        env={"PYTHONPATH": str(Path(__file__).parent)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert run.stdout is not None
    assert [run.stdout.readline() for _ in range(2)] == ["begun\n", "begun\n"]

    if number == signal.SIGINT:
        os.killpg(run.pid, number)  # As a terminal does: the workers get it, too.
    else:
        run.send_signal(number)

    # The workers write to the same pipes, which only end when all who could write have ended.
    output, errors = run.communicate()
    assert output == ""
    assert run.returncode == -number
    if number == signal.SIGINT:  # Told once, by the one who was asked to stop.
        assert errors.count("KeyboardInterrupt") == 1
