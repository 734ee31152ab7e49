"""Searches for the placements of a known shape that fit a cluster of points best."""

from dataclasses import dataclass

import numpy as np

from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.geometry.rigid_transform import rotation_exp
from poil_drake.geometry.rotation_grid import super_fibonacci_rotations
from poil_drake.perception.detectors.known_shape.shape_fit import KnownShape, Placements, ShapeFit
from poil_drake.perception.images import MultiViewFrame

_HEADINGS, _PER_HEADING = 48, 5  # about the vertical: most objects stand as they did
_ORIENTATIONS = 1500
_COARSE_POINTS, _FINE_POINTS = 450, 900  # of each cloud
_COARSE_ROUNDS = 7
_KEPT, _VARIED = 120, 12  # placements that survive the first round, and variants of each
_FEWEST = 30  # placements that survive the last coarse round
_MODES = 16  # that are refined
_DESCENT_STEPS = 15
_STEPS = np.repeat([0.03, 0.03, 0.003], 3)  # in rotation [rad], log scale, position [m]
_DAMPING = 1e-5  # of the first step
_HOPELESS = 0.5  # cost above which placements are not refined
_PLAUSIBLE = 0.35  # cost below which the best placements are refined once more
_RETRIED, _RETRIES = 5, 8  # modes, and descents from around each
_RETRY = np.array([0.2, 0.006, 0.08])  # deviations of their starts, as in _START
_CERTAIN = 0.06  # cost below which an expected placement is right
_SHARES = np.array([1.0, 0.5, 0.2, 0.05])  # of a step that are tried
_MODE_ANGLE, _MODE_DISTANCE = np.deg2rad(30.0), 0.02  # [rad, m]; nearer placements are one mode
_START = np.array([0.25, 0.012, 0.12])  # deviations in rotation [rad], position [m], log scale
_SHRINK = 0.65  # of the deviations, from round to round
_ASPECT_SHARE = 0.6  # of the deviation of the scale: that of each axis's own scale
_SCALES = np.log([0.45, 2.2])
_SEVERAL, _SEVERAL_TIMES = np.log(1.35), 4  # a cluster this much larger has more starts
_STANDS = 0.02  # a cluster whose lowest point is at most this far above the table stands on it [m]


@dataclass(frozen=True, eq=False)
class FoundShape:
    """A shape in a scene.

    Attributes:
        placements: The best placement of each mode, best first.
        costs: (K,) their costs.
        fit: The cost function.
    """

    placements: Placements
    costs: np.ndarray
    fit: ShapeFit

    def part_centers(self) -> np.ndarray:
        """Returns where each mode places the part's centroid, (K, 3) [m, world]."""
        return _part_centers(self.fit.shape, self.placements)


