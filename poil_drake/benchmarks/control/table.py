"""Table II of POIL, measured and as published."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest

from poil_drake.benchmarks.control.arena.tasks import TASKS, MakeTask
from poil_drake.benchmarks.control.policies.policies import ROWS
from poil_drake.benchmarks.control.trial import ControlTrial

_WIDTH = 13


@dataclass(frozen=True, kw_only=True)
class Cell:
    """The results of one policy in one region of one task.

    Attributes:
        task: Name of the task.
        region: Region of the starts.
        policy: Name of the policy.
        trials: Number of trials.
        successes: Number of successes by the paper's criterion.
        clean: Number of successes without a collision.
        success_interval: 95 % Wilson interval of the rate of success.
        clean_interval: 95 % Wilson interval of the rate of success without a collision.
        error: Median of the final distance from the goal, by the task's criterion [m].
        time: Median of the simulated time [s].
        strains: 5th, 50th and 95th percentile of `ControlTrial.strain` over the successes.
        typical_strain: Median of `ControlTrial.typical_strain` over the successes.
    """

    task: str
    region: str
    policy: str
    trials: int
    successes: int
    clean: int
    success_interval: tuple[float, float]
    clean_interval: tuple[float, float]
    error: float
    time: float
    strains: tuple[float, ...]
    typical_strain: float


def summarize(trials: Sequence[ControlTrial]) -> list[Cell]:
    """Returns the results of each policy in each region of each task."""
    groups: dict[tuple[str, str, str], list[ControlTrial]] = {}
    for trial in trials:
        groups.setdefault((trial.task, trial.region, trial.policy), []).append(trial)
    cells = []
    for (task, region, policy), group in groups.items():
        successes = sum(trial.success for trial in group)
        clean = sum(trial.success and trial.collision_free for trial in group)
        cells.append(
            Cell(
                task=task,
                region=region,
                policy=policy,
                trials=len(group),
                successes=successes,
                clean=clean,
                success_interval=wilson_interval(successes, len(group)),
                clean_interval=wilson_interval(clean, len(group)),
                error=_median([trial.error for trial in group]),
                time=_median([trial.time for trial in group]),
                strains=_percentiles([trial.strain for trial in group if trial.success]),
                typical_strain=_median([t.typical_strain for t in group if t.success]),
            )
        )
    return cells


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """Returns the 95 % Wilson score interval of a rate."""
    low, high = binomtest(successes, trials).proportion_ci(0.95, method="wilson")
    return float(low), float(high)


def print_tables(trials: Sequence[ControlTrial]) -> None:
    """Prints success beside the paper's figures, success without collisions, and hard mode."""
    cells = {(cell.task, cell.region, cell.policy): cell for cell in summarize(trials)}
    tasks = [name for name in TASKS if any(key[0] == name for key in cells)]
    for title, clean in (
        ("Success by the paper's criterion", False),
        ("Success without any collision on the way", True),
    ):
        print(f"\n{title} [%], 95 % Wilson interval" + ("" if clean else " (paper's figure)"))
        print("\n".join(table_lines(cells, tasks, ("near", "far"), clean=clean)))
    if any(key[1] == "hard" for key in cells):
        print("\nHard mode, success | without any collision [%], 95 % Wilson interval")
        print("\n".join(table_lines(cells, tasks, ("hard",), clean=False)))
        for line in table_lines(cells, tasks, ("hard",), clean=True)[1:]:
            print(line + "   collision-free")
    lost = [trial for trial in trials if trial.lost]
    if lost:
        one = lost[0]
        print(
            f"\nTrials that ended in an error and count as failures: {len(lost)}. The first is "
            f"{one.task} {one.region} {one.policy} {one.trial}: {one.note}"
        )
    _print_strains([cell for cell in cells.values() if not MakeTask(cell.task).rigid])


def _print_strains(cells: Sequence[Cell]) -> None:
    if cells:
        print(
            "\nStrain between the bag's points in successful trials [%]: largest of all pairs and "
            "times (5th, 50th, 95th percentile of the trials) | median pair at its largest"
        )
    for cell in cells:
        low, middle, high = (100.0 * value for value in cell.strains)
        typical = 100.0 * cell.typical_strain
        name = f"{cell.policy} {cell.region}"
        print(f"{name:<36}{low:6.1f}{middle:6.1f}{high:6.1f} |{typical:6.1f}")


def table_lines(
    cells: dict[tuple[str, str, str], Cell],
    tasks: Sequence[str],
    regions: Sequence[str],
    *,
    clean: bool,
) -> list[str]:
    """Returns the lines of a table with a row for each policy.

    Args:
        cells: Results by task, region and policy.
        tasks: Names of the tasks, in the order of the columns.
        regions: Regions of the starts. Each task has a column for each region.
        clean: Whether collisions count as failures. If so, the paper's figures are left out.
    """
    columns = [(task, region) for task in tasks for region in regions]
    heads = [f"{MakeTask(task).title} {region}" for task, region in columns]
    width = max(_WIDTH + (0 if clean else 6), *(len(head) + 1 for head in heads))
    lines = [" " * 36 + "".join(f"{head:>{width}}" for head in heads)]
    for row in ROWS:
        entries = [cells.get((task, region, row.name)) for task, region in columns]
        if not any(entries):
            continue
        texts = []
        for (task, region), cell in zip(columns, entries, strict=True):
            text = "-" if cell is None else _entry(cell, clean)
            published = MakeTask(task).paper.get(row.paper)
            if published is not None and not clean and region != "hard":
                text += f" ({published[region == 'far']:d})"
            texts.append(f"{text:>{width}}")
        lines.append(f"{row.title:<28}{row.demonstrations:>3} demo" + "".join(texts))
    if not clean and "near" in regions:
        cited = [MakeTask(task).paper["ip_1"][region == "far"] for task, region in columns]
        texts = [f"{f'({value:d})':>{width}}" for value in cited]
        lines.append(f"{'Instant Policy, as published':<28}{1:>3} demo" + "".join(texts))
    return lines


def _entry(cell: Cell, clean: bool) -> str:
    count = cell.clean if clean else cell.successes
    low, high = cell.clean_interval if clean else cell.success_interval
    return f"{100 * count / cell.trials:.0f} [{100 * low:.0f}-{100 * high:.0f}]"


def _median(values: Sequence[float]) -> float:
    finite = [value for value in values if np.isfinite(value)]
    return float(np.median(finite)) if finite else np.nan


def _percentiles(values: Sequence[float]) -> tuple[float, ...]:
    return tuple(np.percentile(values, (5, 50, 95)).tolist()) if values else (np.nan,) * 3
