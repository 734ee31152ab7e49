"""A mug on a table, ray-cast by formulas: exact depth, colour and masks."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
import pytest

from poil_drake.geometry.rigid_transform import inverse, make_transform, transform_points
from poil_drake.perception.depth_noise import StereoDepthNoiseConfig, apply_stereo_depth_noise
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.perception.trackers.protocol import TrackerOutput
from poil_drake.perception.trackers.rigid_flow.config import RigidFlowConfig
from poil_drake.perception.trackers.rigid_flow.object_model import ObjectModel, build_model
from poil_drake.perception.trackers.rigid_flow.tracker import RigidFlowTracker

WIDTH, HEIGHT = 320, 240
K = np.array([[330.0, 0, 159.5], [0, 330.0, 119.5], [0, 0, 1.0]])
RADIUS, INNER, TALL, FLOOR = 0.040, 0.036, 0.095, 0.006
HANDLE = np.array([[0.038, -0.006, 0.02], [0.070, 0.006, 0.075]])  # a box: lower, upper corner
HOLE = np.array([[0.040, -0.007, 0.03], [0.060, 0.007, 0.065]])  # cut out of it
NO_HIT = 1e3
MUG_GREY = 170


class Shot(NamedTuple):
    """A frame, and the mug's mask in each view."""

    frame: MultiViewFrame
    masks: tuple[np.ndarray, ...]


class MugScene(NamedTuple):
    """A mug. Its frame M is at the middle of its foot, with the handle along +x."""

    shoot: Callable[..., Shot]
    start: np.ndarray
    handle_points: np.ndarray
    grey: int

    def error(self, output: TrackerOutput, X_WM: np.ndarray) -> float:
        """Returns the largest distance of a tracked handle point from its true position [m]."""
        truth = transform_points(X_WM @ inverse(self.start), self.handle_points)
        return np.linalg.norm(output.points.positions - truth, axis=1).max()


class TrackedMug:
    """A tracker (`dut`) that follows the mug at 8 frames a second, and its newest `output`."""

    def __init__(self, scene: MugScene, **options: object):
        """Starts at the mug's start, with options of `shoot` for all frames."""
        self._scene, self._options, self._count = scene, options, 0
        shot = scene.shoot(scene.start, **options)
        self.dut = RigidFlowTracker()
        self.output = self.dut.start(shot.frame, scene.handle_points, shot.masks)

    def frame(self, X_WM: np.ndarray, **options: object) -> MultiViewFrame:
        """Returns the next frame of the mug at a pose."""
        time = (self._count + 1) / 8
        return self._scene.shoot(X_WM, time=time, **(self._options | options)).frame

    def step(
        self, X_WM: np.ndarray, prior: np.ndarray | None = None, **options: object
    ) -> TrackerOutput:
        """Tracks into the next frame."""
        frame = self.frame(X_WM, **options)
        self._count += 1
        self.output = self.dut.step(self.output.state, frame, prior)
        return self.output


class BuiltMug(NamedTuple):
    """The model of a mug without noise, its pose, and the frame that it was built from."""

    model: ObjectModel
    X_WO: np.ndarray
    frame: MultiViewFrame


def look_at(eye: list[float], target: list[float]) -> np.ndarray:
    z = np.subtract(target, eye) / np.linalg.norm(np.subtract(target, eye))
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    return make_transform(np.stack([x, np.cross(z, x), z], axis=1), np.array(eye))


CAMERAS = (
    CameraModel("left", WIDTH, HEIGHT, K, look_at([0.62, 0.42, 0.45], [0.45, 0.0, 0.08])),
    CameraModel("right", WIDTH, HEIGHT, K, look_at([0.62, -0.42, 0.45], [0.45, 0.0, 0.08])),
)


def wall(eye, rays, radius, low, high):
    """Both hits of an upright cylinder's wall, (2, n)."""
    a = rays[:, 0] ** 2 + rays[:, 1] ** 2
    b = rays[:, :2] @ eye[:2]
    root = np.sqrt(np.maximum(b * b - a * (eye[:2] @ eye[:2] - radius**2), -1.0) + 0j)
    hits = np.stack([(-b - root.real) / a, (-b + root.real) / a])
    z = eye[2] + hits * rays[:, 2]
    return np.where((root.imag == 0) & (z > low) & (z < high) & (hits > 0), hits, NO_HIT)


def ring(eye, rays, height, inner, outer):
    """Hits of a level ring, (1, n)."""
    hits = (height - eye[2]) / np.where(rays[:, 2] == 0.0, 1e-9, rays[:, 2])
    r = np.linalg.norm(eye[:2] + hits[:, None] * rays[:, :2], axis=1)
    return np.where((r > inner) & (r < outer) & (hits > 0), hits, NO_HIT)[None]


def box(eye, rays, corners):
    """Where rays enter and leave a box, (2, n); entering after leaving is a miss."""
    with np.errstate(divide="ignore", invalid="ignore"):
        planes = (corners[:, None, :] - eye) / rays
    enter, leave = planes.min(axis=0).max(axis=1), planes.max(axis=0).min(axis=1)
    return np.stack([np.where(enter < leave, enter, NO_HIT), np.where(enter < leave, leave, 0.0)])


