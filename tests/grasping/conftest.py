"""A mug made of points, and the motion it follows."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from point_grids import point_grid

from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.grasping.candidates.grasp_candidate import GraspCandidate, GraspSamplingConfig
from poil_drake.grasping.candidates.sampling import sample_antipodal_grasps
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.grasping.planner import PlannerConfig, PlanningResult, plan_execution
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.transfer.matching import Matching


class PointMug(NamedTuple):
    """An upright mug with its handle along +x; all points in the world [m]."""

    cloud: PointCloud
    part_points: np.ndarray
    center: np.ndarray
    radius: float
    wall: float
    height: float


MakeTube = Callable[[float, np.ndarray], np.ndarray]
MakeMatching = Callable[[np.ndarray, list[float]], Matching]
MakePlan = Callable[..., PlanningResult]


@pytest.fixture(scope="session")
def make_tube() -> MakeTube:
    """Points on an upright cylinder about the z axis, 3 mm apart."""

    def make(radius: float, heights: np.ndarray) -> np.ndarray:
        angles = np.arange(0.0, 2.0 * np.pi, 0.003 / radius)
        ring = radius * np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
        return np.concatenate([ring + np.array([0.0, 0.0, z]) for z in heights])

    return make


@pytest.fixture(scope="session")
def mug(make_tube: MakeTube) -> PointMug:
    center, radius, wall, height = np.array([0.45, -0.10, 0.0]), 0.040, 0.0035, 0.095
    heights = np.arange(0.002, height, 0.003)
    outside, inside = make_tube(radius, heights), make_tube(radius - wall, heights[6:])
    angles = np.linspace(-np.pi / 2, np.pi / 2, 30)
    curve = np.stack(
        [radius + 0.03 * np.cos(angles), 0.0 * angles, 0.5 * height + 0.03 * np.sin(angles)], 1
    )
    handle = np.concatenate([curve - np.array([0.0, y, 0.0]) for y in (-0.004, 0.004)])
    points = np.concatenate([outside, inside, handle]) + center
    points = points + np.random.default_rng(0).normal(0.0, 0.0005, points.shape)
    outward = np.array([1.0, 1.0, 0.0])
    normals = np.concatenate(
        [
            outside * outward / radius,
            -inside * outward / (radius - wall),
            np.repeat([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]], len(curve), axis=0),
        ]
    )
    part_points = points[-len(handle) :]
    return PointMug(PointCloud(points, normals), part_points, center, radius, wall, height)


@pytest.fixture(scope="session")
def rim_grasps(mug: PointMug) -> list[GraspCandidate]:
    """The grasps sampled on the mug with the default parameters."""
    return sample_antipodal_grasps(mug.cloud, mug.part_points)


@pytest.fixture(scope="session")
def make_matching() -> MakeMatching:
    """Moves points straight by a displacement [m] within 3 s."""

    def make(points: np.ndarray, displacement: list[float]) -> Matching:
        times = np.linspace(0.0, 3.0, 97)
        share = (times / 3.0)[:, None, None]
        velocities = np.tile(np.array(displacement) / 3.0, (97, len(points), 1))
        velocities[-1] = 0.0
        reference = PointTrajectory(times, points + share * displacement, velocities)
        return Matching(points, reference, cost=0.0)

    return make


@pytest.fixture(scope="session")
def matching(mug: PointMug, make_matching: MakeMatching) -> Matching:
    """The mug moves 0.2 m to the left and 0.15 m up."""
    return make_matching(mug.part_points[::6], [0.0, 0.2, 0.15])


@pytest.fixture(scope="session")
def home() -> np.ndarray:
    """The arm's configuration before planning."""
    return np.array([0.0, -0.9, 0.0, -2.5, 0.0, 1.6, np.pi / 4])


@pytest.fixture(scope="session")
def screen() -> np.ndarray:
    """A low screen to the robot's left, and a piece of the table."""
    upright = point_grid(np.arange(0.3, 0.7, 0.01), 0.3, np.arange(0.0, 0.15, 0.01))
    table = point_grid(np.arange(0.2, 0.8, 0.01), np.arange(-0.4, 0.4, 0.01), 0.0)
    return np.concatenate([upright, table])


@pytest.fixture(scope="session")
def make_plan(mug: PointMug, matching: Matching, model: PandaModel, home: np.ndarray) -> MakePlan:
    """Plans from home with few seed points, which are enough and take less time."""

    def make(scene_points: np.ndarray, **options) -> PlanningResult:
        config = PlannerConfig(sampling=GraspSamplingConfig(seed_points=60))
        return plan_execution(
            [matching],
            object_label="mug",
            part_label="handle",
            object_cloud=mug.cloud,
            part_points=mug.part_points,
            scene_points=scene_points,
            q_start=home,
            model=model,
            **({"config": config} | options),
        )

    return make


@pytest.fixture(scope="session")
def seen(screen: np.ndarray, mug: PointMug, model: PandaModel, home: np.ndarray) -> np.ndarray:
    """All points that the cameras see: the screen, the object and the robot."""
    robot = model.link_poses(home)[3:, :3, 3]
    return np.concatenate([screen, mug.cloud.points + 0.001, robot])


@pytest.fixture(scope="session")
def planned(make_plan: MakePlan, seen: np.ndarray) -> PlanningResult:
    """A plan for the mug behind the screen."""
    return make_plan(seen, metadata={"scenario": "test"})


@pytest.fixture(scope="session")
def plan(planned: PlanningResult) -> ExecutionPlan:
    return planned.plan
