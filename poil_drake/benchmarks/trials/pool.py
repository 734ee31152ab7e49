"""Independent trials of a study, side by side: on processes of this machine or on a Ray cluster."""

from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from poil_drake.benchmarks.trials.workers import ProcessWorkers, WorkerKilled
from poil_drake.errors import InvalidValueError

Result = TypeVar("Result")


@dataclass(frozen=True)
class LostTrial:
    """In place of the result of a trial whose every worker was killed.

    Attributes:
        index: Which of the trials.
        arguments: Its arguments.
        attempts: How many workers it was given.
        cause: How the last of them ended.
    """

    index: int
    arguments: tuple[Any, ...]
    attempts: int
    cause: str

    def __str__(self) -> str:
        return (
            f"Each of the {self.attempts} workers that ran trial {self.index} {self.arguments!r} "
            f"ended too soon; the last one {self.cause}."
        )


class TrialWorkers(Protocol):
    """What runs trials. It counts nothing and repeats nothing."""

    def has_room(self) -> bool:
        """Returns whether one more trial may be started."""

    def start(self, index: int, arguments: tuple[Any, ...]) -> None:
        """Starts a trial."""

    def next_end(self) -> tuple[int, Any]:
        """Waits until a trial ends; returns which, and its result or a `WorkerKilled`.

        Raises:
            Exception: what the trial raised.
        """

    def close(self) -> None:
        """Ends all workers, whatever they do."""


def run_trials(
    function: Callable[..., Result],
    arguments: Sequence[tuple[Any, ...]],
    *,
    shared: tuple[Any, ...] = (),
    jobs: int = 1,
    ray_address: str | None = None,
    attempts: int = 3,
    trials_per_worker: int | None = None,
) -> Iterator[tuple[int, Result | LostTrial]]:
    """Runs `function(*shared, *arguments[i])` for every i, and yields what comes back as it comes.

    What a trial returns depends on its arguments alone, as long as `function` draws its random
    numbers from a seed among them: how many workers there are, and which, only decides the order in
    which the trials end. Each worker computes on one core.

    A worker that is killed (by the system for its memory, by a crash of a library, by anybody)
    loses nothing: its trial is run again, after those that still wait. A trial that has used up
    `attempts` workers is yielded as a `LostTrial`; its neighbours are not concerned.

    An exception that `function` raises is raised here as soon as it is known, and ends the run: a
    trial that may fail returns its failure. However the run ends, by an exception, by a signal
    or because the iterator is closed, no worker is left behind.

    Args:
        function: Of a module, so that workers can import it; arguments and results are what pickle
            can carry. A worker serves many trials, so what is dear to make can be kept in the
            module (`functools.cache`).
        arguments: Of each trial. A path among them must lead to the same file for every worker, on
            a cluster too.
        shared: The first arguments of all trials. They may be big: each worker gets them once.
        jobs: How many processes of this machine work side by side. A cluster has as many as CPUs;
            one that is started here has `jobs` CPUs.
        ray_address: None for processes of this machine. Otherwise a Ray cluster whose machines have
            this package: "auto" (the one that this machine belongs to), "HOST:PORT",
            "ray://HOST:10001", or "local", which starts one on this machine.
        attempts: How many workers a trial may use up.
        trials_per_worker: After so many trials a worker is replaced by a fresh process, so that
            none can disturb later ones; None keeps it.

    Yields:
        index: Which trial.
        result: What it returned.

    Raises:
        InvalidValueError: if a number is not positive, or no cluster answers at the address.
        MissingDependencyError: if an address is given, and Ray is not installed.
    """
    numbers = {"jobs": jobs, "attempts": attempts, "trials_per_worker": trials_per_worker}
    for name, value in numbers.items():
        if value is not None and value < 1:
            raise InvalidValueError(f"{name} is {value}.", remedy="Pass a positive number.")
    if ray_address is None:
        return _run(
            lambda: ProcessWorkers(
                function, shared, count=jobs, trials_per_worker=trials_per_worker
            ),
            arguments,
            attempts,
        )
    from poil_drake.benchmarks.trials.cluster import ClusterWorkers

    return _run(
        lambda: ClusterWorkers(
            function, shared, address=ray_address, cpus=jobs, trials_per_worker=trials_per_worker
        ),
        arguments,
        attempts,
    )


def _run(
    make: Callable[[], TrialWorkers], arguments: Sequence[tuple[Any, ...]], attempts: int
) -> Iterator[tuple[int, Any]]:
    waiting = deque(range(len(arguments)))
    running: set[int] = set()
    killed: Counter[int] = Counter()

    def fill() -> None:
        while waiting and workers.has_room():
            index = waiting.popleft()
            workers.start(index, arguments[index])
            running.add(index)

    with closing(make()) as workers:
        fill()
        while running:
            index, end = workers.next_end()
            running.remove(index)
            if isinstance(end, WorkerKilled):
                killed[index] += 1
                if killed[index] < attempts:
                    waiting.append(index)
                    fill()
                    continue
                end = LostTrial(index, arguments[index], attempts, end.cause)
            fill()  # First, so that nobody is idle while the caller looks at the result.
            yield index, end
