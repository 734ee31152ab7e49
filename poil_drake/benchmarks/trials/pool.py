"""Runs the independent trials of a study in parallel, on this machine or on a Ray cluster."""

import pickle
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import as_completed
from contextlib import closing
from dataclasses import dataclass
from typing import Any, TypeVar

from poil_drake.benchmarks.trials.workers import ClusterWorkers, ProcessWorkers
from poil_drake.errors import InvalidValueError

Result = TypeVar("Result")


@dataclass(frozen=True)
class LostTrial:
    """Replaces the result of a trial whose workers were all killed.

    Attributes:
        index: Index of the trial.
        arguments: Its arguments.
        attempts: Number of workers that ran it.
        cause: How the last worker ended.
    """

    index: int
    arguments: tuple[Any, ...]
    attempts: int
    cause: str

    def __str__(self) -> str:
        return (
            f"all {self.attempts} workers that ran trial {self.index} {self.arguments!r} "
            f"ended before the trial was done; the last worker failed with {self.cause}"
        )


def run_trials(
    function: Callable[..., Result],
    arguments: Sequence[tuple[Any, ...]],
    *,
    shared: tuple[Any, ...] = (),
    jobs: int = 1,
    ray_address: str | None = None,
    attempts: int = 3,
    trials_per_worker: int | None = None,
) -> Generator[tuple[int, Result | LostTrial], None, None]:
    """Runs `function(*shared, *arguments[i])` for every i, and yields results as they arrive.

    The result of a trial depends only on its arguments, provided that `function` draws its random
    numbers from a seed among them. The number of workers affects only the order in which trials
    end. Each worker computes on one core.

    If a worker dies, because it runs out of memory, crashes in a library or is killed, its trial
    runs again after all others. A trial that has used up `attempts` workers is yielded as a
    `LostTrial`. Other trials are not affected.

    An exception in `function` ends the run. The generator raises it as soon as its trial ends:
    unchanged if it is a `PoilError`, otherwise as a RuntimeError. To let other trials continue,
    `function` must return its failure. No worker is left behind when the run ends, be it by an
    exception, by a signal, or because the generator is closed.

    Args:
        function: A function of a module that workers can import, or of the script itself. Arguments
            and results must be picklable. A worker runs many trials, so a function can cache what
            is expensive to create in its module (`functools.cache`).
        arguments: Arguments of each trial. A path among them must lead to the same file for every
            worker, even on a cluster.
        shared: First arguments of all trials. They may be large: each worker receives them once.
        jobs: Number of worker processes on this machine. A cluster runs one worker per CPU; a
            cluster that is started here has `jobs` CPUs.
        ray_address: None for processes on this machine. Otherwise the address of a Ray cluster on
            whose machines this package is installed: "auto" (this machine's cluster), "HOST:PORT",
            "ray://HOST:10001", or "local", which starts a cluster on this machine.
        attempts: Number of workers that a trial may use up.
        trials_per_worker: Number of trials after which a worker is replaced by a new process, so
            that a trial cannot disturb later ones; None for never.

    Yields:
        index: Index of the trial.
        result: The return value of `function`, or a `LostTrial`.

    Raises:
        InvalidValueError: if `jobs`, `attempts` or `trials_per_worker` is not positive, or no
            cluster answers at `ray_address`.
        MissingDependencyError: if `ray_address` is given and Ray is not installed.
    """
    limits = {"jobs": jobs, "attempts": attempts, "trials_per_worker": trials_per_worker}
    for name, value in limits.items():
        if value is not None and value < 1:
            raise InvalidValueError(f"{name} is {value}, not positive.", remedy="Use 1 or more.")

    def run() -> Generator[tuple[int, Any], None, None]:
        waiting = list(range(len(arguments)))
        workers: ProcessWorkers | ClusterWorkers
        if ray_address is None:
            workers = ProcessWorkers(function, shared, jobs, trials_per_worker)
        else:
            workers = ClusterWorkers(function, shared, ray_address, jobs, trials_per_worker)
        with closing(workers):
            for attempt in range(1, attempts + 1):
                running = {workers.submit(arguments[index]): index for index in waiting}
                waiting = []
                for future in as_completed(list(running)):
                    index = running.pop(future)
                    try:
                        result, error, trace = pickle.loads(future.result())
                    except workers.worker_lost as lost:
                        if attempt < attempts:
                            waiting.append(index)
                            continue
                        cause = f"{type(lost).__name__}: {lost}"
                        result, error = LostTrial(index, arguments[index], attempts, cause), None
                    if error is not None:
                        error.add_note(f"Raised in trial {index}:\n{trace}")
                        raise error
                    yield index, result

    return run()
