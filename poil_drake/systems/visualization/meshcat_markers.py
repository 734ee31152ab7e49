"""Spheres, arrows and tubes that can be shown in a Meshcat recording.

A recording holds changes of poses and properties, never new objects. The constructor of a mark
therefore draws it; afterwards, the mark is only moved, scaled, shown and hidden.
"""

from collections.abc import Sequence

import numpy as np
from pydrake.geometry import Cylinder, Meshcat, MeshcatCone, Rgba, Sphere
from pydrake.math import RigidTransform, RotationMatrix

_SIDES = 6  # Number of sides of a tube.


class SphereMarkers:
    """A fixed number of spheres that move. A sphere has several looks, and shows one at a time."""

    def __init__(
        self, meshcat: Meshcat, path: str, *, count: int, radius: float, colors: Sequence[Rgba]
    ):
        """Draws the spheres and hides them.

        Args:
            meshcat: Where to draw.
            path: The Meshcat path of the group of spheres.
            count: Number of spheres.
            radius: Radius of the first look [m]. Each further look is 0.7 times as large.
            colors: The colour of each look.
        """
        self._meshcat, self._path = meshcat, path
        self._paths = [f"{path}/{index}" for index in range(count)]
        self._looks = len(colors)
        for sphere_path in self._paths:
            for look, color in enumerate(colors):
                meshcat.SetObject(f"{sphere_path}/{look}", Sphere(radius * 0.7**look), color)
        meshcat.SetProperty(path, "visible", False)
        self.choose_looks(np.zeros(count, dtype=int))

    def move(self, positions: np.ndarray, time: float | None = None) -> None:
        """Moves the spheres to `positions` (N, 3) [m, world] at `time` in the recording [s].

        A sphere whose position is not finite stays where it is. If no position is finite, all
        spheres are hidden.
        """
        finite = np.isfinite(positions).all(axis=1)
        self._meshcat.SetProperty(self._path, "visible", bool(finite.any()), time)
        for path, position, known in zip(self._paths, positions, finite, strict=True):
            if known:
                self._meshcat.SetTransform(path, RigidTransform(position), time)

    def choose_looks(self, looks: np.ndarray, time: float | None = None) -> None:
        """Shows look `looks[i]` of sphere i, or none for -1, at `time` in the recording [s]."""
        for path, chosen in zip(self._paths, looks, strict=True):
            for look in range(self._looks):
                self._meshcat.SetProperty(f"{path}/{look}", "visible", look == int(chosen), time)


class ArrowMarker:
    """An arrow whose start, direction and length change."""

    def __init__(self, meshcat: Meshcat, path: str, *, radius: float, color: Rgba):
        """Draws the arrow and hides it.

        Args:
            meshcat: Where to draw.
            path: The Meshcat path of the arrow.
            radius: Radius of its shaft [m].
            color: Its colour.
        """
        self._meshcat, self._path = meshcat, path
        self._head_length = 6.0 * radius
        meshcat.SetObject(f"{path}/shaft/unit", Cylinder(radius, 1.0), color)
        meshcat.SetTransform(f"{path}/shaft/unit", RigidTransform([0.0, 0.0, 0.5]))
        # Meshcat's cone has its tip at the origin. Turned over, it has its base there.
        head = MeshcatCone(self._head_length, 2.5 * radius, 2.5 * radius)
        meshcat.SetObject(f"{path}/head/cone", head, color)
        meshcat.SetTransform(
            f"{path}/head/cone",
            RigidTransform(RotationMatrix.MakeXRotation(np.pi), [0.0, 0.0, self._head_length]),
        )
        meshcat.SetProperty(path, "visible", False)

    def show(self, start: np.ndarray, vector: np.ndarray, time: float | None = None) -> None:
        """Draws the arrow from `start` (3,) to `start + vector` [m, world].

        An arrow that is shorter than half its head, or not finite, is hidden. `time` is the time in
        the recording [s].
        """
        length = float(np.linalg.norm(vector))
        visible = bool(np.isfinite(start).all() and 0.5 * self._head_length < length < np.inf)
        self._meshcat.SetProperty(self._path, "visible", visible, time)
        if not visible:
            return
        head = min(self._head_length, length)
        shaft = max(length - head, 1e-4)
        X_WA = RigidTransform(RotationMatrix.MakeFromOneVector(vector / length, 2), start)
        self._meshcat.SetTransform(self._path, X_WA, time)
        # Meshcat does not record a transform that scales, but it does record the property `scale`.
        self._meshcat.SetProperty(f"{self._path}/shaft", "scale", [1.0, 1.0, shaft], time)
        self._meshcat.SetProperty(f"{self._path}/head", "position", [0.0, 0.0, shaft], time)
        scale = head / self._head_length
        self._meshcat.SetProperty(f"{self._path}/head", "scale", [scale] * 3, time)


