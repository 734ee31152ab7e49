"""Checks the depth of cameras against the table and against each other, and finds what is off.

The table shows errors of depth and height, but a scaled depth and a wrong height of the camera look
the same on it. Objects that two cameras see tell them apart: each explanation is undone, and the
one that leaves the clouds closest together is reported.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations, product

import numpy as np

from poil_drake.geometry.rigid_transform import (
    cross,
    make_transform,
    rotation_angle,
    rotation_exp,
    transform_points,
)
from poil_drake.perception.calibration.view_cloud import (
    BAND,
    Plane,
    ViewCloud,
    correspondences,
    find_table,
    looks_through,
)
from poil_drake.perception.images import MultiViewFrame

TOLERANCE = 0.003
"""Largest accepted distance of a camera's table from the true one, and disagreement of two clouds
[m]. Every grasp inherits an error here; noise alone makes up to 2 mm on small objects."""

_UNITS = (1e3, 100.0, 10.0, 4.0)  # Ratios of the units of depth that cameras send.
_UNIT_ERROR = 0.05  # A scale this close to such a ratio is a wrong unit (relative).
_FEWEST_PAIRS = 300  # Fewer corresponding points tell nothing.
_FAR = 0.01  # Larger distances of corresponding points count as this much [m].
_SIMILAR = 0.0004  # Explanations whose errors differ by less than this cannot be told apart [m].


@dataclass(frozen=True, eq=False)
class TableFit:
    """The table as one camera sees it.

    Attributes:
        offset: Mean height of the plane above the true table, over the points on it [m].
        deviation: 95th percentile of the distance of the plane from the true table there [m].
        tilt: Angle between the planes [rad].
        rms: RMS distance of the points from their plane [m].
    """

    offset: float
    deviation: float
    tilt: float
    rms: float

    @property
    def ok(self) -> bool:
        """Whether the table is where it should be."""
        return self.deviation <= TOLERANCE


@dataclass(frozen=True, eq=False)
class PairFit:
    """How the clouds of two cameras fit; infinite and NaN if they are too far apart to tell.

    Attributes:
        distance: Median distance of corresponding points along the normals, above the table [m].
        disagreement: RMS displacement of these points by the rigid motion of the first cloud that
            fits it to the second [m].
        shift: (3,) mean displacement of these points [m, world].
        turn: Angle of this motion [rad].
    """

    distance: float
    disagreement: float
    shift: np.ndarray
    turn: float

    @property
    def ok(self) -> bool:
        """Whether the clouds agree."""
        return self.disagreement <= TOLERANCE


@dataclass(frozen=True, kw_only=True)
class Cause:
    """A possible reason for a camera's wrong table.

    Attributes:
        kind: "scale" (true depth is `value` times the measured one), "bias" (true depth is `value`
            more than the measured one [m]) or "pose" (height, roll and pitch; `value` is the height
            by which the camera is too low [m]).
        value: See `kind`.
    """

    kind: str
    value: float


@dataclass(frozen=True, eq=False)
class DepthCheck:
    """The result of `check_depth`.

    Attributes:
        tables: Camera -> its table; None if it sees no plane that may be the table.
        pairs: Two cameras -> how they fit; None if they share too few surfaces above the table.
        causes: Camera -> what may be off, the likeliest first; only cameras whose table is off.
        table_height: The height at which all cameras see the table, if they agree that it is
            elsewhere [m]; otherwise None.
    """

    tables: Mapping[str, TableFit | None]
    pairs: Mapping[tuple[str, str], PairFit | None]
    causes: Mapping[str, tuple[Cause, ...]]
    table_height: float | None


def wrong_unit(scale: float) -> float | None:
    """Returns the ratio of two units of depth that a scale is close to, or None."""
    ratios = [*_UNITS, *(1.0 / ratio for ratio in _UNITS)]
    return next((r for r in ratios if abs(scale / r - 1.0) < _UNIT_ERROR), None)


def check_depth(frame: MultiViewFrame, table_height: float) -> DepthCheck:
    """Compares the depth of each camera with the table, and the cameras with each other.

    Args:
        frame: Images of a scene at rest.
        table_height: True height of the table [m, world].
    """
    clouds = [
        ViewCloud.of(camera, image)
        for camera, image in zip(frame.cameras, frame.images, strict=True)
    ]
    planes = [find_table(cloud, table_height) for cloud in clouds]
    tables = _table_fits(clouds, planes, table_height)
    pairs = {
        (first.name, second.name): _fit_pair(first, second, table_height)
        for first, second in combinations(clouds, 2)
    }
    off = [fit for fit in tables.values() if fit is not None and not fit.ok]
    if len(off) == len(clouds) > 1 and all(fit.ok for fit in pairs.values() if fit is not None):
        height = table_height + float(np.mean([fit.offset for fit in off]))
        if all(fit is not None and fit.ok for fit in _table_fits(clouds, planes, height).values()):
            return DepthCheck(tables, pairs, {}, height)
    return DepthCheck(tables, pairs, _find_causes(clouds, planes, tables, table_height), None)


def _table_fits(
    clouds: Sequence[ViewCloud], planes: Sequence[Plane | None], table_height: float
) -> dict[str, TableFit | None]:
    fits: dict[str, TableFit | None] = {}
    for cloud, plane in zip(clouds, planes, strict=True):
        fits[cloud.name] = None
        if plane is not None:
            points = cloud.points[plane.on]
            offsets = plane.height(points) - table_height
            fits[cloud.name] = TableFit(
                offset=float(offsets.mean()),
                deviation=float(np.percentile(np.abs(offsets), 95.0)),
                tilt=float(np.arccos(min(plane.normal[2], 1.0))),
                rms=float(np.sqrt(np.mean((points @ plane.normal - plane.d) ** 2))),
            )
    return fits


def _fit_pair(first: ViewCloud, second: ViewCloud, table_height: float) -> PairFit | None:
    """Aligns the first cloud with the second by ICP with distances along the normals."""
    p, q, normals = correspondences(first, second, table_height)
    if len(p) < _FEWEST_PAIRS:
        apart = looks_through(first, second, table_height)
        apart |= looks_through(second, first, table_height)
        return PairFit(np.inf, np.inf, np.full(3, np.nan), np.nan) if apart else None
    distance = float(np.median(np.abs(np.vecdot(normals, p - q))))
    start, moved, motion = p, first, np.eye(4)
    for _ in range(15):
        p, q, normals = correspondences(moved, second, table_height)
        if len(p) < _FEWEST_PAIRS:
            break
        errors = np.vecdot(normals, q - p)
        weights = np.sqrt(1.0 / (1.0 + (errors / TOLERANCE) ** 2))
        centre = p.mean(axis=0)
        A = weights[:, None] * np.concatenate([cross(p - centre, normals) / 0.1, normals], axis=1)
        # Motions that no surface shows, e.g. along a lone plane, stay zero.
        step = np.linalg.lstsq(A, weights * errors, rcond=0.05)[0]
        R = rotation_exp(step[:3] / 0.1)
        motion = make_transform(R, centre + step[3:] - R @ centre) @ motion
        moved = replace(first, X_WC=motion @ first.X_WC)
        if np.abs(step).max() < 1e-5:
            break
    displacement = transform_points(motion, start) - start
    return PairFit(
        distance=distance,
        disagreement=float(np.sqrt(np.mean(np.sum(displacement**2, axis=1)))),
        shift=displacement.mean(axis=0),
        turn=float(rotation_angle(motion[:3, :3])),
    )


def _find_causes(
    clouds: Sequence[ViewCloud],
    planes: Sequence[Plane | None],
    tables: Mapping[str, TableFit | None],
    table_height: float,
) -> dict[str, tuple[Cause, ...]]:
    """Returns the causes that explain the tables and bring the clouds together."""
    choices: list[list[tuple[Cause | None, ViewCloud, float]]] = []
    for cloud, plane in zip(clouds, planes, strict=True):
        fit = tables[cloud.name]
        if plane is None or fit is None or fit.ok:
            choices.append([(None, cloud, 0.0)])
        else:
            choices.append(_explanations(cloud, plane, table_height))

    @cache
    def distance(first: ViewCloud, second: ViewCloud) -> float:
        p, q, normals = correspondences(first, second, table_height)
        if len(p) < _FEWEST_PAIRS:
            return _FAR
        return float(np.minimum(np.abs(np.vecdot(normals, p - q)), _FAR).mean())

    ranked: list[tuple[float, list[Cause | None]]] = []
    for combination in product(*choices):
        errors = [error for _, _, error in combination]
        corrected = [cloud for _, cloud, _ in combination]
        errors += [distance(first, second) for first, second in combinations(corrected, 2)]
        ranked.append((sum(errors), [cause for cause, _, _ in combination]))
    ranked.sort(key=lambda item: item[0])
    found: dict[str, tuple[Cause, ...]] = {}
    for error, causes in ranked:
        if error > ranked[0][0] + _SIMILAR:
            break
        for cloud, cause in zip(clouds, causes, strict=True):
            known = found.get(cloud.name, ())
            if cause is not None and cause not in known:
                found[cloud.name] = (*known, cause)
    return found


def _explanations(
    cloud: ViewCloud, plane: Plane, table_height: float
) -> list[tuple[Cause | None, ViewCloud, float]]:
    """Returns each cause, the cloud without it, and the RMS error of its table then [m]."""
    eye, R = cloud.X_WC[:3, 3], cloud.X_WC[:3, :3]
    on_C = cloud.camera_points[plane.on]
    # The height of a point is eye_z + z (R r)_z, where r = p_C / z is the point's ray.
    slope = (on_C / on_C[:, 2:]) @ R[2]
    wanted = (table_height - eye[2]) / slope  # The depth of the true table at these pixels.
    scale = float(wanted @ on_C[:, 2] / (on_C[:, 2] @ on_C[:, 2]))
    bias = float(np.mean(wanted - on_C[:, 2]))
    # A turn about the middle of the table levels it, and a shift brings it to its height.
    axis = cross(plane.normal, np.array([0.0, 0.0, 1.0]))
    sine = float(np.linalg.norm(axis))
    turn = rotation_exp(axis * (np.arcsin(min(sine, 1.0)) / max(sine, 1e-12)))
    centre = cloud.points[plane.on].mean(axis=0)
    level = make_transform(turn, centre - turn @ centre)
    rise = table_height - float(transform_points(level, cloud.points[plane.on])[:, 2].mean())
    level[2, 3] += rise
    rays = cloud.camera_points / cloud.camera_points[:, 2:]
    changed = [
        (Cause(kind="scale", value=scale), cloud.X_WC, scale * cloud.camera_points),
        (Cause(kind="bias", value=bias), cloud.X_WC, cloud.camera_points + bias * rays),
        (Cause(kind="pose", value=rise), level @ cloud.X_WC, cloud.camera_points),
    ]
    if scale <= 0.0:  # The camera is below the table, or looks up.
        changed = changed[2:]
    elif abs(rise) > BAND:  # So large an error is not one of a few percent.
        changed = changed[:1] if wrong_unit(scale) is not None else changed[2:]
    result: list[tuple[Cause | None, ViewCloud, float]] = []
    for cause, X_WC, points in changed:
        new = replace(cloud, X_WC=X_WC, camera_points=points)
        errors = new.points[plane.on, 2] - table_height
        result.append((cause, new, float(np.sqrt(np.mean(errors**2)))))
    return result
