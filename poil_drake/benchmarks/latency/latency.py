"""Times a control tick: the field, its baseline on poses, and the whole control path."""

import gc
import os
import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from poil_drake.benchmarks.control.policies.se3_bcsdm import (
    PoseTrajectory,
    Se3BcsdmConfig,
    se3_bcsdm,
)
from poil_drake.benchmarks.latency.control_path import ControlPath
from poil_drake.control.field.point_set_bcsdm import BcsdmConfig, point_set_bcsdm
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, transform_points
from poil_drake.recording.mcap.plain_json import write_json
from poil_drake.reports.progress import OneLineTqdm

_POINTS, _SAMPLES = 10, 500

_BATCH = 1000
"""Number of states that the field computes at once."""

_WARM_UP = 50
"""Number of untimed ticks at the start, in which caches and libraries are set up."""

_STATES, _OUTLIERS = 64, 2
_NOISE = 1e-3
"""Standard deviation of the noise in each coordinate of a tracked point [m]."""

OFFSETS = {"near": (0.005, 3.0, 3.0), "far": (0.3, 60.0, 150.0)}
"""Offsets of states from the motion: distance [m], smallest and largest angle [deg]."""

BASELINE = "SE(3) BCSDM, PyTorch, 1 thread"
PATH = "control path: FK propagation, field, IK"


class Subject(NamedTuple):
    """A function to time.

    Attributes:
        name: Its name in the table.
        prepare: Returns the argument for a tick; not timed.
        run: The function that is timed.
    """

    name: str
    prepare: Callable[[int], Any]
    run: Callable[[Any], Any]


@dataclass(frozen=True)
class Row:
    """The durations of a subject.

    Attributes:
        name: Name of the subject.
        p50: Median [us].
        p99: 99th percentile [us].
        p99_9: 99.9th percentile [us].
        largest: Maximum [us].
        ratio: Ratio of the median to that of `BASELINE`.
    """

    name: str
    p50: float
    p99: float
    p99_9: float
    largest: float
    ratio: float


