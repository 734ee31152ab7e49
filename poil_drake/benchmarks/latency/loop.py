"""Measures where a simulated run spends its time: per stage and per system."""

import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any

from pydrake.systems.framework import LeafSystem

from poil_drake.diagrams.run.output_paths import OutputPaths
from poil_drake.diagrams.run.skill_run import RunSkill
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.recording.mcap.plain_json import write_json

_DECLARATIONS = (
    "DeclareAbstractOutputPort",
    "DeclareInitializationPublishEvent",
    "DeclarePeriodicDiscreteUpdateEvent",
    "DeclarePeriodicPublishEvent",
    "DeclarePeriodicUnrestrictedUpdateEvent",
    "DeclareVectorOutputPort",
)


def run_loop_benchmark(*, scenario: Scenario, json_path: Path) -> dict[str, Any]:
    """Runs the whole job once, prints where its time went, and writes that as JSON.

    Args:
        scenario: The station and the task.
        json_path: JSON file for the results.

    Returns:
        What the file holds: `simulated` [s], `wall` [s], `real_time_factor`; and durations [s]: of
        the job's `stages`; of the loop's `parts`, which add up to `wall`; of `concurrent` work in
        other processes; and of the Python code of the job's `systems`, by class, nearly all of it
        in the loop, where "Drake" is the rest of `wall`.
    """
    with tempfile.TemporaryDirectory() as folder, timed_systems() as systems:
        outputs = OutputPaths.under(Path(folder))
        summary = RunSkill(scenario, outputs=outputs, show=True)
    timing = summary.timing
    split = {
        "stages": dict(timing.stages),
        "parts": dict(timing.parts),
        "concurrent": dict(timing.concurrent),
        "systems": systems | {"Drake": timing.wall - sum(systems.values())},
    }
    figures = {
        "success": summary.success,
        "simulated": timing.simulated,
        "wall": timing.wall,
        "real_time_factor": timing.real_time_factor,
        **split,
    }
    write_json(figures, json_path)
    print(
        f"{timing.simulated:.1f} s simulated in {timing.wall:.1f} s "
        f"({timing.real_time_factor:.2f}x real time)"
    )
    for title, durations in split.items():
        print(f"{title:34s} {'[s]':>7s}  share of the loop")
        for name, spent in sorted(durations.items(), key=lambda item: -item[1]):
            print(f"  {name:32s} {spent:7.2f}  {100.0 * spent / timing.wall:5.1f} %")
    return figures


@contextmanager
def timed_systems() -> Iterator[dict[str, float]]:
    """Times the callbacks of all LeafSystems in Python that are constructed in the `with` block.

    Yields:
        The time [s] that each class of systems has spent so far in its events and output ports. It
        leaves out the time of other systems whose outputs these evaluate.
    """
    spent: dict[str, float] = defaultdict(float)
    inner = [0.0]

    def timed(name: str, callback: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any) -> Any:
            inner.append(0.0)
            start = time.perf_counter()
            try:
                return callback(*args)
            finally:
                duration = time.perf_counter() - start
                spent[name] += duration - inner.pop()
                inner[-1] += duration

        return call

    def declaring(declare: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(declare)
        def wrapper(system: LeafSystem, *args: Any, **kwargs: Any) -> Any:
            # The callback is the last function; an abstract port's first one allocates its value.
            last = max((k for k, value in enumerate(args) if callable(value)), default=None)
            if last is not None:
                name = type(system).__name__
                args = (*args[:last], timed(name, args[last]), *args[last + 1 :])
            return declare(system, *args, **kwargs)

        return wrapper

    originals = {name: getattr(LeafSystem, name) for name in _DECLARATIONS}
    try:
        for name, declare in originals.items():
            setattr(LeafSystem, name, declaring(declare))
        yield spent
    finally:
        for name, declare in originals.items():
            setattr(LeafSystem, name, declare)
