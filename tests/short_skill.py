"""A synthetic plan with which the real closed loop runs a second or two without rendering."""

import dataclasses

import numpy as np

from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.diagrams.scenario.load import ChooseScenario, LoadScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.geometry.rigid_transform import make_transform
from poil_drake.grasping.candidates.grasp_candidate import GraspCandidate
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.robots.joint_trajectory import JointTrajectory

HOME = np.array([0.0, -0.9, 0.0, -2.5, 0.0, 1.6, 0.785398])
POINTS = np.array([[0.50, -0.10, 0.04], [0.51, -0.10, 0.05], [0.50, -0.09, 0.06]])


def short_scenario(data: str | None = None) -> Scenario:
    """The package's scenario with the ground-truth tracker and without cameras.

    Args:
        data: YAML text merged over it.
    """
    blind = dataclasses.replace(ChooseScenario(tracker="ground_truth"), cameras={})
    return LoadScenario(data=data, defaults=blind)


def rise(*, height: float, duration: float, samples: int) -> PointTrajectory:
    """Returns a reference that moves the points straight up and stops abruptly."""
    up = np.array([0.0, 0.0, 1.0])
    velocities = np.tile(height / duration * up, (samples, len(POINTS), 1))
    velocities[-1] = 0.0
    positions = POINTS + np.linspace(0.0, height, samples)[:, None, None] * up
    return PointTrajectory(np.linspace(0.0, duration, samples), positions, velocities)


def short_plan() -> ExecutionPlan:
    """Returns a plan in which the arm stays and the hand closes on nothing, which is a fault."""
    stay = JointTrajectory([0.0, 0.125], [HOME, HOME], np.zeros((2, 7)))
    grasp = GraspCandidate(
        make_transform(np.diag([1.0, -1.0, -1.0]), [0.50, -0.10, 0.05]),
        0.004,
        0.028,
        0.7,
        np.array([[0.50, -0.102, 0.05], [0.50, -0.098, 0.05]]),
    )
    return ExecutionPlan(
        object_label="mug",
        part_label="handle",
        target_points=POINTS,
        object_points=POINTS,
        part_points=POINTS,
        reference=rise(height=0.1, duration=1.0, samples=5),
        grasp=grasp,
        approach=stay,
        descent=stay,
        lift_height=0.05,
        retreat_distance=0.1,
        nominal_posture=HOME,
        metadata={"seed": 0},
    )
