"""Search of an object's pose among many, by depth and colour.

An object that falls, swings or is pushed is, a frame later, where no prediction led. Then many
poses around what is known are compared with the images at a few model points each, the best
of them are varied in ever smaller steps, and what remains are a few poses to align from. All poses
of a round are scored at once in whole arrays, so that thousands of them cost as much as one or two
alignments.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from poil_drake.geometry.rigid_transform import inverse, rotation_exp
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.trackers.rigid_flow.alignment.depth_term import OrientedPoints
from poil_drake.perception.trackers.rigid_flow.appearance_model import (
    contradiction,
    likeness,
    observe,
)
from poil_drake.perception.trackers.rigid_flow.config import RigidFlowConfig, SearchConfig
from poil_drake.perception.trackers.rigid_flow.object_model import ObjectModel

_NEAREST = 0.05  # what is nearer to a camera than this is not in its view [m]


@dataclass(frozen=True)
class Guess:
    """Where to search.

    Attributes:
        X_WO: (4, 4) pose of the object.
        angular: Standard deviation about it, about each axis of the object [rad].
        linear: Likewise along each axis [m].
    """

    X_WO: np.ndarray
    angular: float
    linear: float


def search(
    model: ObjectModel,
    frame: MultiViewFrame,
    guesses: Sequence[Guess],
    draw: int,
    config: RigidFlowConfig,
) -> list[np.ndarray]:
    """Returns the poses (4, 4) around some guesses that the views speak for most, the best first.

    Args:
        model: The object.
        frame: The views.
        guesses: Where to search; each gets an equal share of the poses.
        draw: Seed of the poses that are drawn: the same draws the same.
        config: Parameters.
    """
    sizes = config.search
    rng = np.random.default_rng(draw)
    points = _spread_choice(model.aligned, sizes.points)
    centres = np.stack([guess.X_WO[:3, 3] for guess in guesses])
    reach = model.radius + 2.0 * max(guess.linear for guess in guesses)
    seen = observe(model.appearance, frame, centres, reach, config.appearance)

    def score(poses: np.ndarray, gate: float) -> np.ndarray:
        surface = score_poses(points, frame, poses, gate, config)
        explained, vacant = contradiction(
            model.appearance, seen, poses, model.radius, config.appearance
        )
        # With few pixels that are surely the object's, they do not say much.
        elsewhere = (explained - vacant) / (seen.weights.sum() + config.appearance.few_observed)
        return surface + sizes.elsewhere * elsewhere

    share = sizes.drawn // len(guesses)
    poses = np.concatenate(
        [g.X_WO @ _motions(rng, share, g.angular, g.linear) for g in guesses]
        + [np.stack([g.X_WO for g in guesses])]
    )
    scores = score(poses, sizes.gates[0])
    angular, linear = sizes.angular, sizes.linear
    for gate in sizes.gates[1:]:
        best = poses[np.argsort(-scores, kind="stable")[: sizes.kept]]
        motions = _motions(rng, len(best) * sizes.varied, angular, linear)
        poses = np.concatenate([best, np.repeat(best, sizes.varied, axis=0) @ motions])
        scores = score(poses, gate)
        angular, linear = 0.5 * angular, 0.5 * linear
    return _distinct(poses[np.argsort(-scores, kind="stable")], sizes)


def score_poses(
    surface: OrientedPoints,
    frame: MultiViewFrame,
    poses: np.ndarray,
    gate: float,
    config: RigidFlowConfig,
) -> np.ndarray:
    """Returns how well depth and colour bear out each pose: the points seen less those missing.

    Args:
        surface: K points of the object.
        frame: The views.
        poses: (P, 4, 4) poses of the object in the world.
        gate: Points this far from the measured surface count no more [m].
        config: When a point is hidden, and which colours are the same.

    Returns:
        (P,) the mean over the points that face a camera and have depth, and over some of no weight
        where these are few: up to 1 for a point that is measured where it should be and in its
        colour, 0 for one that something hides, -1/2 for one behind what may touch it, -1 otherwise.
    """
    quality = config.quality
    total, looked_at = np.zeros(len(poses)), np.zeros(len(poses))
    points, normals, offsets = (
        x.astype(np.float32) for x in (surface.points, surface.normals, surface.offsets)
    )
    for camera, image in zip(frame.cameras, frame.images, strict=True):
        X_CO = (inverse(camera.X_WC) @ poses).astype(np.float32)
        R, origin = X_CO[:, :3, :3], X_CO[:, :3, 3]
        eye = -np.einsum("pij,pi->pj", R, origin)
        z = R[:, 2] @ points.T + origin[:, 2:]
        facing = eye @ normals.T - offsets
        # Most points face away; only for the others the rest is worth its while.
        pose, point = np.nonzero((facing > np.float32(quality.min_cosine) * z) & (z > _NEAREST))
        z, facing = z[pose, point], facing[pose, point]
        shown = points[point]
        x, y = (np.einsum("mi,mi->m", R[pose, axis], shown) + origin[pose, axis] for axis in (0, 1))
        per_z = 1.0 / z
        fx, fy, cx, cy = (camera.K[i] for i in ((0, 0), (1, 1), (0, 2), (1, 2)))
        # Half a pixel more, as the conversion to integers rounds down.
        u = (x * per_z * np.float32(fx) + np.float32(cx + 0.5)).astype(np.int32)
        v = (y * per_z * np.float32(fy) + np.float32(cy + 0.5)).astype(np.int32)
        inside = (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
        pixel = np.where(inside, v * camera.width + u, 0)
        depth = np.where(inside, image.depth.ravel()[pixel], 0.0)
        behind = depth - z
        residual = facing * behind * per_z * np.float32(1.0 / gate)
        near = 1.0 - residual * residual
        value = np.where(behind > 0.0, np.float32(-1.0), np.float32(-0.5))
        value[behind < -quality.hidden_error] = 0.0
        on = np.flatnonzero((near > 0.0) & (depth > 0.0))
        alike = likeness(
            image.rgb.reshape(-1, 3)[pixel[on]], surface.features[:, point[on]], config.appearance
        )
        value[on] = np.where(alike > 0.0, near[on] * alike, alike)
        value[depth == 0.0] = 0.0
        total += np.bincount(pose, value, minlength=len(poses))
        looked_at += np.bincount(pose, depth > 0.0, minlength=len(poses))
    return total / np.maximum(looked_at, quality.enough_points * len(surface.points))


def _spread_choice(surface: OrientedPoints, count: int) -> OrientedPoints:
    """Returns about so many of the points, evenly by index."""
    wanted = min(count, len(surface.points))
    return surface.select(np.linspace(0, len(surface.points) - 1, wanted).astype(np.intp))


def _motions(rng: np.random.Generator, count: int, angular: float, linear: float) -> np.ndarray:
    """Draws motions (count, 4, 4) of the object in its own frame, most of them small."""
    motions = rng.standard_normal((count, 6))
    # From nothing to the whole deviation: near poses are likelier, and are needed more exactly.
    motions *= np.linspace(0.2, 1.0, count)[:, None]
    X = np.zeros((count, 4, 4))
    X[:, :3, :3] = rotation_exp(motions[:, :3] * angular)
    X[:, :3, 3] = motions[:, 3:] * linear
    X[:, 3, 3] = 1.0
    return X


def _distinct(poses: np.ndarray, config: SearchConfig) -> list[np.ndarray]:
    """Returns the first poses of (P, 4, 4) that are not much the same as one before them."""
    chosen: list[np.ndarray] = []
    for X in poses:
        same = (
            np.linalg.norm(X[:3, 3] - Y[:3, 3]) < config.distinct_linear
            and np.trace(Y[:3, :3].T @ X[:3, :3]) > 1.0 + 2.0 * np.cos(config.distinct_angular)
            for Y in chosen
        )
        if not any(same):
            chosen.append(X)
        if len(chosen) == config.aligned:
            break
    return chosen
