"""The control study: which policies reach the goal, over many trials (POIL, table II)."""

import time
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from tqdm import tqdm

from poil_drake.benchmarks.control.arena.arena import ARENA, Arena
from poil_drake.benchmarks.control.arena.direct_actuation import Slip
from poil_drake.benchmarks.control.arena.observation import DelayedTracking, TrackingConfig
from poil_drake.benchmarks.control.arena.tasks import TASKS, MakeTask
from poil_drake.benchmarks.control.demonstration import NearDemonstrations, TaskDemonstration
from poil_drake.benchmarks.control.pictures import DrawTask, draw_pictures
from poil_drake.benchmarks.control.point_policy.network import TrainedPointPolicy
from poil_drake.benchmarks.control.point_policy.training import load_or_train
from poil_drake.benchmarks.control.policies.policies import LEARNED, OURS, ROWS, MakePolicy
from poil_drake.benchmarks.control.starts import (
    Region,
    distance_to_near,
    sample_start,
    trial_generator,
)
from poil_drake.benchmarks.control.table import print_tables, summarize
from poil_drake.benchmarks.control.trial import ControlTrial, RunTrial, TrialConfig
from poil_drake.benchmarks.trials.pool import LostTrial, run_trials
from poil_drake.errors import InvalidValueError
from poil_drake.recording.mcap.library_versions import library_versions
from poil_drake.recording.mcap.plain_json import write_json
from poil_drake.reports.progress import OneLineTqdm

HARD_POLICIES = ("open_loop", "se3_bcsdm", "field", OURS)
"""The policies that run in hard mode. Even there, `se3_bcsdm` knows the exact pose.

The learned policies are left out because only the yaw varies in their demonstrations.
"""

Trained = Mapping[tuple[str, str], TrainedPointPolicy]
"""Trained policies by the names of task and policy."""

_WRITING_PERIOD = 60.0  # Time between two writes of the results so far [s].


@dataclass(frozen=True, kw_only=True)
class HardMode:
    """The difficulties of hard mode, in addition to a start in any orientation.

    Attributes:
        slip_start: Earliest and latest time at which a slip of the object in the hand begins [s].
        slip_duration: Duration of the slip [s].
        slip_distance: Distance by which the object shifts in the hand [m].
        slip_angle: Angle by which the object rotates in the hand [rad].
        tracking: Delay and noise of the points.
        trial: When a trial ends: later than usual, because noise can make the object rest briefly.
    """

    slip_start: tuple[float, float] = (1.0, 3.0)
    slip_duration: float = 0.25
    slip_distance: float = 0.03
    slip_angle: float = np.radians(20.0)
    tracking: TrackingConfig = field(default_factory=TrackingConfig)
    trial: TrialConfig = field(
        default_factory=lambda: TrialConfig(settled_time=5.0, settled_motion=(0.4, 0.01))
    )


HARD = HardMode()


@dataclass(frozen=True, kw_only=True)
class ControlStudyConfig:
    """The trials of the study.

    Attributes:
        tasks: Names of tasks.
        policies: Names of policies.
        trials: Number of trials of each policy in each region of each task.
        hard: Whether to add hard mode: a start in any orientation, an 8 Hz tracker with 0.1 s of
            latency and 3 mm of noise, and a slip of 3 cm and 20 degrees on the way.
        seed: Seed of starts, slips and noise. Policies are always trained on the same
            demonstrations.
    """

    tasks: tuple[str, ...] = TASKS
    policies: tuple[str, ...] = tuple(row.name for row in ROWS)
    trials: int = 100
    hard: bool = True
    seed: int = 0

    def __post_init__(self) -> None:
        for kind, wanted, known in (
            ("task", self.tasks, TASKS),
            ("policy", self.policies, tuple(row.name for row in ROWS)),
        ):
            for name in wanted:
                if name not in known:
                    raise InvalidValueError(
                        f"There is no {kind} '{name}'.", remedy=f"Choose from: {', '.join(known)}."
                    )
            if len(set(wanted)) < len(wanted):
                raise InvalidValueError(
                    f"A {kind} is named twice in '{','.join(wanted)}'.", remedy="Name each once."
                )


def run_control_study(
    config: ControlStudyConfig,
    *,
    json_path: Path,
    pictures: Path | None = None,
    jobs: int = 1,
    ray_address: str | None = None,
) -> list[ControlTrial]:
    """Trains the learned policies, runs all trials, prints the tables and writes the results.

    Args:
        config: The trials to run.
        json_path: JSON file for the results. If interrupted, the study writes the results so far.
        pictures: Folder for the pictures; None draws none.
        jobs: Number of worker processes on this machine.
        ray_address: Address of a Ray cluster to use instead; see `run_trials`.
    """
    if pictures is not None:
        pictures.mkdir(parents=True, exist_ok=True)
    trained = _train(config, jobs, ray_address)
    arguments = _arguments(config)
    results: dict[int, ControlTrial] = {}

    def in_order() -> list[ControlTrial]:
        return [results[index] for index in sorted(results)]

    ends = run_trials(
        run_control_trial, arguments, shared=(trained,), jobs=jobs, ray_address=ray_address
    )
    written = time.monotonic()
    try:
        with closing(ends), OneLineTqdm(total=len(arguments), desc="trials", smoothing=0.05) as bar:
            for index, end in ends:
                if isinstance(end, LostTrial):
                    task, region, policy, number, _ = arguments[index]
                    lost = ControlTrial(task=task, region=region, policy=policy, trial=number)
                    end = replace(lost, note=str(end), lost=True)
                results[index] = end
                bar.update()
                if time.monotonic() - written > _WRITING_PERIOD:
                    write_figures(in_order(), config, json_path)
                    written = time.monotonic()
    finally:
        write_figures(in_order(), config, json_path)
    trials = in_order()
    print_tables(trials)
    if pictures is not None:
        draw_pictures(trials, pictures)
        for task in config.tasks:
            try:
                DrawTask(task, pictures / f"control_task_{task}.png")
            except RuntimeError as error:
                tqdm.write(f"note: {task} could not be drawn: {' '.join(str(error).split())}")
    return trials


