"""Searches for the object's pose among many, by depth and colour.

An object that falls, swings or is pushed may be far from its predicted pose. Then many poses are
scored at a few model points each, the best poses are varied in ever smaller steps, and a few poses
remain, from which alignments start. Each round scores all its poses at once in arrays, so a search
over about a thousand poses costs as much as one or two alignments.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from poil_drake.geometry.rigid_transform import inverse, make_transform, rotation_exp
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.trackers.rigid_flow.alignment.depth_term import OrientedPoints
from poil_drake.perception.trackers.rigid_flow.appearance_model import color_similarity, observe
from poil_drake.perception.trackers.rigid_flow.free_space import FEW_OBSERVED
from poil_drake.perception.trackers.rigid_flow.object_model import ObjectModel
from poil_drake.perception.trackers.rigid_flow.rows import evenly_spaced
from poil_drake.perception.trackers.rigid_flow.track_quality import (
    ENOUGH_SHARE,
    MIN_COSINE,
    OCCLUDED_ERROR,
)

_NEAREST = 0.05  # closer points are not in view [m]

_POINTS = 128  # model points that are compared with depth
_DRAWN = 640  # poses that are drawn at first
_KEPT = 12  # best poses of a round, which are varied in the next
_VARIED = 20  # variations of each of them
_ANGULAR, _LINEAR = float(np.radians(10.0)), 0.01  # first variation [rad, m]; then halved
_GATES = (0.02, 0.012, 0.008)  # larger residuals do not count [m], one for each round
_ELSEWHERE_WEIGHT = 1.5  # of observed points, relative to the object's own surface

_MAX_FOUND = 2  # poses found; each costs an alignment
_SAME_ANGULAR, _SAME_LINEAR = float(np.radians(10.0)), 0.01  # closer poses are the same [rad, m]


@dataclass(frozen=True)
class SearchRegion:
    """A region of poses to search.

    Attributes:
        X_WO: (4, 4) pose of the object in the middle of the region.
        angular: Standard deviation of the poses about each axis of the object [rad].
        linear: Standard deviation of the poses along each axis of the object [m].
    """

    X_WO: np.ndarray
    angular: float
    linear: float


def search(
    model: ObjectModel, frame: MultiViewFrame, regions: Sequence[SearchRegion], seed: int
) -> list[np.ndarray]:
    """Returns the few poses (4, 4) that the views support most, the best first.

    Args:
        model: The model of the object.
        frame: The views.
        regions: Where to search; each region gets an equal share of the poses.
        seed: Seed of the random poses.
    """
    rng = np.random.default_rng(seed)
    points = model.aligned.select(evenly_spaced(len(model.aligned), _POINTS))
    centres = np.stack([region.X_WO[:3, 3] for region in regions])
    reach = model.radius + 2.0 * max(region.linear for region in regions)
    observed = observe(model.appearance, frame, centres, reach)

    def score(poses: np.ndarray, gate: float) -> np.ndarray:
        surface = score_poses(points, frame, poses, gate)
        explained, conflicting = model.appearance.free_space.conflict(observed, poses, model.radius)
        elsewhere = (explained - conflicting) / (observed.weights.sum() + FEW_OBSERVED)
        return surface + _ELSEWHERE_WEIGHT * elsewhere

    share = _DRAWN // len(regions)
    poses = np.concatenate(
        [region.X_WO @ _motions(rng, share, region.angular, region.linear) for region in regions]
        + [np.stack([region.X_WO for region in regions])]
    )
    scores = score(poses, _GATES[0])
    angular, linear = _ANGULAR, _LINEAR
    for gate in _GATES[1:]:
        best = poses[np.argsort(-scores, kind="stable")[:_KEPT]]
        motions = _motions(rng, len(best) * _VARIED, angular, linear)
        poses = np.concatenate([best, np.repeat(best, _VARIED, axis=0) @ motions])
        scores = score(poses, gate)
        angular, linear = 0.5 * angular, 0.5 * linear
    return _distinct(poses[np.argsort(-scores, kind="stable")])


def score_poses(
    surface: OrientedPoints,
    frame: MultiViewFrame,
    poses: np.ndarray,
    gate: float,
) -> np.ndarray:
    """Scores poses by depth and colour: points seen minus points missing.

    Args:
        surface: K points of the object.
        frame: The views.
        poses: (P, 4, 4) poses of the object in the world.
        gate: A point closer than this to the measured surface is in its place [m].

    Returns:
        (P,) the sum of the scores of the points that face a camera and have depth, divided by the
        number of these points or, if that is larger, by `ENOUGH_SHARE` of all points. A point
        in its place scores up to 1 if its colour agrees, and 0 to -1 if not. Any other point scores
        -1 if the camera sees through it, -1/2 if the measured surface is at most `OCCLUDED_ERROR`
        in front of it, and 0 if that is farther in front.
    """
    total, compared = np.zeros(len(poses)), np.zeros(len(poses))
    points, normals, offsets = (
        x.astype(np.float32) for x in (surface.points, surface.normals, surface.offsets)
    )
    for camera, image in zip(frame.cameras, frame.images, strict=True):
        X_CO = (inverse(camera.X_WC) @ poses).astype(np.float32)
        R, origin = X_CO[:, :3, :3], X_CO[:, :3, 3]
        eye = -np.einsum("pij,pi->pj", R, origin)
        z = R[:, 2] @ points.T + origin[:, 2:]
        facing = eye @ normals.T - offsets
        # Most points face away, so compute the rest only for those that do not.
        pose, point = np.nonzero((facing > np.float32(MIN_COSINE) * z) & (z > _NEAREST))
        z, facing = z[pose, point], facing[pose, point]
        shown = points[point]
        x, y = (np.einsum("mi,mi->m", R[pose, axis], shown) + origin[pose, axis] for axis in (0, 1))
        per_z = 1.0 / z
        fx, fy, cx, cy = (camera.K[i] for i in ((0, 0), (1, 1), (0, 2), (1, 2)))
        # Add half a pixel, since the conversion to integers rounds down.
        u = (x * per_z * np.float32(fx) + np.float32(cx + 0.5)).astype(np.int32)
        v = (y * per_z * np.float32(fy) + np.float32(cy + 0.5)).astype(np.int32)
        inside = (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
        pixel = np.where(inside, v * camera.width + u, 0)
        depth = np.where(inside, image.depth.ravel()[pixel], 0.0)
        behind = depth - z
        residual = facing * behind * per_z * np.float32(1.0 / gate)
        near = 1.0 - residual * residual
        value = np.where(behind > 0.0, np.float32(-1.0), np.float32(-0.5))
        value[behind < -OCCLUDED_ERROR] = 0.0
        on = np.flatnonzero((near > 0.0) & (depth > 0.0))
        similarity = color_similarity(
            image.rgb.reshape(-1, 3)[pixel[on]], surface.features[point[on]]
        )
        value[on] = np.where(similarity > 0.0, near[on] * similarity, similarity)
        value[depth == 0.0] = 0.0
        total += np.bincount(pose, value, minlength=len(poses))
        compared += np.bincount(pose, depth > 0.0, minlength=len(poses))
    return total / np.maximum(compared, ENOUGH_SHARE * len(surface))


def _motions(rng: np.random.Generator, count: int, angular: float, linear: float) -> np.ndarray:
    """Draws random motions (count, 4, 4) of the object in its own frame, most of them small."""
    motions = rng.standard_normal((count, 6))
    # Scales from 0.2 to 1: near poses are likelier and need a finer sampling.
    motions *= np.linspace(0.2, 1.0, count)[:, None]
    return make_transform(rotation_exp(motions[:, :3] * angular), motions[:, 3:] * linear)


def _distinct(poses: np.ndarray) -> list[np.ndarray]:
    """Returns the first `_MAX_FOUND` of the poses (P, 4, 4) that differ from one another."""
    chosen: list[np.ndarray] = []
    for X in poses:
        same = (
            np.linalg.norm(X[:3, 3] - Y[:3, 3]) < _SAME_LINEAR
            and np.trace(Y[:3, :3].T @ X[:3, :3]) > 1.0 + 2.0 * np.cos(_SAME_ANGULAR)
            for Y in chosen
        )
        if not any(same):
            chosen.append(X)
        if len(chosen) == _MAX_FOUND:
            break
    return chosen