def search_shape(
    shape: KnownShape,
    frame: MultiViewFrame,
    cluster: PointCloud,
    *,
    table_height: float,
    rigid: bool = False,
    expected: Placements | None = None,
) -> FoundShape:
    """Returns the ways in which a shape fits a cluster.

    Random placements with all orientations are varied, and the best survive, with ever smaller
    variations; the draw is always the same. Modes, which differ in orientation or in where the part
    is, are refined one by one.

    Args:
        shape: The shape.
        frame: The views.
        cluster: The points, with normals [m, world].
        table_height: Height of the plane on which objects stand [m, world].
        rigid: Whether the shape keeps its size.
        expected: Where the shape probably is. If it fits well there, nothing else is searched.
    """
    rng = np.random.default_rng(0)
    stretch = 0.0 if rigid else 1.0
    fine = ShapeFit(shape, frame, cluster, table_height=table_height, count=_FINE_POINTS)
    if expected is not None:
        near = _descended(fine, expected, stretch)
        if (costs := fine.cost(near))[0] < _CERTAIN:
            return FoundShape(near, costs, fine)
    coarse = ShapeFit(shape, frame, cluster, table_height=table_height, count=_COARSE_POINTS)
    placed = _first(shape, cluster.points, table_height, stretch, rng)
    costs = coarse.cost(placed)
    deviations, kept = _START, _KEPT
    for _ in range(_COARSE_ROUNDS):
        best = _diverse(placed, np.argsort(costs, kind="stable"), kept)
        placed, costs = placed.select(best), costs[best]
        new = _varied(placed, _VARIED, deviations, stretch, rng)
        placed, costs = placed.joined(new), np.concatenate([costs, coarse.cost(new)])
        deviations, kept = _SHRINK * deviations, max(_FEWEST, kept * 3 // 4)
    if costs.min() > _HOPELESS:
        best = np.array([np.argmin(costs)])
        return FoundShape(placed.select(best), costs[best], fine)
    modes = placed.select(np.array(_modes(shape, placed, np.argsort(costs, kind="stable"))))
    modes = _descended(fine, modes, stretch)
    costs = fine.cost(modes)
    if costs.min() < _PLAUSIBLE:
        # Descents end in local minima, so the best modes are descended again from around them.
        order = np.argsort(costs, kind="stable")
        few = modes.select(np.array(_modes(shape, modes, order)[:_RETRIED]))
        again = _varied(few, _RETRIES, _RETRY, stretch, rng)
        modes = modes.joined(_descended(fine, again, stretch))
    costs = fine.cost(modes)
    order = np.argsort(costs, kind="stable")
    return FoundShape(modes.select(order), costs[order], fine)


def _first(
    shape: KnownShape,
    cluster: np.ndarray,
    table_height: float,
    stretch: float,
    rng: np.random.Generator,
) -> Placements:
    """Returns placements in all orientations, in the cluster's middle or on the table below it."""
    headings = np.arange(_HEADINGS) * (2.0 * np.pi / _HEADINGS)
    standing = rotation_exp(headings[:, None] * [0.0, 0.0, 1.0])
    R = np.concatenate(
        [np.repeat(standing, _PER_HEADING, axis=0), super_fibonacci_rotations(_ORIENTATIONS)]
    )
    size = np.log(_radius(cluster) / _radius(shape.cloud.points[~shape.guessed]))
    if size > _SEVERAL:
        # Several objects that touch: the shape has its usual size and may be anywhere in them.
        R, size = np.tile(R, (_SEVERAL_TIMES, 1, 1)), 0.0
    sizes = np.clip(size + _START[2] * rng.standard_normal((len(R), 1)), *_SCALES) * stretch
    placed = Placements(R, np.repeat(sizes, 3, axis=1), np.zeros((len(R), 3)))
    points = placed.apply(shape, shape.cloud.points[:: max(len(shape.cloud) // 300, 1)])
    low, high = points.min(axis=1), points.max(axis=1)
    lower, upper = cluster.min(axis=0), cluster.max(axis=0)
    slack = np.maximum(0.5 * ((upper - lower) - (high - low)), 0.0)
    t = 0.5 * (lower + upper) - 0.5 * (low + high) + slack * rng.uniform(-1.0, 1.0, slack.shape)
    t += _START[1] * 0.5 * rng.standard_normal(t.shape)
    if lower[2] < table_height + _STANDS:
        t[:, 2] = table_height - low[:, 2]
    return Placements(R, placed.log_scales, t)


def _radius(points: np.ndarray) -> float:
    return float(np.sqrt(points.var(axis=0).sum()))


def _varied(
    placed: Placements,
    count: int,
    deviations: np.ndarray,
    stretch: float,
    rng: np.random.Generator,
) -> Placements:
    """Returns `count` random variants of each placement."""
    n = count * len(placed)
    angular, linear, scale = deviations
    turns = angular * rng.standard_normal((n, 3)) * rng.uniform(0.1, 1.0, (n, 1))
    own = rng.standard_normal((n, 1)) + _ASPECT_SHARE * rng.standard_normal((n, 3))
    return Placements(
        rotation_exp(turns) @ np.repeat(placed.R, count, axis=0),
        np.clip(
            np.repeat(placed.log_scales, count, axis=0) + stretch * scale * own,
            *(_SCALES * stretch),
        ),
        np.repeat(placed.t, count, axis=0) + linear * rng.standard_normal((n, 3)),
    )


def _diverse(placed: Placements, order: np.ndarray, count: int) -> np.ndarray:
    """Returns the first `count` indices of an order, only few of them with similar rotations."""
    axes = np.concatenate([placed.R[:, :, 0], placed.R[:, :, 2]], axis=1)
    cells = [tuple(cell) for cell in np.rint(2.0 * axes).astype(int).tolist()]
    most, taken, chosen = max(2, count // 40), dict[tuple[int, ...], int](), list[int]()
    for k in order.tolist():
        if taken.get(cells[k], 0) < most:
            taken[cells[k]] = taken.get(cells[k], 0) + 1
            chosen.append(k)
        if len(chosen) == count:
            break
    return np.array(chosen)


def _part_centers(shape: KnownShape, placed: Placements) -> np.ndarray:
    center = shape.cloud.points[shape.part].mean(axis=0)
    return placed.apply(shape, center[None])[:, 0]


def _modes(shape: KnownShape, placed: Placements, order: np.ndarray) -> list[int]:
    """Returns the first index of each mode in an order, for the first modes."""
    centers, chosen = _part_centers(shape, placed), list[int]()
    for k in order.tolist():
        if all(
            np.linalg.norm(centers[k] - centers[j]) > _MODE_DISTANCE
            or np.trace(placed.R[k].T @ placed.R[j]) < 1.0 + 2.0 * np.cos(_MODE_ANGLE)
            for j in chosen
        ):
            chosen.append(k)
        if len(chosen) == _MODES:
            break
    return chosen


def _descended(fit: ShapeFit, placed: Placements, stretch: float) -> Placements:
    """Returns placements after Levenberg-Marquardt descent of each.

    The clouds are sampled in steps of millimetres, so derivatives are differences over such steps.
    """
    count, numbers = len(placed), np.arange(len(placed))
    steps = np.diag(_STEPS * np.repeat([1.0, stretch, 1.0], 3))
    steps = np.concatenate([np.zeros((1, 9)), steps, -steps])
    damping, cost = np.full(count, _DAMPING), fit.cost(placed)
    for _ in range(_DESCENT_STEPS):
        around = fit.residuals(_moved(placed, np.tile(steps, (count, 1, 1)), stretch))
        around = around.reshape(count, 19, -1)
        J = (around[:, 1:10] - around[:, 10:]) / (2.0 * _STEPS[:, None])
        H = J @ np.swapaxes(J, 1, 2) + damping[:, None, None] * np.diag(_STEPS**-2.0)
        step = -np.linalg.solve(H, J @ around[:, 0, :, None])[..., 0]
        tried = _moved(placed, _SHARES[:, None] * step[:, None], stretch)
        costs = fit.cost(tried).reshape(count, -1)
        best = np.argmin(costs, axis=1)
        better = costs[numbers, best] < cost
        index = np.where(better, count + len(_SHARES) * numbers + best, numbers)
        placed = placed.joined(tried).select(index)
        cost = np.where(better, costs[numbers, best], cost)
        damping = np.where(better, 0.5, 5.0) * damping
    return placed


def _moved(placed: Placements, steps: np.ndarray, stretch: float) -> Placements:
    """Returns placements after steps (K, S, 9) in rotation, logarithmic scales and position."""
    count = steps.shape[1]
    flat = steps.reshape(-1, 9)
    return Placements(
        rotation_exp(flat[:, :3]) @ np.repeat(placed.R, count, axis=0),
        np.clip(np.repeat(placed.log_scales, count, axis=0) + flat[:, 3:6] * stretch, *_SCALES),
        np.repeat(placed.t, count, axis=0) + flat[:, 6:],
    )
