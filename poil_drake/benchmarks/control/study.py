"""The control study: who reaches the goal from where, over many trials (POIL, table II)."""

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from poil_drake.benchmarks.control.arena.arena import Arena
from poil_drake.benchmarks.control.arena.delayed_tracking import DelayedTracking, TrackingConfig
from poil_drake.benchmarks.control.arena.direct_actuation import Slip
from poil_drake.benchmarks.control.arena.tasks import MakeTask
from poil_drake.benchmarks.control.demonstration import NearDemonstrations, TaskDemonstration
from poil_drake.benchmarks.control.figures import write_figures
from poil_drake.benchmarks.control.pictures import draw_pictures
from poil_drake.benchmarks.control.point_policy.trained import TrainedPointPolicy
from poil_drake.benchmarks.control.point_policy.weight_cache import load_or_train
from poil_drake.benchmarks.control.policies.policies import LEARNED, OURS, ROWS, MakePolicy, Trained
from poil_drake.benchmarks.control.starts import (
    Region,
    distance_to_near,
    sample_start,
    trial_generator,
)
from poil_drake.benchmarks.control.study_config import ControlStudyConfig
from poil_drake.benchmarks.control.table import print_tables
from poil_drake.benchmarks.control.task_pictures import DrawTask
from poil_drake.benchmarks.control.trial import ControlTrial, RunTrial, TrialConfig
from poil_drake.benchmarks.trials.pool import LostTrial, run_trials
from poil_drake.errors import InvalidValueError
from poil_drake.reports.progress import OneLineTqdm

HARD_POLICIES = ("open_loop", "se3_bcsdm", "field", OURS)
"""Who is tried in hard mode; the pose that the second one is granted is exact there, too.

The learned ones are not: their demonstrations hold no other orientation than any yaw.
"""


@dataclass(frozen=True, kw_only=True)
class HardMode:
    """What makes a trial hard, besides a start in any orientation.

    Attributes:
        slip_start: Earliest and latest time at which the object begins to slip in the hand [s].
        slip_duration: How long that takes [s].
        slip_distance: How far it shifts [m].
        slip_angle: How far it turns [rad].
        tracking: How late and noisy the points are.
        trial: When a trial ends: not as soon as the noise lets the object rest for a moment.
    """

    slip_start: tuple[float, float] = (1.0, 3.0)
    slip_duration: float = 0.25
    slip_distance: float = 0.03
    slip_angle: float = np.radians(20.0)
    tracking: TrackingConfig = field(default_factory=TrackingConfig)
    trial: TrialConfig = field(
        default_factory=lambda: TrialConfig(settled_time=5.0, settled_motion=(0.4, 0.01))
    )


_HARD = HardMode()
_WRITING_PERIOD = 60.0  # Between two times that what is known so far is written [s].


def run_control_study(
    config: ControlStudyConfig,
    *,
    json_path: Path,
    pictures: Path | None = None,
    jobs: int = 1,
    ray_address: str | None = None,
) -> list[ControlTrial]:
    """Trains what is learned, runs all trials, prints the tables and writes the figures.

    Args:
        config: What is tried.
        json_path: Where the figures go; an interrupted study leaves what it knows.
        pictures: Folder for the pictures; None draws none.
        jobs: Processes of this machine.
        ray_address: A Ray cluster in their place; see `run_trials`.
    """
    if pictures is not None:
        pictures.mkdir(parents=True, exist_ok=True)
    trained = _train(config, jobs, ray_address)
    arguments = _arguments(config)
    found: list[ControlTrial | None] = [None] * len(arguments)

    def known() -> list[ControlTrial]:
        return [trial for trial in found if trial is not None]

    ends = run_trials(
        run_control_trial, arguments, shared=(trained,), jobs=jobs, ray_address=ray_address
    )
    hard = asdict(_HARD) if config.hard else None
    bar = OneLineTqdm(ends, total=len(arguments), desc="trials", smoothing=0.05)
    written = time.monotonic()
    try:
        for index, end in bar:
            if isinstance(end, LostTrial):
                end = _lost(arguments[index], str(end))
            found[index] = end
            if time.monotonic() - written > _WRITING_PERIOD:
                write_figures(known(), config, json_path, hard=hard)
                written = time.monotonic()
    finally:
        write_figures(known(), config, json_path, hard=hard)
    print_tables(known())
    if pictures is not None:
        draw_pictures(known(), pictures)
        _draw_tasks(config.tasks, pictures)
    return known()


def _draw_tasks(tasks: Sequence[str], folder: Path) -> None:
    for task in tasks:
        try:
            DrawTask(task, folder / f"control_task_{task}.png")
        except RuntimeError as error:
            tqdm.write(f"note: {task} could not be drawn: {' '.join(str(error).split())}")


