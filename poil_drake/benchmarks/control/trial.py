"""One trial of the control study."""

from dataclasses import dataclass, field

import numpy as np
from pydrake.systems.analysis import Simulator

from poil_drake.benchmarks.control.arena import Arena
from poil_drake.benchmarks.control.contact_monitor import CollisionThreshold
from poil_drake.benchmarks.control.demonstration import RecordedDemonstration
from poil_drake.benchmarks.control.direct_actuation import Slip
from poil_drake.benchmarks.control.scripted import pose_difference
from poil_drake.benchmarks.control.starts import Region, distance_to_near, sample_start
from poil_drake.benchmarks.control.task import SUCCESS_DISTANCE


@dataclass(frozen=True, kw_only=True)
class TrialConfig:
    """When a trial ends.

    Attributes:
        max_time: At the latest [s]: three demonstrations.
        look_period: Between two looks at the state [s].
        settled_time: A trial ends once the object has hardly moved for so long [s]; longer than
            it takes safe entry to see that it is blocked.
        settled_motion: What is hardly moving: a turn [rad] and a shift [m] over that time. At the
            reference's slowest, 2 cm/s, it moves ten times as far.
        threshold: From when on contact is a collision.
    """

    max_time: float = 24.0
    look_period: float = 1 / 8
    settled_time: float = 2.5
    settled_motion: tuple[float, float] = (0.02, 0.002)
    threshold: CollisionThreshold = field(default_factory=CollisionThreshold)


@dataclass(frozen=True, kw_only=True, eq=False)
class ControlTrial:
    """How a trial went.

    Attributes:
        task: Its name.
        region: Where it started.
        policy: Who was in control.
        trial: Its number, which draws the start.
        success: By the paper's criterion.
        collision_free: Whether no contact exceeded the threshold.
        error: What the criterion looks at, in the end [m].
        impulse: Of all contacts that were not meant [N s].
        depth: Deepest such penetration [m].
        time: Simulated [s].
        strain: Largest change of a distance between two points, relative to that at the start.
        distance: Of the start from the Near region in x and y [m].
        path: (K, 3) of the object's frame [m], one each `look_period`.
        note: What the policy had to say in the end.
    """

    task: str
    region: str
    policy: str
    trial: int
    success: bool
    collision_free: bool
    error: float
    impulse: float
    depth: float
    time: float
    strain: float
    distance: float
    path: np.ndarray
    note: str = ""


def goal_error(
    criterion: str, points: np.ndarray, X_WO: np.ndarray, shown: RecordedDemonstration
) -> float:
    """Returns how far the object is from the demonstration's end [m], by the task's criterion."""
    if criterion == "center":
        return float(np.linalg.norm(X_WO[:3, 3] - shown.X_WO[-1, :3, 3]))
    return float(np.linalg.norm(points - shown.points[-1], axis=1).mean())


def RunTrial(
    arena: Arena,
    shown: RecordedDemonstration,
    *,
    policy: str,
    region: Region,
    trial: int,
    rng: np.random.Generator,
    slip: Slip | None = None,
    noise_seed: int = 0,
    config: TrialConfig | None = None,
) -> ControlTrial:
    """Simulates one trial.

    Args:
        arena: With the policy.
        shown: The task's demonstration.
        policy: Name of the policy.
        region: Where to start.
        trial: Number of the trial.
        rng: Draws the start.
        slip: How the object slips in the hand; None for not at all.
        noise_seed: Of the tracker's noise, where there is a tracker.
        config: When it ends.
    """
    config = config or TrialConfig()
    simulator = Simulator(arena.diagram)
    context = simulator.get_mutable_context()
    start = sample_start(arena, context, shown.shape, region, rng)
    if slip is not None:
        hand, own = arena.hand_context(context)
        hand.SetSlip(own, slip)
    if arena.tracker is not None:
        arena.tracker.SetSeed(arena.tracker.GetMyMutableContextFromRoot(context), noise_seed)
    simulator.Initialize()
    first = arena.points(context)
    pairs = np.triu_indices(len(first), 1)
    lengths = np.linalg.norm(first[pairs[0]] - first[pairs[1]], axis=1)
    poses, strain = [start], 0.0
    earliest = config.settled_time + (0.0 if slip is None else slip.start + slip.duration)
    window = round(config.settled_time / config.look_period)
    while context.get_time() < config.max_time:
        simulator.AdvanceTo(context.get_time() + config.look_period)
        points = arena.points(context)
        poses.append(arena.pose(context))
        now = np.linalg.norm(points[pairs[0]] - points[pairs[1]], axis=1)
        strain = max(strain, float(np.max(np.abs(now / lengths - 1.0))))
        if context.get_time() >= earliest and _is_settled(poses[-1 - window :], config):
            break
    error = goal_error(arena.task.criterion, arena.points(context), arena.pose(context), shown)
    impulse, depth = arena.contact(context)
    return ControlTrial(
        task=arena.task.name,
        region=region,
        policy=policy,
        trial=trial,
        success=error < SUCCESS_DISTANCE,
        collision_free=impulse <= config.threshold.impulse and depth <= config.threshold.depth,
        error=error,
        impulse=impulse,
        depth=depth,
        time=context.get_time(),
        strain=strain,
        distance=distance_to_near(arena.task, start[:3, 3]),
        path=np.array(poses)[:, :3, 3],
        note=str(getattr(arena.policy_state(context), "note", "")),
    )


def _is_settled(poses: list[np.ndarray], config: TrialConfig) -> bool:
    """Returns whether an object hardly moves from the first pose (4, 4) to any of the others."""
    moved = [pose_difference(poses[0], pose) for pose in poses[1:]]
    turn, shift = config.settled_motion
    return all(np.linalg.norm(one[:3]) < turn and np.linalg.norm(one[3:]) < shift for one in moved)
