"""One trial of the control study."""

from dataclasses import dataclass, field, replace

import numpy as np
from pydrake.systems.analysis import Simulator

from poil_drake.benchmarks.control.arena.arena import Arena
from poil_drake.benchmarks.control.arena.direct_actuation import Slip
from poil_drake.benchmarks.control.arena.tasks import SUCCESS_DISTANCE
from poil_drake.benchmarks.control.demonstration import RecordedDemonstration
from poil_drake.geometry.rigid_transform import rotation_angle


@dataclass(frozen=True, kw_only=True)
class TrialConfig:
    """When a trial ends, and what counts as a collision.

    Attributes:
        max_time: Time limit [s]: about three times a demonstration.
        look_period: Time between two checks of the state [s].
        settled_time: A trial ends when the object has hardly moved for this time [s].
        settled_motion: Bounds of rotation [rad] and shift [m] of an object that hardly moves.
        max_impulse: Total impulse of all contacts in a trial [N s], above which it counts as a
            collision. 0.02 N s stop a 0.25 kg mug that moves at 8 cm/s.
        max_depth: Deepest penetration [m], above which a trial counts as a collision. 1 N presses
            the mug's handle and the rod together by 1 mm.
    """

    max_time: float = 24.0
    look_period: float = 1 / 8
    settled_time: float = 2.5
    settled_motion: tuple[float, float] = (0.02, 0.002)
    max_impulse: float = 0.02
    max_depth: float = 0.001


@dataclass(frozen=True, kw_only=True, eq=False)
class ControlTrial:
    """A trial and its result. Without a result, it counts as a failure.

    Attributes:
        task: Name of the task.
        region: Region of the start.
        policy: Name of the policy.
        trial: Number of the trial, which determines the start.
        success: Whether it succeeded by the paper's criterion.
        collision_free: Whether contact stayed within the limits of `TrialConfig`.
        error: Final distance from the goal, by the task's criterion [m].
        impulse: Total impulse of all contacts that were not intended [N s].
        depth: Deepest penetration in these contacts [m].
        time: Simulated time [s].
        strain: Largest strain over all pairs of points and all times. The strain of a pair is the
            change of its distance since the start, divided by its distance at the start.
        typical_strain: Largest value over time of the median strain over all pairs.
        distance: Distance of the start from the Near region in x and y [m].
        path: (K, 3) positions of the object's frame [m], one per `look_period`.
        note: The policy's remark, or the error that ended the trial.
        lost: Whether an error ended the trial, which then counts as a failure.
    """

    task: str
    region: str
    policy: str
    trial: int
    success: bool = False
    collision_free: bool = False
    error: float = np.nan
    impulse: float = np.nan
    depth: float = np.nan
    time: float = np.nan
    strain: float = np.nan
    typical_strain: float = np.nan
    distance: float = np.nan
    path: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    note: str = ""
    lost: bool = False


def goal_error(
    criterion: str, points: np.ndarray, X_WO: np.ndarray, shown: RecordedDemonstration
) -> float:
    """Returns the object's distance from its place at the demonstration's end [m].

    With criterion "center", it is the distance of the driven body's origin, from X_WO (4, 4). With
    "points", it is the mean distance of the points (N, 3).
    """
    if criterion == "center":
        return float(np.linalg.norm(X_WO[:3, 3] - shown.X_WO[-1, :3, 3]))
    return float(np.linalg.norm(points - shown.points[-1], axis=1).mean())


def RunTrial(
    trial: ControlTrial,
    arena: Arena,
    shown: RecordedDemonstration,
    start: np.ndarray,
    *,
    slip: Slip | None = None,
    noise_seed: int = 0,
    config: TrialConfig,
) -> ControlTrial:
    """Simulates a trial, and returns it with its result.

    Args:
        trial: The trial.
        arena: The arena with the policy.
        shown: The task's demonstration.
        start: (4, 4) start pose of the driven body.
        slip: How the object slips in the hand; None for no slip.
        noise_seed: Seed of the tracker's noise, if there is a tracker.
        config: When the trial ends.
    """
    simulator = Simulator(arena.diagram)
    context = simulator.get_mutable_context()
    arena.place(context, start, shown.shape)
    if slip is not None:
        arena.SetSlip(context, slip)
    arena.SetNoiseSeed(context, noise_seed)
    simulator.Initialize()
    poses, points = _watch(arena, simulator, config, slip)
    error = goal_error(arena.task.criterion, points[-1], poses[-1], shown)
    impulse, depth = arena.contact(context)
    strains = pair_strains(points)
    return replace(
        trial,
        success=error < SUCCESS_DISTANCE,
        collision_free=impulse <= config.max_impulse and depth <= config.max_depth,
        error=error,
        impulse=impulse,
        depth=depth,
        time=context.get_time(),
        strain=float(strains.max()),
        typical_strain=float(np.median(strains, axis=1).max()),
        path=poses[:, :3, 3],
        note=arena.note(context),
    )


def _watch(
    arena: Arena, simulator: Simulator, config: TrialConfig, slip: Slip | None
) -> tuple[np.ndarray, np.ndarray]:
    """Simulates a trial. Returns poses (K, 4, 4) and points (K, N, 3) from the start to the end."""
    context = simulator.get_context()
    poses, points = [arena.pose(context)], [arena.points(context)]
    earliest = config.settled_time + (0.0 if slip is None else slip.start + slip.duration)
    window = round(config.settled_time / config.look_period)
    while context.get_time() < config.max_time:
        simulator.AdvanceTo(context.get_time() + config.look_period)
        poses.append(arena.pose(context))
        points.append(arena.points(context))
        if context.get_time() >= earliest and _is_settled(poses[-1 - window :], config):
            break
    return np.array(poses), np.array(points)


def pair_strains(points: np.ndarray) -> np.ndarray:
    """Returns the strains (K, P) of the P pairs of points (K, N, 3) [m]; see `ControlTrial`."""
    first, second = np.triu_indices(points.shape[1], 1)
    lengths = np.linalg.norm(points[:, first] - points[:, second], axis=2)
    return np.abs(lengths / lengths[0] - 1.0)


def _is_settled(poses: list[np.ndarray], config: TrialConfig) -> bool:
    """Returns whether all poses (4, 4) are within `settled_motion` of the first one."""
    X = np.array(poses)
    turns = rotation_angle(X[1:, :3, :3] @ X[0, :3, :3].T)
    shifts = np.linalg.norm(X[1:, :3, 3] - X[0, :3, 3], axis=1)
    turn, shift = config.settled_motion
    return bool(turns.max() < turn and shifts.max() < shift)
