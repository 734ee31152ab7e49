"""A narrow cell for a supervised arm, and random velocities for it."""

import numpy as np
from supervisor_bench import LIMITS, MODEL

from poil_drake.geometry.scene_cloud import SceneCloud
from poil_drake.robots.collision import RobotCollisionChecker
from poil_drake.robots.panda_spheres import make_robot_spheres
from poil_drake.robots.posture_guard import PostureGuard, PostureGuardConfig

# The cell is narrow enough to limit the motions.
CELL = PostureGuardConfig(
    gripper_lower=(0.1, -0.5, 0.0),
    gripper_upper=(0.7, 0.5, 0.8),
    body_lower=(-0.4, -0.6, 0.0),
    body_upper=(0.8, 0.6, 1.1),
    table_height=0.02,
)
SPHERES = make_robot_spheres(finger_opening=None)
ITSELF = RobotCollisionChecker(model=MODEL, spheres=SPHERES, scene=SceneCloud(np.zeros((0, 3))))


def allowed_start(rng: np.random.Generator) -> np.ndarray:
    guard = PostureGuard(model=MODEL, config=CELL)
    while True:
        q = rng.uniform(LIMITS.lower + 0.06, LIMITS.upper - 0.06, size=(100, 7))
        free = q[guard.clearances(q).min(axis=1) > 0.0]
        if len(free):
            return free[0]


def random_velocity(rng: np.random.Generator, q: np.ndarray) -> np.ndarray:
    """Returns a velocity such as of a twist, of a jump of a reference, or of a software error."""
    kind = rng.integers(8)
    if kind == 0:
        velocity = rng.normal(size=7)
        velocity[rng.integers(7)] = rng.choice([np.nan, np.inf, -np.inf])
        return velocity
    if kind == 1:
        return 10.0 ** rng.uniform(2, 300) * rng.normal(size=7)
    if kind < 4:
        return rng.choice([0.1, 1.0, 10.0]) * rng.normal(size=7)
    _, J = MODEL.gripper_pose_and_jacobian(q)
    twist = rng.choice([0.2, 1.0, 5.0]) * rng.normal(size=6)
    return np.linalg.pinv(J, rcond=1e-3) @ twist


def distance_from_cell(q: np.ndarray) -> np.ndarray:
    """Returns how far postures (K, 7) are from breaking a rule (K,) [m], from the spheres alone."""
    poses = MODEL.link_poses(q)
    gripper = poses[:, 8, :3, 3]
    own = (SPHERES.links >= 2) & (SPHERES.links < 8)
    centers, radii = SPHERES.world_centers(poses)[:, own], SPHERES.radii[own, None]
    inside = [
        gripper - CELL.gripper_lower,
        CELL.gripper_upper - gripper,
        (centers - radii - CELL.body_lower).min(axis=1),
        (CELL.body_upper - centers - radii).min(axis=1),
        (centers - radii)[..., 2].min(axis=1, keepdims=True) - CELL.table_height,
    ]
    nearest = np.concatenate(inside, axis=1).min(axis=1)
    return np.minimum(nearest, ITSELF.self_clearance(poses))
