"""How long a control tick takes: the field, its rival on poses, and the whole control path."""

import gc
import os
import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from poil_drake.benchmarks.control.policies.se3_bcsdm import (
    PoseTrajectory,
    Se3BcsdmConfig,
    se3_bcsdm,
)
from poil_drake.benchmarks.latency.control_path import ControlPath
from poil_drake.benchmarks.latency.states import States, moving_body
from poil_drake.control.field.point_set_bcsdm import BcsdmConfig, point_set_bcsdm
from poil_drake.recording.mcap.plain_json import write_json
from poil_drake.reports.progress import OneLineTqdm

_POINTS, _SAMPLES = 10, 500
_WARM_UP = 50
"""How often everything is run before it is timed: caches and libraries are set up then."""

BASELINE = "SE(3) BCSDM, PyTorch, 1 thread"
PATH = "control path: FK propagation, field, IK"


@dataclass(frozen=True)
class Subject:
    """What is timed.

    Attributes:
        name: What to call it.
        prepare: Returns the input of a tick; not timed.
        run: What is timed.
    """

    name: str
    prepare: Callable[[int], Any]
    run: Callable[[Any], Any]


@dataclass(frozen=True)
class Row:
    """How long a subject took.

    Attributes:
        name: The subject.
        p50: Median [us].
        p99: 99th percentile [us].
        p99_9: 99.9th percentile [us].
        largest: The largest of all [us].
        ratio: Its median over the baseline's, `BASELINE`.
    """

    name: str
    p50: float
    p99: float
    p99_9: float
    largest: float
    ratio: float


def run_latency_benchmark(*, ticks: int, json_path: Path) -> list[Row]:
    """Times everything in turn, tick by tick, prints a table and writes it as JSON.

    All but one take their turns within each tick, in an order drawn anew, so that whatever else
    the machine does hits all alike. PyTorch with more threads is timed in a second round of them
    all, as its threads stay busy for a while after each call and would slow down who comes next.
    Garbage is collected as in the closed loop: what was there before is frozen.

    Args:
        ticks: How often each is timed.
        json_path: Where the figures go.
    """
    alike, threaded = _subjects()
    subjects = [*alike, *threaded]
    _time(subjects, _WARM_UP)
    gc.collect()
    gc.freeze()
    try:
        with OneLineTqdm(total=2 * ticks, desc="ticks") as bar:
            durations = _time(alike, ticks, bar)
            second = _time(subjects, ticks, bar)
    finally:
        gc.unfreeze()
    durations = np.hstack([durations, second[:, len(alike) :]])
    rows = summarize([subject.name for subject in subjects], durations)
    figures = {"ticks": ticks, "machine": _machine(), "rows": [asdict(row) for row in rows]}
    write_json(figures, json_path)
    print(_table(rows))
    return rows


def summarize(names: Sequence[str], durations: np.ndarray) -> list[Row]:
    """Returns the percentiles of durations (ticks, len(names)) [s]."""
    microseconds = 1e6 * durations
    percentiles = np.percentile(microseconds, [50.0, 99.0, 99.9, 100.0], axis=0).T.tolist()
    baseline = percentiles[list(names).index(BASELINE)][0]
    return [
        Row(name, p50, p99, p99_9, largest, p50 / baseline)
        for name, (p50, p99, p99_9, largest) in zip(names, percentiles, strict=True)
    ]


def _time(subjects: Sequence[Subject], ticks: int, bar: OneLineTqdm | None = None) -> np.ndarray:
    """Returns how long each subject took at each tick (ticks, len(subjects)) [s]."""
    random = np.random.default_rng(0)
    durations = np.empty((ticks, len(subjects)))
    for tick in range(ticks):
        for which in random.permutation(len(subjects)).tolist():
            subject = subjects[which]
            given = subject.prepare(tick)
            start = time.perf_counter()
            subject.run(given)
            durations[tick, which] = time.perf_counter() - start
        if bar is not None:
            bar.update()
    return durations


def _subjects() -> tuple[list[Subject], list[Subject]]:
    """Returns what is timed in the first round, and what joins in the second."""
    times, X_WO, reference, body_points = moving_body(num_points=_POINTS, num_samples=_SAMPLES)
    states = {
        "near": States.near(X_WO, body_points),
        "far": States.far(X_WO, body_points),
    }
    fields = []
    for test in ("rigidity", "velocity"):
        config = BcsdmConfig(outlier_test=test)
        for where, some in states.items():
            for outliers, points in (("clean", some.clean), ("2 outliers", some.spoilt)):

                def prepare(tick: int, points: np.ndarray = points) -> np.ndarray:
                    return points[tick % len(points)]

                def run(points: np.ndarray, config: BcsdmConfig = config) -> None:
                    point_set_bcsdm(points, reference, config, confidence)

                fields.append(Subject(f"field, {test} test, {where}, {outliers}", prepare, run))
    confidence = np.ones(_POINTS)
    poses = np.concatenate([some.poses for some in states.values()])
    path = ControlPath(num_points=_POINTS, num_samples=_SAMPLES)
    *alike, threaded = _pose_subjects(PoseTrajectory.of(times, X_WO), poses)
    step = Subject(PATH, lambda tick: path.prepare(), lambda given: path.step())
    return [*fields, *alike, step], [threaded]


def _pose_subjects(reference: PoseTrajectory, poses: np.ndarray) -> list[Subject]:
    """Returns the rivals, at poses (S, 4, 4); the one with PyTorch's own threads comes last."""
    import torch

    from poil_drake.benchmarks.control.policies.se3_bcsdm_torch import TorchSe3Bcsdm

    config = Se3BcsdmConfig()
    order = np.random.default_rng(0).permutation(len(poses))
    field = TorchSe3Bcsdm(reference, config)
    batches = torch.tensor(poses[order])[:, None]
    threads = torch.get_num_threads()

    def with_threads(count: int) -> Callable[[int], Any]:
        def prepare(tick: int) -> torch.Tensor:
            torch.set_num_threads(count)
            return batches[tick % len(batches)]

        return prepare

    return [
        Subject(
            "SE(3) BCSDM, NumPy",
            lambda tick: poses[order[tick % len(poses)]],
            lambda X_WO: se3_bcsdm(X_WO, reference, config),
        ),
        Subject(BASELINE, with_threads(1), field),
        Subject(f"SE(3) BCSDM, PyTorch, default threads ({threads})", with_threads(threads), field),
    ]


def _machine() -> dict[str, Any]:
    import torch

    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "torch": torch.__version__,
    }


def _processor() -> str:
    """Returns the processor's name where Linux tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()


def _table(rows: Sequence[Row]) -> str:
    width = max(len(row.name) for row in rows)
    lines = [f"{'[us]':{width}s} {'p50':>8s} {'p99':>8s} {'p99.9':>8s} {'largest':>8s}   ratio"]
    for row in rows:
        numbers = " ".join(f"{x:8.1f}" for x in (row.p50, row.p99, row.p99_9, row.largest))
        lines.append(f"{row.name:{width}s} {numbers} {row.ratio:7.3f}")
    return "\n".join([*lines, f"ratio: median over that of '{BASELINE}'"])