def run_latency_benchmark(*, ticks: int, json_path: Path) -> list[Row]:
    """Times all subjects, prints a table and writes it as JSON.

    In each tick the subjects run in a random order, so that other load on the machine affects all
    of them alike. Garbage is collected as in the closed loop, with all existing objects frozen.

    Args:
        ticks: Number of times that each subject is timed; batches of states are timed less often.
        json_path: JSON file for the results.
    """
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    subjects, batches = _subjects()
    _time([*subjects, *batches], _WARM_UP)
    gc.collect()
    gc.freeze()
    try:
        with OneLineTqdm(total=ticks, desc="ticks") as bar:
            durations = _time(subjects, ticks, bar)
        # By themselves, because they leave none of the others' data in the caches.
        per_state = _time(batches, max(ticks // 50, 1)) / _BATCH
    finally:
        gc.unfreeze()
        torch.set_num_threads(threads)
    columns = [*durations.T, *per_state.T]
    rows = summarize([subject.name for subject in (*subjects, *batches)], columns)
    figures = {"ticks": ticks, "machine": _machine(), "rows": [asdict(row) for row in rows]}
    write_json(figures, json_path)
    _print_table(rows)
    return rows


def summarize(names: Sequence[str], durations: Sequence[np.ndarray]) -> list[Row]:
    """Returns a row of percentiles for each subject, given its name and durations (T,) [s]."""
    percentiles = [np.percentile(1e6 * d, [50.0, 99.0, 99.9, 100.0]).tolist() for d in durations]
    baseline = percentiles[list(names).index(BASELINE)][0]
    return [
        Row(name, p50, p99, p99_9, largest, p50 / baseline)
        for name, (p50, p99, p99_9, largest) in zip(names, percentiles, strict=True)
    ]


def _time(subjects: Sequence[Subject], ticks: int, bar: OneLineTqdm | None = None) -> np.ndarray:
    """Returns the duration of each subject at each tick (ticks, len(subjects)) [s]."""
    random = np.random.default_rng(0)
    durations = np.empty((ticks, len(subjects)))
    for tick in range(ticks):
        for which in random.permutation(len(subjects)).tolist():
            subject = subjects[which]
            argument = subject.prepare(tick)
            start = time.perf_counter()
            subject.run(argument)
            durations[tick, which] = time.perf_counter() - start
        if bar is not None:
            bar.update()
    return durations


def _subjects() -> tuple[list[Subject], list[Subject]]:
    """Returns the subjects that compute one state, and those that compute `_BATCH` states."""
    import torch

    from poil_drake.benchmarks.latency.se3_bcsdm_torch import TorchSe3Bcsdm

    X_WO, reference, body_points = moving_body()
    states = {where: make_states(X_WO, body_points, where) for where in OFFSETS}
    subjects = []
    for test in ("rigidity", "velocity"):
        field = partial(
            point_set_bcsdm,
            reference=reference,
            config=BcsdmConfig(outlier_test=test),
            confidence=np.ones(_POINTS),
        )
        for where, some in states.items():
            for outliers, points in (("clean", some.clean), ("2 outliers", some.spoilt)):
                name = f"field, {test} test, {where}, {outliers}"
                subjects.append(Subject(name, partial(_cycle, points), field))
    field = partial(point_set_bcsdm, reference=reference, config=BcsdmConfig())
    batches = []
    for where, some in states.items():
        batch = np.resize(some.clean, (_BATCH, *some.clean.shape[1:]))
        name = f"field, {_BATCH} states at once, {where}, each"
        batches.append(Subject(name, partial(_cycle, [batch]), field))
    poses = np.concatenate([some.poses for some in states.values()])
    poses = np.random.default_rng(0).permutation(poses)
    pose_reference, config = PoseTrajectory.of(reference.times, X_WO), Se3BcsdmConfig()
    numpy_field = partial(se3_bcsdm, reference=pose_reference, config=config)
    torch_field, tensors = TorchSe3Bcsdm(pose_reference, config), torch.tensor(poses)[:, None]
    path = ControlPath(num_points=_POINTS, num_samples=_SAMPLES)
    subjects += [
        Subject("SE(3) BCSDM, NumPy", partial(_cycle, poses), numpy_field),
        Subject(BASELINE, partial(_cycle, tensors), torch_field),
        Subject(PATH, lambda tick: path.prepare(), lambda _: path.step()),
    ]
    return subjects, batches


def moving_body() -> tuple[np.ndarray, PointTrajectory, np.ndarray]:
    """Returns a body's motion in 4 s: a turn by 115 degrees on a curved path of half a metre.

    Returns:
        X_WO: (T, 4, 4) poses of the body at the times of `reference`.
        reference: The motion of its points.
        points: (N, 3) the points in the body's frame, within 4 cm along each axis [m].
    """
    times = np.linspace(0.0, 4.0, _SAMPLES)
    s = np.sin(0.5 * np.pi * times / times[-1])[:, None]
    axis = np.array([0.36, -0.48, 0.8])
    path = np.hstack([0.4 * s, 0.1 * np.sin(3.0 * s), 0.2 * s**2])
    X_WO = make_transform(rotation_exp(2.0 * s * axis), path)
    points = np.random.default_rng(1).uniform(-0.04, 0.04, (_POINTS, 3))
    positions = transform_points(X_WO, points)
    velocities = np.gradient(positions, times, axis=0)
    velocities[-1] = 0.0
    return X_WO, PointTrajectory(times, positions, velocities), points


class States(NamedTuple):
    """S states of the body.

    Attributes:
        poses: (S, 4, 4) poses of the body.
        clean: (S, N, 3) its points with a tracker's noise [m].
        spoilt: (S, N, 3) the same, but with two of the points 5 to 10 cm off [m].
    """

    poses: np.ndarray
    clean: np.ndarray
    spoilt: np.ndarray


def make_states(X_WO: np.ndarray, points: np.ndarray, where: str) -> States:
    """Returns states of a body with points (N, 3), off a motion (T, 4, 4) by `OFFSETS[where]`."""
    distance, smallest, largest = OFFSETS[where]
    random = np.random.default_rng(2)
    base = X_WO[random.integers(len(X_WO), size=_STATES)]
    angle = np.radians(random.uniform(smallest, largest, (_STATES, 1)))
    turns = Rotation.from_rotvec(angle * _directions(random, _STATES)).as_matrix()
    shifts = distance * _directions(random, _STATES)
    poses = make_transform(turns @ base[:, :3, :3], base[:, :3, 3] + shifts)
    clean = transform_points(poses, points)
    clean = clean + random.normal(scale=_NOISE, size=clean.shape)
    spoilt = clean.copy()
    for state in spoilt:
        which = random.choice(len(points), _OUTLIERS, replace=False)
        offsets = random.uniform(0.05, 0.1, (_OUTLIERS, 1))
        state[which] += offsets * _directions(random, _OUTLIERS)
    return States(poses, clean, spoilt)


def _directions(random: np.random.Generator, count: int) -> np.ndarray:
    v = random.normal(size=(count, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def _cycle(states: Any, tick: int) -> Any:
    return states[tick % len(states)]


def _machine() -> dict[str, Any]:
    import torch

    lines = Path("/proc/cpuinfo").read_text().splitlines()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return {
        "processor": names[0] if names else platform.processor(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "torch": torch.__version__,
    }


def _print_table(rows: Sequence[Row]) -> None:
    width = max(len(row.name) for row in rows)
    print(f"{'[us]':{width}s} {'p50':>8s} {'p99':>8s} {'p99.9':>8s} {'largest':>8s}   ratio")
    for row in rows:
        numbers = " ".join(f"{x:8.1f}" for x in (row.p50, row.p99, row.p99_9, row.largest))
        print(f"{row.name:{width}s} {numbers} {row.ratio:7.3f}")
    print(f"ratio: median over that of '{BASELINE}'")