def run_control_trial(
    trained: Trained, task: str, region: Region, policy: str, trial: int, seed: int = 0
) -> ControlTrial:
    """Runs one trial; what it draws depends on task, region, number and seed alone.

    A trial in which something fails counts as no success, with the reason as its note.
    """
    rng = trial_generator(task, region, trial, seed=seed)
    hard, start = region == "hard", None
    try:
        arena, shown = _arena(trained, task, policy, hard), TaskDemonstration(task)
        context = arena.diagram.CreateDefaultContext()
        start = sample_start(arena, context, shown.shape, region, rng)
        noise_seed = int(rng.integers(2**31))
        return RunTrial(
            arena,
            shown,
            start,
            policy=policy,
            region=region,
            trial=trial,
            slip=_draw_slip(rng) if hard else None,
            noise_seed=noise_seed,
            config=_HARD.trial if hard else None,
        )
    except Exception as error:
        note = f"{type(error).__name__}: {' '.join(str(error).split())}"
        return _lost((task, region, policy, trial, seed), note, start)


# Of this worker, as they are dear to make: the arena, and the weights that its policy has.
_arenas: dict[tuple[str, str, bool], tuple[Arena, TrainedPointPolicy | None]] = {}


def _arena(trained: Trained, task: str, policy: str, hard: bool) -> Arena:
    key, weights = (task, policy, hard), trained.get((task, policy))
    if key not in _arenas or _arenas[key][1] is not weights:
        made, shown = MakeTask(task), TaskDemonstration(task)
        arena = Arena(
            made,
            MakePolicy(policy, task, trained, noise=_HARD.tracking.noise if hard else 0.0),
            intended_contact=shown.points[shown.touching] if shown.touching.any() else None,
            tracker=(
                DelayedTracking(num_points=len(made.link_points), config=_HARD.tracking)
                if hard
                else None
            ),
        )
        _arenas[key] = arena, weights
    return _arenas[key][0]


def _draw_slip(rng: np.random.Generator) -> Slip:
    """Returns a slip at a random time, into a random direction."""
    shift, turn = rng.normal(size=(2, 3))
    return Slip(
        rng.uniform(*_HARD.slip_start),
        _HARD.slip_duration,
        _HARD.slip_distance * shift / np.linalg.norm(shift),
        _HARD.slip_angle * turn / np.linalg.norm(turn),
    )


def train_policy(task: str, name: str) -> TrainedPointPolicy:
    """Returns a learned policy for a task, from the cache or trained.

    One demonstration is the task's own; more of them start anywhere in the Near region.
    """
    (row,) = [row for row in ROWS if row.name == name]
    shown = [TaskDemonstration(task)]
    if row.demonstrations > 1:
        shown = _near_demonstrations(task, row.demonstrations)
    return load_or_train([one.points for one in shown], LEARNED[name])


_near_demonstrations = cache(
    NearDemonstrations
)  # Of this worker: several policies learn from them.


def _train(
    config: ControlStudyConfig, jobs: int, ray_address: str | None
) -> dict[tuple[str, str], Any]:
    wanted = [(task, name) for task in config.tasks for name in config.policies if name in LEARNED]
    trained: dict[tuple[str, str], Any] = {}
    if not wanted:
        return trained
    with OneLineTqdm(total=len(wanted), desc="policies trained, or found in the cache") as bar:
        for index, end in run_trials(train_policy, wanted, jobs=jobs, ray_address=ray_address):
            if isinstance(end, LostTrial):
                raise InvalidValueError(
                    str(end), remedy="Free some memory, or leave out the learned policies."
                )
            trained[wanted[index]] = end
            bar.update()
    return trained


def _arguments(config: ControlStudyConfig) -> list[tuple[str, Region, str, int, int]]:
    regions: list[Region] = ["near", "far", "hard"] if config.hard else ["near", "far"]
    # By task and policy, so that a worker seldom needs another diagram.
    return [
        (task, region, policy, trial, config.seed)
        for task in config.tasks
        for policy in config.policies
        for region in regions
        if region != "hard" or policy in HARD_POLICIES
        for trial in range(config.trials)
    ]


def _lost(arguments: tuple[Any, ...], note: str, start: np.ndarray | None = None) -> ControlTrial:
    """Returns the row of a trial that something ended, which is no success."""
    task, region, policy, trial, _ = arguments
    unknown = ("error", "impulse", "depth", "time", "strain", "typical_strain")
    nothing = {name: float("nan") for name in unknown}
    return ControlTrial(
        task=task,
        region=region,
        policy=policy,
        trial=trial,
        success=False,
        collision_free=False,
        distance=np.nan if start is None else distance_to_near(MakeTask(task), start[:3, 3]),
        path=np.zeros((0, 3)),
        note=note,
        lost=True,
        **nothing,
    )