def handle(eye, rays):
    """Hits of a box with a hole through it, (1, n)."""
    enter, leave = box(eye, rays, HANDLE)
    hole_enter, hole_leave = box(eye, rays, HOLE)
    in_hole = (hole_enter <= enter) & (enter < hole_leave)
    hits = np.where(in_hole, np.where(hole_leave < leave, hole_leave, NO_HIT), enter)
    return np.where(hits > 0.0, hits, NO_HIT)[None]


def mug_depth(camera, X_WM, rays, *, with_handle):
    eye = inverse(X_WM) @ camera.X_WC[:, 3]
    rays_M = rays @ (X_WM[:3, :3].T @ camera.X_WC[:3, :3]).T
    parts = [
        wall(eye[:3], rays_M, RADIUS, 0.0, TALL),
        wall(eye[:3], rays_M, INNER, FLOOR, TALL),
        ring(eye[:3], rays_M, TALL, INNER, RADIUS),
        ring(eye[:3], rays_M, FLOOR, 0.0, INNER),
        ring(eye[:3], rays_M, 0.0, 0.0, RADIUS),
    ]
    parts += [handle(eye[:3], rays_M)] if with_handle else []
    depth = np.concatenate(parts).min(axis=0)
    return depth, eye[:3] + depth[:, None] * rays_M


def texture(points_M, seed):
    """Grey levels of a patchwork around the mug, 9 mm by 12 degrees a patch."""
    shades = np.random.default_rng(seed).integers(40, 230, size=(12, 30))
    column = np.floor((np.arctan2(points_M[:, 1], points_M[:, 0]) / (2 * np.pi) % 1.0) * 30)
    row = np.floor(points_M[:, 2] / 0.009)
    return shades[row.astype(int) % 12, column.astype(int) % 30]


def shoot(
    X_WM,
    *,
    time=0.0,
    textured=False,
    with_handle=True,
    noisy=False,
    boxes=(),
    box_grey=60,
    present=True,
):
    """Renders the mug at X_WM, the table, and boxes ((lower, upper), X_WB)."""
    images, masks = [], []
    for view, camera in enumerate(CAMERAS):
        v, u = np.mgrid[:HEIGHT, :WIDTH]
        rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(u.shape)], -1)
        rays = rays.reshape(-1, 3)
        down = rays @ camera.X_WC[2, :3]
        depth = np.where(down < 0.0, -camera.X_WC[2, 3] / np.minimum(down, -1e-6), NO_HIT)
        grey = np.full(depth.shape, 120)
        mask = np.zeros(depth.shape, dtype=bool)
        if present:
            mug, points_M = mug_depth(camera, X_WM, rays, with_handle=with_handle)
            mask = mug < depth
            shade = texture(points_M[mask], 3) if textured else MUG_GREY
            grey[mask], depth = shade, np.minimum(depth, mug)
        for corners, X_WB in boxes:
            eye = (inverse(X_WB) @ camera.X_WC[:, 3])[:3]
            hit = box(eye, rays @ (X_WB[:3, :3].T @ camera.X_WC[:3, :3]).T, np.array(corners))[0]
            mask &= hit >= depth
            grey[hit < depth], depth = box_grey, np.minimum(depth, hit)
        depth = np.where(depth < 2.0, depth, 0.0).astype(np.float32).reshape(HEIGHT, WIDTH)
        if noisy:
            seed = (view, round(time * 8))
            depth = apply_stereo_depth_noise(depth, StereoDepthNoiseConfig(), seed)
        rgb = np.repeat(grey.astype(np.uint8).reshape(HEIGHT, WIDTH, 1), 3, axis=2)
        images.append(RgbdImage(rgb, depth, time))
        masks.append(mask.reshape(HEIGHT, WIDTH))
    return Shot(MultiViewFrame(CAMERAS, tuple(images)), tuple(masks))


@pytest.fixture(scope="session")
def mug_scene() -> MugScene:
    """A mug on a table in the view of two cameras, with its handle in both views."""
    start = make_transform(np.eye(3), np.array([0.45, 0.0, 0.0]))
    corners = np.array(
        [[x, y, z] for x in (0.064, 0.07) for y in (-0.006, 0.006) for z in (0.03, 0.065)]
    )
    return MugScene(shoot, start, transform_points(start, corners), MUG_GREY)


@pytest.fixture(scope="session")
def tracked(mug_scene: MugScene) -> Callable[..., TrackedMug]:
    """Starts to track the mug, with options of `shoot`."""
    return partial(TrackedMug, mug_scene)


def build(scene: MugScene, **options: object) -> BuiltMug:
    shot = scene.shoot(scene.start, **options)
    model, X_WO = build_model(shot.frame, scene.handle_points, shot.masks, RigidFlowConfig())
    return BuiltMug(model, X_WO, shot.frame)


@pytest.fixture(scope="session")
def built_mug(mug_scene: MugScene) -> BuiltMug:
    return build(mug_scene)


@pytest.fixture(scope="session")
def textured_mug(mug_scene: MugScene) -> BuiltMug:
    return build(mug_scene, textured=True)
