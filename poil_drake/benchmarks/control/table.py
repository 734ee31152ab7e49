"""Table II of POIL, measured and as published."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest

from poil_drake.benchmarks.control.policies import ROWS
from poil_drake.benchmarks.control.tasks import TASKS, MakeTask
from poil_drake.benchmarks.control.trial import ControlTrial

_WIDTH = 13


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One policy in one region of one task.

    Attributes:
        task: Its name.
        region: Where the trials started.
        policy: Who was in control.
        trials: How many.
        successes: By the paper's criterion.
        clean: Of these, without a collision.
        success_interval: 95 % Wilson interval of the rate of success.
        clean_interval: The same of success without a collision.
        error: Median of what the criterion looks at, in the end [m].
        time: Median of the simulated time [s].
        strain: Median of the largest strain between the points.
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
    strain: float


def summarize(trials: Sequence[ControlTrial]) -> list[Cell]:
    """Returns the figures of each policy in each region of each task."""
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
                strain=_median([trial.strain for trial in group]),
            )
        )
    return cells


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """Returns the 95 % Wilson score interval of a rate."""
    interval = binomtest(successes, trials).proportion_ci(0.95, method="wilson")
    return float(interval.low), float(interval.high)


def print_tables(trials: Sequence[ControlTrial]) -> None:
    """Prints success and collision-free success beside the paper's figures, then hard mode."""
    cells = {(cell.task, cell.region, cell.policy): cell for cell in summarize(trials)}
    tasks = [name for name in TASKS if any(key[0] == name for key in cells)]
    for title, clean in (
        ("Success by the paper's criterion", False),
        ("Success without any collision on the way", True),
    ):
        print(f"\n{title} [%], 95 % Wilson interval" + ("" if clean else " (paper's figure)"))
        for line in table_lines(cells, tasks, ("near", "far"), clean=clean):
            print(line)
    if any(key[1] == "hard" for key in cells):
        print("\nHard mode, success | without any collision [%], 95 % Wilson interval")
        for line in table_lines(cells, tasks, ("hard",), clean=False):
            print(line)
        for line in table_lines(cells, tasks, ("hard",), clean=True)[1:]:
            print(line + "   collision-free")
    strains = [trial.strain for trial in trials if not MakeTask(trial.task).rigid and trial.success]
    if strains:
        low, middle, high = (100 * np.nanpercentile(strains, q) for q in (5, 50, 95))
        print(
            f"\nLargest strain between the bag's points, successful trials: median {middle:.1f} %, "
            f"5th and 95th percentile {low:.1f} and {high:.1f} %"
        )


def table_lines(
    cells: dict[tuple[str, str, str], Cell],
    tasks: Sequence[str],
    regions: Sequence[str],
    *,
    clean: bool,
) -> list[str]:
    """Returns the lines of a table with a row for each policy.

    Args:
        cells: By task, region and policy.
        tasks: In the order of the columns.
        regions: Of each task.
        clean: Whether collisions count as failures; the paper has no such figures.
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
    known = [value for value in values if np.isfinite(value)]
    return float(np.median(known)) if known else float("nan")