def write_figures(trials: Sequence[ControlTrial], config: ControlStudyConfig, path: Path) -> None:
    """Writes the results of trials and the settings of the study as JSON."""
    figures = {
        "config": asdict(config),
        "arena": asdict(ARENA),
        "trial": asdict(TrialConfig()),
        "hard": asdict(HARD) if config.hard else None,
        "policies": {name: asdict(LEARNED[name]) for name in config.policies if name in LEARNED},
        "libraries": library_versions(),
        "paper": {task: MakeTask(task).paper for task in config.tasks},
        "summary": [vars(cell) for cell in summarize(trials)],
        # Paths in whole millimetres.
        "trials": [
            {**vars(trial), "path": np.round(1e3 * trial.path).astype(int)} for trial in trials
        ],
    }
    write_json(figures, path, indent=None)


def run_control_trial(
    trained: Trained, task: str, region: Region, policy: str, number: int, seed: int = 0
) -> ControlTrial:
    """Runs one trial, whose random numbers depend only on task, region, number and seed.

    `trained` needs an entry for task and policy only if the policy is a learned one. A trial that
    ends in an error counts as a failure, and its note is the error.
    """
    rng, hard = trial_generator(task, region, number, seed=seed), region == "hard"
    trial = ControlTrial(task=task, region=region, policy=policy, trial=number)
    try:
        weights = trained[task, policy] if policy in LEARNED else None
        arena, shown = _arena(task, policy, hard, weights), TaskDemonstration(task)
        context = arena.diagram.CreateDefaultContext()
        start = sample_start(arena, context, shown.shape, region, rng)
        trial = replace(trial, distance=distance_to_near(arena.task, start[:3, 3]))
        noise_seed = int(rng.integers(2**31))
        return RunTrial(
            trial,
            arena,
            shown,
            start,
            slip=_draw_slip(rng) if hard else None,
            noise_seed=noise_seed,
            config=HARD.trial if hard else TrialConfig(),
        )
    except Exception as error:
        note = f"{type(error).__name__}: {' '.join(str(error).split())}"
        return replace(trial, note=note, lost=True)


@lru_cache(maxsize=2)  # Trials of the same task and policy follow each other.
def _arena(task: str, policy: str, hard: bool, weights: TrainedPointPolicy | None) -> Arena:
    made, shown = MakeTask(task), TaskDemonstration(task)
    tracker = DelayedTracking(num_points=len(made.link_points), config=HARD.tracking)
    return Arena(
        made,
        MakePolicy(policy, task, weights, noise=HARD.tracking.noise if hard else 0.0),
        intended_contact=shown.points[shown.touching] if shown.touching.any() else None,
        tracker=tracker if hard else None,
    )


def _draw_slip(rng: np.random.Generator) -> Slip:
    """Returns a slip at a random time, in a random direction."""
    shift, turn = rng.normal(size=(2, 3))
    return Slip(
        rng.uniform(*HARD.slip_start),
        HARD.slip_duration,
        HARD.slip_distance * shift / np.linalg.norm(shift),
        HARD.slip_angle * turn / np.linalg.norm(turn),
    )


def train_policy(task: str, name: str) -> TrainedPointPolicy:
    """Returns a learned policy for a task, from the cache or newly trained.

    A policy that learns from one demonstration gets `TaskDemonstration`. A policy that learns from
    several gets `NearDemonstrations`.
    """
    (row,) = [row for row in ROWS if row.name == name]
    if row.demonstrations > 1:
        shown = NearDemonstrations(task, row.demonstrations)
    else:
        shown = (TaskDemonstration(task),)
    return load_or_train([one.points for one in shown], LEARNED[name])


def _train(config: ControlStudyConfig, jobs: int, ray_address: str | None) -> Trained:
    wanted = [(task, name) for task in config.tasks for name in config.policies if name in LEARNED]
    trained: dict[tuple[str, str], TrainedPointPolicy] = {}
    if not wanted:
        return trained
    with (
        closing(run_trials(train_policy, wanted, jobs=jobs, ray_address=ray_address)) as ends,
        OneLineTqdm(total=len(wanted), desc="policies trained, or found in the cache") as bar,
    ):
        for index, end in ends:
            if isinstance(end, LostTrial):
                raise InvalidValueError(
                    f"A learned policy was not trained: {end}.",
                    remedy="Free some memory, or leave out the learned policies.",
                )
            trained[wanted[index]] = end
            bar.update()
    return trained


def _arguments(config: ControlStudyConfig) -> list[tuple[str, Region, str, int, int]]:
    regions: list[Region] = ["near", "far", "hard"] if config.hard else ["near", "far"]
    # Sorted by task and policy, so that a worker seldom needs another diagram.
    return [
        (task, region, policy, trial, config.seed)
        for task in config.tasks
        for policy in config.policies
        for region in regions
        if region != "hard" or policy in HARD_POLICIES
        for trial in range(config.trials)
    ]
