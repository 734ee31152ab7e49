"""Small scenes made of sampled surfaces, in which the shortest path collides."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.control.entry.safe_entry import SafeEntryConfig, SafeEntryPlanner
from poil_drake.control.field.point_set_bcsdm import BcsdmConfig
from poil_drake.control.reference.make_reference import make_reference
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.control.reference.pose_smoothing import interpolate_poses
from poil_drake.control.reference.timing import ReferenceConfig
from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, transform_points
from poil_drake.geometry.scene_cloud import SceneCloud

SPACING = 0.004


def box(size, centre, spacing=SPACING):
    """Returns points on the faces of a box."""
    low = np.asarray(centre) - 0.5 * np.asarray(size)
    axes = [np.linspace(0.0, s, max(int(np.ceil(s / spacing)), 1) + 1) for s in size]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    on_face = np.any((points == 0.0) | (np.abs(points - size) < 1e-9), axis=1)
    return low + points[on_face]


def cylinder(radius, length, *, axis, centre, spacing=SPACING):
    """Returns points on a closed cylinder."""
    around = np.linspace(0.0, 2.0 * np.pi, int(np.ceil(2.0 * np.pi * radius / spacing)) + 1)[:-1]
    along = np.linspace(-0.5 * length, 0.5 * length, int(np.ceil(length / spacing)) + 1)
    angle, height = (g.ravel() for g in np.meshgrid(around, along))
    parts = [np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)]
    for r in np.arange(0.0, radius, spacing):
        cap = np.stack([r * np.cos(around), r * np.sin(around), 0 * around], axis=1)
        top = np.array([0.0, 0.0, 0.5 * length])
        parts += [cap + top, cap - top]
    points = np.concatenate(parts)
    return np.roll(points, axis + 1, axis=1) + centre


def torus(major, minor, spacing=0.003):
    """Returns points on a ring about the x axis."""
    u = np.linspace(0.0, 2.0 * np.pi, int(2.0 * np.pi * major / spacing))[:-1]
    v = np.linspace(0.0, 2.0 * np.pi, max(int(2.0 * np.pi * minor / spacing), 6))[:-1]
    u, v = (g.ravel() for g in np.meshgrid(u, v))
    r = major + minor * np.cos(v)
    return np.stack([minor * np.sin(v), r * np.cos(u), r * np.sin(u)], axis=1)


@dataclass(frozen=True, eq=False)
class Scene:
    """A task: obstacles on the table, the object in its own frame, and a demonstration."""

    obstacles: np.ndarray
    cloud: np.ndarray
    points: np.ndarray
    reference: PointTrajectory
    low: np.ndarray
    high: np.ndarray

    def planner(
        self, config: SafeEntryConfig | None = None, X_WO=None, bcsdm: BcsdmConfig | None = None
    ) -> SafeEntryPlanner:
        X_WO = np.eye(4) if X_WO is None else X_WO
        return SafeEntryPlanner(
            reference=self.reference,
            scene=SceneCloud(self.obstacles, ground_height=0.0),
            object_cloud=transform_points(X_WO, self.cloud),
            object_points=transform_points(X_WO, self.points),
            bcsdm=bcsdm,
            config=config,
        )

    def points_at(self, X_WO):
        return transform_points(X_WO, self.points)

    def closed_in(self, X_WO) -> "Scene":
        """Returns the scene with a pose of the object enclosed in a box."""
        cage = box([0.2, 0.2, 0.2], X_WO[:3, 3] + [0, 0, 0.06])
        return replace(self, obstacles=np.concatenate([self.obstacles, cage]))

    def distance(self, X_WO):
        """Returns the clearance (K,) at poses of the object, by brute force over all pairs."""
        where = transform_points(X_WO, self.cloud)
        distance = cKDTree(self.obstacles).query(where)[0].min(axis=1)
        return np.minimum(distance, where[..., 2].min(axis=1))

    def random_pose(self, rng, *, clearance, full_rotation):
        while True:
            angle = rng.normal(size=4)
            turn = rotation_exp([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
            if full_rotation:
                w, *xyz = angle / np.linalg.norm(angle)
                turn = rotation_exp(2.0 * np.arccos(w) * np.array(xyz) / np.linalg.norm(xyz))
            X = make_transform(turn, rng.uniform(self.low, self.high))
            if self.distance(X[None])[0] > clearance:
                return X


def demonstration(points, corners, speed=0.12):
    """Returns the reference of an object that moves straight between poses."""
    X = np.array(corners)
    steps = np.linalg.norm(np.diff(X[:, :3, 3], axis=0), axis=1)
    times = np.concatenate([[0.0], np.cumsum(np.maximum(steps / speed, 0.5))])
    fine = np.arange(0.0, times[-1], 1.0 / 16.0)
    tracked = transform_points(interpolate_poses(times, X, fine), points)
    return make_reference(fine, tracked, ReferenceConfig(smoothing_time=0.12))


def at(x, y, z, yaw=0.0):
    return make_transform(rotation_exp([0.0, 0.0, yaw]), [x, y, z])


def wall_scene():
    """A cube is put on the table behind a wall."""
    cloud = box([0.06, 0.05, 0.05], [0, 0, 0], 0.005)
    points = np.array(
        [[sx * 0.03, sy * 0.025, sz * 0.025] for sx in (-1, 1) for sy in (-1, 1) for sz in (-1, 1)]
    )
    path = [at(0, 0.16, 0.2), at(0, 0.2, 0.15), at(0, 0.22, 0.07), at(0, 0.22, 0.026)]
    return Scene(
        box([0.5, 0.02, 0.25], [0, 0, 0.125]),
        cloud,
        points,
        demonstration(points, path),
        np.array([-0.25, -0.35, 0.05]),
        np.array([0.25, 0.35, 0.4]),
    )


def rod_scene():
    """A mug is hung by its handle, the ring, on a rod that sticks out of a post."""
    ring = torus(0.016, 0.004)
    cloud = np.concatenate([ring, cylinder(0.035, 0.08, axis=2, centre=[0, 0.055, 0])])
    angles = np.linspace(0, 2 * np.pi, 11)[:-1]
    points = np.stack(
        [0.004 * np.cos(3 * angles), 0.016 * np.cos(angles), 0.016 * np.sin(angles)], axis=1
    )
    rod = cylinder(0.005, 0.12, axis=0, centre=[0.072, 0, 0.25], spacing=0.003)
    post = cylinder(0.012, 0.32, axis=2, centre=[0, 0, 0.16])
    path = [at(0.3, 0.1, 0.3), at(0.2, 0, 0.25), at(0.06, 0, 0.25), at(0.06, 0, 0.2445)]
    return Scene(
        np.concatenate([rod, post]),
        cloud,
        points,
        demonstration(points, path),
        np.array([-0.3, -0.3, 0.1]),
        np.array([0.4, 0.3, 0.45]),
    )


def shelf_scene():
    """A book stands under a board and is put on top of it."""
    size = np.array([0.12, 0.15, 0.03])
    cloud = box(size, [0, 0, 0], 0.006)
    points = np.array(
        [[-0.06, y, z] for y in (-0.075, 0.0, 0.075) for z in (-0.015, 0.015)]
        + [[-0.02, y, 0.0] for y in (-0.075, 0.075)]
    )
    board = box([0.24, 0.4, 0.02], [0.12, 0, 0.05])
    path = [at(0.12, 0, 0.016), at(-0.14, 0, 0.016), at(-0.14, 0, 0.15), at(0.1, 0, 0.15)]
    path += [at(0.12, 0, 0.077)]
    return Scene(
        board,
        cloud,
        points,
        demonstration(points, path),
        np.array([-0.3, -0.3, 0.06]),
        np.array([0.35, 0.3, 0.4]),
    )
