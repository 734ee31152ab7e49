"""Demonstrations of the control study, recorded in its simulation."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from pydrake.systems.analysis import Simulator

from poil_drake.benchmarks.control.arena.arena import Arena
from poil_drake.benchmarks.control.arena.tasks import ControlTask, MakeTask
from poil_drake.benchmarks.control.policies.scripted import ScriptedPolicy, pose_difference
from poil_drake.benchmarks.control.starts import sample_start, trial_generator
from poil_drake.control.reference.make_reference import make_reference, reference_from_samples
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.diagrams.demonstration.motion import KeyframeMotion
from poil_drake.geometry.rigid_fit import kabsch
from poil_drake.geometry.rigid_transform import transform_points

RECORDING_PERIOD = 1 / 16
"""Time between two samples of a demonstration [s]."""

_SETTLING_TIME = 1.0  # A hanging strap comes to rest within this time [s].
_RIGID = 0.001  # An object that deforms less than this counts as rigid [m].
_TURNING_SPEED, _MOVING_SPEED = 1.2, 0.1  # Mean speeds on the way to the start [rad/s, m/s].
_BLEND = 0.2  # Blending time between keyframes [s]; people hardly stop in between.


@dataclass(frozen=True, eq=False)
class RecordedDemonstration:
    """A recorded demonstration.

    Attributes:
        times: (T,) sample times from 0 [s].
        points: (T, N, 3) the points [m, world].
        X_WO: (T, 4, 4) poses of the driven body.
        touching: (T,) bool, whether the object touched the scene.
        shape: Joint positions of the object, without its pose, at rest before the motion.
    """

    times: np.ndarray
    points: np.ndarray
    X_WO: np.ndarray
    touching: np.ndarray
    shape: np.ndarray


@cache
def TaskDemonstration(name: str) -> RecordedDemonstration:
    """Returns the one demonstration of a task."""
    task = MakeTask(name)
    return Demonstrate(task, task.times, task.keyframes)


@cache
def TaskDeformation(name: str) -> float:
    """Returns how far the points deform from their shape at the start of the demonstration [m].

    The first sample is fitted rigidly to every sample. The result is the largest mean distance
    between corresponding points.
    """
    points = TaskDemonstration(name).points
    start = np.broadcast_to(points[0], points.shape)
    rigid = transform_points(kabsch(start, points), points[0])
    return float(np.linalg.norm(rigid - points, axis=2).mean(axis=1).max())


@cache
def TaskReference(name: str) -> PointTrajectory:
    """Returns the reference made from a task's one demonstration."""
    return ReferenceAlong(name, TaskDemonstration(name).points)


def ReferenceAlong(name: str, positions: np.ndarray) -> PointTrajectory:
    """Returns a reference through positions (T, M, 3) [m] at the times of a task's demonstration.

    For a rigid object, one shape is fitted to all samples. For a deforming object, the positions
    are used as they are.
    """
    times = TaskDemonstration(name).times
    if TaskDeformation(name) < _RIGID:
        return make_reference(times, positions)
    return reference_from_samples(times, positions)


def Demonstrate(
    task: ControlTask, times: np.ndarray, keyframes: np.ndarray
) -> RecordedDemonstration:
    """Simulates a demonstration.

    The object is held still until it has come to rest, then moved smoothly through the keyframes.

    Args:
        task: The object and the scene. The task's own keyframes are not used.
        times: (K,) times of the keyframes [s].
        keyframes: (K, 4, 4) poses of the driven body.
    """
    motion = KeyframeMotion(times, keyframes, blend=_BLEND)
    period = RECORDING_PERIOD / 4
    waiting, moving = round(_SETTLING_TIME / period), round(motion.duration / period)
    poses = [motion.pose(max(k - waiting, 0) * period) for k in range(waiting + moving + 1)]
    arena = Arena(task, ScriptedPolicy(np.array(poses), period=period))
    simulator = Simulator(arena.diagram)
    context = simulator.get_mutable_context()
    arena.place(context, motion.pose(0.0), arena.shape(context))
    simulator.Initialize()
    simulator.AdvanceTo(_SETTLING_TIME)
    shape = arena.shape(context)
    samples = []
    impulse, _ = arena.contact(context)
    for k in range(int(motion.duration / RECORDING_PERIOD) + 1):
        simulator.AdvanceTo(_SETTLING_TIME + k * RECORDING_PERIOD)
        now, _ = arena.contact(context)
        samples.append((arena.points(context), arena.pose(context), now > impulse))
        impulse = now
    points, X_WO, touching = (np.array(column) for column in zip(*samples, strict=True))
    return RecordedDemonstration(
        RECORDING_PERIOD * np.arange(len(points)), points, X_WO, touching, shape
    )


@cache
def NearDemonstrations(name: str, count: int) -> tuple[RecordedDemonstration, ...]:
    """Returns demonstrations of a task with random starts in the Near region.

    Each moves the object to the start of `TaskDemonstration`, and then repeats that motion.
    """
    task, shown = MakeTask(name), TaskDemonstration(name)
    arena = Arena(task, ScriptedPolicy(task.keyframes, period=RECORDING_PERIOD))
    context = arena.diagram.CreateDefaultContext()
    recorded = []
    for k in range(count):
        rng = trial_generator(name, "demonstrations", k)
        start = sample_start(arena, context, shown.shape, "near", rng)
        difference = pose_difference(start, task.keyframes[1])
        turn, shift = np.linalg.norm(difference[:3]), np.linalg.norm(difference[3:])
        way = max(turn / _TURNING_SPEED, shift / _MOVING_SPEED)
        # The object rests first, and then moves to the start of the one demonstration.
        times = np.concatenate([task.times[:2], task.times[1:] + way])
        keyframes = np.concatenate([[start, start], task.keyframes[1:]])
        recorded.append(Demonstrate(task, times, keyframes))
    return tuple(recorded)
