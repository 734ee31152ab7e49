"""Things made of boxes: their surfaces, and the depth images that cameras take of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.geometry.rigid_transform import (
    inverse,
    make_transform,
    rotation_exp,
    transform_points,
)
from poil_drake.perception.detectors.known_shape.shape_fit import KnownShape
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage


@dataclass(frozen=True, eq=False)
class Box:
    """A box with its centre at `X` (4, 4) [m], and half its edges' lengths [m]."""

    X: np.ndarray
    half: np.ndarray


Boxes = tuple[Box, ...]
Masks = tuple[np.ndarray, ...]


def box(center: Sequence[float], half: Sequence[float]) -> Box:
    return Box(make_transform(np.eye(3), np.array(center)), np.array(half))


def pose(x: float, y: float, z: float = 0.0, *, yaw: float = 0.0) -> np.ndarray:
    """Returns a pose (4, 4) from a position [m] and a turn about the vertical [deg]."""
    return make_transform(rotation_exp(np.array([0.0, 0.0, np.deg2rad(yaw)])), np.array([x, y, z]))


def placed(boxes: Boxes, X: np.ndarray, *, size: float = 1.0) -> Boxes:
    """Returns boxes that are first scaled about the origin, and then moved by X (4, 4)."""
    return tuple(
        Box(X @ make_transform(b.X[:3, :3], size * b.X[:3, 3]), size * b.half) for b in boxes
    )


BODY: Boxes = (box([0.0, 0.0, 0.04], [0.03, 0.03, 0.04]),)
HANDLE: Boxes = (
    box([0.045, 0.0, 0.06], [0.015, 0.0025, 0.0025]),
    box([0.06, 0.0, 0.04], [0.0025, 0.0025, 0.0225]),
    box([0.045, 0.0, 0.02], [0.015, 0.0025, 0.0025]),
)
CUP = BODY + HANDLE
"""A cup that stands at the origin, with a handle towards +x, whose hole's axis is y."""

ROD = box([0.0, 0.15, 0.22], [0.004, 0.05, 0.004])
RACK: Boxes = (box([0.0, 0.2, 0.15], [0.01, 0.01, 0.15]), ROD)

# The handle is up, and the inner side of its outermost bar, at x = 57.5 mm, lies on the rod.
HUNG = make_transform(
    np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]), np.array([0.04, 0.12, 0.1665])
)
"""The cup's pose (4, 4) on the rack."""

BLOCK: Boxes = (box([0.0, 0.0, 0.03], [0.04, 0.025, 0.03]),)

_TABLE = box([0.0, 0.0, -0.05], [1.0, 1.0, 0.05])
_WIDTH, _HEIGHT, _FOCAL = 320, 240, 400.0


def camera(name: str, eye: Sequence[float], at: Sequence[float] = (0.0, 0.03, 0.08)) -> CameraModel:
    """Returns a camera at `eye` that looks at a point [m, world]; up is up in its images."""
    z = np.subtract(at, eye)
    z = z / np.linalg.norm(z)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    K = np.array([[_FOCAL, 0.0, _WIDTH / 2], [0.0, _FOCAL, _HEIGHT / 2], [0.0, 0.0, 1.0]])
    X_WC = make_transform(np.stack([x, np.cross(z, x), z], axis=1), np.array(eye, dtype=float))
    return CameraModel(name, _WIDTH, _HEIGHT, K, X_WC)


CAMERAS = (camera("left", [0.5, -0.4, 0.45]), camera("right", [0.5, 0.45, 0.45]))


@dataclass(frozen=True, eq=False)
class Picture:
    """A frame, and each thing's masks in its views."""

    frame: MultiViewFrame
    masks: Mapping[str, Masks]


def picture(
    things: Mapping[str, Boxes],
    *,
    cameras: Sequence[CameraModel] = CAMERAS,
    stamp: float = 0.0,
) -> Picture:
    """Returns what cameras see of things on a table, whose top is at height 0."""
    boxes = [(name, b) for name, own in things.items() for b in own]
    images, masks = [], {name: list[np.ndarray]() for name in things}
    for model in cameras:
        depths = np.stack([_depth(model, b) for b in (_TABLE, *(b for _, b in boxes))])
        nearest = depths.argmin(axis=0)
        depth = depths.min(axis=0)
        depth[np.isinf(depth)] = 0.0
        images.append(RgbdImage(np.zeros((*depth.shape, 3)), depth, stamp))
        for name in things:
            own = [k for k, (other, _) in enumerate(boxes, start=1) if other == name]
            masks[name].append(np.isin(nearest, own))
    frame = MultiViewFrame(tuple(cameras), tuple(images))
    return Picture(frame, {name: tuple(own) for name, own in masks.items()})


def _depth(model: CameraModel, box: Box) -> np.ndarray:
    """Returns the depth (H, W) of a box along the optical axis; infinite beside it."""
    v, u = np.mgrid[: model.height, : model.width]
    rays = np.linalg.solve(model.K, np.stack([u, v, np.ones_like(u)]).reshape(3, -1)).T
    X_BC = inverse(box.X) @ model.X_WC
    with np.errstate(divide="ignore", invalid="ignore"):
        # The ray crosses each pair of parallel planes at two depths.
        crossings = (np.array([[-1.0], [1.0]]) * box.half - X_BC[:3, 3])[:, None] / (
            rays @ X_BC[:3, :3].T
        )
    enter, leave = crossings.min(axis=0).max(axis=1), crossings.max(axis=0).min(axis=1)
    hit = (enter < leave) & (enter > 0.0)
    return np.where(hit, enter, np.inf).reshape(model.height, model.width)


def surface(boxes: Boxes, *, step: float = 0.003) -> PointCloud:
    """Returns points on the surface of boxes that may touch, with their normals."""
    points, normals = [], []
    for b in boxes:
        for axis in range(3):
            others = [k for k in range(3) if k != axis]
            grids = [_steps(b.half[k], step) for k in others]
            first, second = (g.ravel() for g in np.meshgrid(*grids))
            for side in (-1.0, 1.0):
                own = np.zeros((first.size, 3))
                own[:, others[0]], own[:, others[1]], own[:, axis] = (
                    first,
                    second,
                    side * b.half[axis],
                )
                points.append(transform_points(b.X, own))
                normals.append(np.tile(side * b.X[:3, axis], (first.size, 1)))
    joined = np.concatenate(points)
    outside = np.all([~_inside(b, joined) for b in boxes], axis=0)
    return PointCloud(joined[outside], np.concatenate(normals)[outside])


def known_shape(rest: Boxes, part: Boxes) -> KnownShape:
    """Returns the shape of an object with a functional part, seen from all sides."""
    cloud = surface(rest + part)
    is_part = cKDTree(surface(part).points).query(cloud.points)[0] < 1e-9
    return KnownShape(cloud, is_part, np.zeros(len(cloud), dtype=bool))


def _steps(half: float, step: float) -> np.ndarray:
    count = max(2, int(np.ceil(2.0 * half / step)))
    return (np.arange(count) + 0.5) / count * 2.0 * half - half


def _inside(box: Box, points: np.ndarray) -> np.ndarray:
    own = transform_points(inverse(box.X), points)
    return np.all(np.abs(own) < box.half - 1e-9, axis=1)


def agreement(found: Masks, exact: Masks) -> tuple[float, float]:
    """Returns the precision and the recall of masks, over all views."""
    both = sum(int((a & b).sum()) for a, b in zip(found, exact, strict=True))
    return both / sum(int(a.sum()) for a in found), both / sum(int(b.sum()) for b in exact)
