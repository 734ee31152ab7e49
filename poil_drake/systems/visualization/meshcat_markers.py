"""Marks in Meshcat that can be recorded: spheres, arrows and tubes.

A recording holds changes of poses and properties, never new objects. So every mark is drawn once,
when it is made, and only moved, scaled, shown and hidden afterwards.
"""

from collections.abc import Sequence

import numpy as np
from pydrake.geometry import Cylinder, Meshcat, MeshcatCone, Rgba, Sphere
from pydrake.math import RigidTransform, RotationMatrix


class SphereMarkers:
    """A fixed count of spheres that move, in one of several looks each."""

    def __init__(
        self, meshcat: Meshcat, path: str, *, count: int, radius: float, colors: Sequence[Rgba]
    ):
        """Draws the spheres and hides them.

        Args:
            meshcat: Where to draw.
            path: The Meshcat path below which the spheres stand.
            count: How many.
            radius: Their radius [m].
            colors: Their looks. Each look after the first is drawn smaller.
        """
        self._meshcat, self._path = meshcat, path
        self._paths = [f"{path}/{index}" for index in range(count)]
        self._looks = len(colors)
        for sphere_path in self._paths:
            for look, color in enumerate(colors):
                meshcat.SetObject(f"{sphere_path}/{look}", Sphere(radius * 0.7**look), color)
        self.hide()
        self.choose_looks(np.zeros(count, dtype=int))

    def hide(self, time: float | None = None) -> None:
        """Hides all spheres at `time` in the recording [s]."""
        self._meshcat.SetProperty(self._path, "visible", False, time)

    def move(self, positions: np.ndarray, time: float | None = None) -> None:
        """Moves the spheres to `positions` (N, 3) [m, world]; those not finite stay behind."""
        self._meshcat.SetProperty(self._path, "visible", True, time)
        finite = np.isfinite(positions).all(axis=1)
        for path, position, known in zip(self._paths, positions, finite, strict=True):
            if known:
                self._meshcat.SetTransform(path, RigidTransform(position), time)

    def choose_looks(self, looks: np.ndarray, time: float | None = None) -> None:
        """Gives each sphere one of its looks, by index (N,); -1 hides it."""
        for path, chosen in zip(self._paths, looks, strict=True):
            for look in range(self._looks):
                self._meshcat.SetProperty(f"{path}/{look}", "visible", look == int(chosen), time)


class ArrowMarker:
    """An arrow whose start, direction and length change."""

    def __init__(self, meshcat: Meshcat, path: str, *, radius: float, color: Rgba):
        """Draws the arrow and hides it.

        Args:
            meshcat: Where to draw.
            path: The Meshcat path below which the arrow stands.
            radius: Radius of its shaft [m].
            color: Its colour.
        """
        self._meshcat, self._path = meshcat, path
        self._head_length = 6.0 * radius
        meshcat.SetObject(f"{path}/shaft/unit", Cylinder(radius, 1.0), color)
        meshcat.SetTransform(f"{path}/shaft/unit", RigidTransform([0.0, 0.0, 0.5]))
        # Meshcat's cone stands on its tip: turned over, its base is at the origin.
        head = MeshcatCone(self._head_length, 2.5 * radius, 2.5 * radius)
        meshcat.SetObject(f"{path}/head/cone", head, color)
        meshcat.SetTransform(
            f"{path}/head/cone",
            RigidTransform(RotationMatrix.MakeXRotation(np.pi), [0.0, 0.0, self._head_length]),
        )
        self.hide()

    def hide(self, time: float | None = None) -> None:
        """Hides the arrow at `time` in the recording [s]."""
        self._meshcat.SetProperty(self._path, "visible", False, time)

    def show(self, start: np.ndarray, vector: np.ndarray, time: float | None = None) -> None:
        """Draws the arrow from `start` (3,) along `vector` (3,) [m, world].

        An arrow shorter than half its head, or one that is not finite, is hidden.
        """
        length = float(np.linalg.norm(vector))
        if not np.isfinite(start).all() or not length > 0.5 * self._head_length:
            self.hide(time)
            return
        head = min(self._head_length, length)
        shaft = max(length - head, 1e-4)
        X_WA = RigidTransform(RotationMatrix.MakeFromOneVector(vector / length, 2), start)
        self._meshcat.SetProperty(self._path, "visible", True, time)
        self._meshcat.SetTransform(self._path, X_WA, time)
        # Scales are properties here because a transform with scale in it is not recorded.
        self._meshcat.SetProperty(f"{self._path}/shaft", "scale", [1.0, 1.0, shaft], time)
        self._meshcat.SetProperty(f"{self._path}/head", "position", [0.0, 0.0, shaft], time)
        scale = head / self._head_length
        self._meshcat.SetProperty(f"{self._path}/head", "scale", [scale] * 3, time)


def make_tube_mesh(
    curve: np.ndarray, *, radius: float, sides: int = 6
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns a tube around a curve, as a triangle mesh.

    Args:
        curve: (T, 3) points of the curve [m]. Where it rests, points are left out.
        radius: The tube's radius [m].
        sides: How many sides the tube has.

    Returns:
        vertices (S * sides, 3) [m], faces (F, 3) int32, and the indices (S,) of the points kept;
        all empty for a curve that does not move further than its radius.
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
    angles = np.arange(sides) * 2.0 * np.pi / sides
    rings = []
    for point, tangent in zip(points, tangents, strict=True):
        # The normal is carried along the curve, so that the tube does not twist.
        normal = normal - (normal @ tangent) * tangent
        normal /= max(float(np.linalg.norm(normal)), 1e-12)
        binormal = np.cross(tangent, normal)
        rings.append(
            point + radius * (np.outer(np.cos(angles), normal) + np.outer(np.sin(angles), binormal))
        )
    ring = np.arange(len(kept) - 1)[:, None] * sides
    a, b = ring + np.arange(sides), ring + np.roll(np.arange(sides), -1)
    faces = np.stack([a, b, b + sides, a, b + sides, a + sides], axis=-1).reshape(-1, 3)
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
    """Draws curves (N, T, 3) [m, world] as tubes whose colour runs from start to end."""
    vertices, faces, colors = [], [], []
    ends = np.array([[c.r(), c.g(), c.b()] for c in (start_color, end_color)])
    count = 0
    for curve in curves:
        tube, tube_faces, kept = make_tube_mesh(curve, radius=radius)
        if len(kept) == 0:
            continue
        share = (kept / (len(curve) - 1))[:, None]
        colors.append(
            np.repeat((1.0 - share) * ends[0] + share * ends[1], len(tube) // len(kept), axis=0)
        )
        vertices.append(tube)
        faces.append(tube_faces + count)
        count += len(tube)
    if vertices:
        meshcat.SetTriangleColorMesh(
            path,
            np.asfortranarray(np.concatenate(vertices).T),
            np.asfortranarray(np.concatenate(faces).T.astype(np.int32)),
            np.asfortranarray(np.concatenate(colors).T),
        )