def make_tube_mesh(
    curve: np.ndarray, *, radius: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns a tube around a curve, as a triangle mesh.

    Args:
        curve: (T, 3) points of the curve [m]. A point within `radius` of the last point kept is
            left out.
        radius: The tube's radius [m].

    Returns:
        vertices (6S, 3) [m] of S hexagons, one around each point kept; triangles (F, 3) int32; and
        the indices (S,) of the points kept. All are empty if every point is within `radius` of the
        first.
    """
    kept = [0]
    for index in range(1, len(curve)):
        if np.linalg.norm(curve[index] - curve[kept[-1]]) > radius:
            kept.append(index)
    if len(kept) < 2:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32), np.zeros(0, dtype=int)
    points = curve[kept]
    tangents = np.gradient(points, axis=0)
    tangents /= np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-12)
    normal = np.eye(3)[np.argmin(np.abs(tangents[0]))]
    angles = np.arange(_SIDES) * 2.0 * np.pi / _SIDES
    rings = []
    for point, tangent in zip(points, tangents, strict=True):
        # The normal is carried along the curve, so that the tube does not twist.
        normal = normal - (normal @ tangent) * tangent
        normal /= max(float(np.linalg.norm(normal)), 1e-12)
        binormal = np.cross(tangent, normal)
        rings.append(
            point + radius * (np.outer(np.cos(angles), normal) + np.outer(np.sin(angles), binormal))
        )
    ring = np.arange(len(kept) - 1)[:, None] * _SIDES
    a, b = ring + np.arange(_SIDES), ring + np.roll(np.arange(_SIDES), -1)
    faces = np.stack([a, b, b + _SIDES, a, b + _SIDES, a + _SIDES], axis=-1).reshape(-1, 3)
    return np.concatenate(rings), faces.astype(np.int32), np.array(kept)


def DrawTubes(
    meshcat: Meshcat,
    path: str,
    curves: np.ndarray,
    *,
    radius: float,
    start_color: Rgba,
    end_color: Rgba,
) -> None:
    """Draws curves (N, T, 3) [m, world] as tubes, all in one object at the Meshcat path `path`.

    The tubes have the radius `radius` [m]. Their colour changes from `start_color` at the first
    point of a curve to `end_color` at the last one.
    """
    vertices, faces, colors = [], [], []
    ends = np.array([[c.r(), c.g(), c.b()] for c in (start_color, end_color)])
    count = 0
    for curve in curves:
        tube, tube_faces, kept = make_tube_mesh(curve, radius=radius)
        share = (kept / (len(curve) - 1))[:, None]
        colors.append(np.repeat((1.0 - share) * ends[0] + share * ends[1], _SIDES, axis=0))
        vertices.append(tube)
        faces.append(tube_faces + count)
        count += len(tube)
    if count:
        meshcat.SetTriangleColorMesh(
            path,
            np.asfortranarray(np.concatenate(vertices).T),
            np.asfortranarray(np.concatenate(faces).T),
            np.asfortranarray(np.concatenate(colors).T),
        )
