"""Triangle meshes of a mug's body and handle, and the texture image of their decoration."""

from dataclasses import dataclass

import numpy as np

from poil_drake.models.mug_family import MugParameters
from poil_drake.models.mug_shape import handle_center_line, wall_profile

_BODY_SEGMENTS = 40  # Facets around the body.
_HANDLE_SECTIONS = 26  # Cross-sections along the handle.
_HANDLE_SEGMENTS = 10  # Facets around the handle's tube.

_DECORATED_FRACTION = 0.75
"""Fraction of the texture image, from its top, that covers the handle and the outside of the body.
The rest of the image has the base colour and covers the inside and the underside."""

_TEXTURE_SIZE = (256, 512)  # Height and width of a texture image [px].
_SHADES = 6  # Number of colours in a noise texture; a small one keeps the image file small.


@dataclass(frozen=True, eq=False)
class TexturedMesh:
    """A triangle mesh with one normal and one texture coordinate per vertex.

    Attributes:
        vertices: (V, 3) positions [m].
        normals: (V, 3) unit outward normals.
        uv: (V, 2) texture coordinates in [0, 1].
        faces: (F, 3) vertex indices, counter-clockwise seen from outside.
    """

    vertices: np.ndarray
    normals: np.ndarray
    uv: np.ndarray
    faces: np.ndarray

    def to_obj(self, *, material: str) -> str:
        """Returns the mesh in Wavefront .obj format; `<material>.mtl` defines the material."""
        lines = [f"mtllib {material}.mtl", f"usemtl {material}"]
        lines += ["v {:.5f} {:.5f} {:.5f}".format(*v) for v in self.vertices]
        lines += ["vt {:.4f} {:.4f}".format(*t) for t in self.uv]
        lines += ["vn {:.3f} {:.3f} {:.3f}".format(*n) for n in self.normals]
        lines += ["f " + " ".join(f"{i}/{i}/{i}" for i in face) for face in self.faces + 1]
        return "\n".join(lines) + "\n"


def body_mesh(mug: MugParameters) -> TexturedMesh:
    """Returns the mesh of the body: the decorated outside, and the plain inside and underside."""
    outside, inside = wall_profile(mug)
    plain_v = (1 - _DECORATED_FRACTION) / 2
    decorated = 1 - _DECORATED_FRACTION * (1 - outside[:, 1] / mug.height)
    decorated[:2] = plain_v
    return _join(_revolve(outside, decorated), _revolve(inside, np.full(len(inside), plain_v)))


def handle_mesh(mug: MugParameters) -> TexturedMesh:
    """Returns the mesh of the handle, a tube around the centre line."""
    line = handle_center_line(mug, _HANDLE_SECTIONS)
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.array([0.0, 1.0, 0.0])
    outward = np.cross(side, tangent)
    angle = np.linspace(0, 2 * np.pi, _HANDLE_SEGMENTS + 1)
    normals = np.cos(angle)[None, :, None] * outward[:, None] + np.sin(angle)[None, :, None] * side
    vertices = line[:, None] + mug.handle_radius * normals
    # The decoration has the same scale along the handle as around the body.
    length = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
    around = 2 * np.pi * mug.radius
    u = np.linspace(0, length / around, len(line))
    v = 1 - _DECORATED_FRACTION * (0.3 + 0.4 * angle / (2 * np.pi))
    uv = np.stack(np.broadcast_arrays(u[:, None], v[None, :]), axis=-1)
    return _grid(vertices, normals, uv)


def _revolve(profile: np.ndarray, v: np.ndarray) -> TexturedMesh:
    """Returns the surface that a polyline sweeps when it turns about the z axis.

    Args:
        profile: (N, 2) radius and height [m] along the polyline. The outside is on its right.
        v: (N,) vertical texture coordinates, in [0, 1].
    """
    edges = np.diff(profile, axis=0)
    edge_normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
    edge_normals /= np.linalg.norm(edge_normals, axis=1, keepdims=True)
    neighbours = np.vstack([edge_normals[:1], edge_normals, edge_normals[-1:]])
    point_normals = neighbours[:-1] + neighbours[1:]
    point_normals /= np.linalg.norm(point_normals, axis=1, keepdims=True)
    angle = np.linspace(0, 2 * np.pi, _BODY_SEGMENTS + 1)
    around = np.stack([np.cos(angle), np.sin(angle)], axis=1)

    def turn(radial: np.ndarray, axial: np.ndarray) -> np.ndarray:
        xy = radial[:, None, None] * around
        z = np.broadcast_to(axial[:, None, None], (*xy.shape[:2], 1))
        return np.concatenate([xy, z], axis=2)

    uv = np.stack(np.broadcast_arrays(angle[None] / (2 * np.pi), v[:, None]), axis=-1)
    return _grid(
        turn(profile[:, 0], profile[:, 1]), turn(point_normals[:, 0], point_normals[:, 1]), uv
    )


def _grid(vertices: np.ndarray, normals: np.ndarray, uv: np.ndarray) -> TexturedMesh:
    """Joins a (rows, columns) grid of vertices by triangles; omits triangles without area."""
    rows, columns = vertices.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    c, d = index[1:, 1:].ravel(), index[1:, :-1].ravel()
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    flat = vertices.reshape(-1, 3)
    p, q, r = (flat[faces[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(q - p, r - p), axis=1) / 2
    return TexturedMesh(flat, normals.reshape(-1, 3), uv.reshape(-1, 2), faces[area > 1e-10])


def _join(first: TexturedMesh, second: TexturedMesh) -> TexturedMesh:
    return TexturedMesh(
        np.vstack([first.vertices, second.vertices]),
        np.vstack([first.normals, second.normals]),
        np.vstack([first.uv, second.uv]),
        np.vstack([first.faces, second.faces + len(first.vertices)]),
    )


def texture_image(mug: MugParameters) -> np.ndarray:
    """Returns the (H, W, 3) uint8 RGB texture of a decorated mug.

    The decoration is above a strip of the base colour. The same parameters give the same image.
    """
    height, width = _TEXTURE_SIZE
    rows = round(height * _DECORATED_FRACTION)
    pattern = np.zeros((height, width))
    pattern[:rows] = _PATTERNS[mug.texture](np.random.default_rng(mug.seed), rows, width)
    # The lowest decorated rows stay plain, so that no decoration bleeds into the inside.
    pattern[rows - 4 :] = 0.0
    color, accent = np.array(mug.color), np.array(mug.accent)
    image = color + pattern[..., None] * (accent - color)
    return np.round(255 * np.clip(image, 0, 1)).astype(np.uint8)


def _stripes(rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
    """Returns the (rows, columns) weights of the accent colour: slanted stripes of varied width."""
    y, x = np.mgrid[:rows, :columns]
    phase = 2 * np.pi * (6 * x / columns + 2.0 * y / rows)
    return (np.sin(phase) > 0.6 * np.sin(2 * np.pi * x / columns)).astype(float)


def _checks(rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
    """Returns the (rows, columns) weights of the accent colour: a checkerboard in four shades."""
    shades = rng.choice([0.4, 0.6, 0.8, 1.0], size=(8, 16))
    y, x = np.mgrid[:rows, :columns]
    i, j = y * 8 // rows, x * 16 // columns
    return ((i + j) % 2) * shades[i, j]


def _dots(rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
    y, x = np.mgrid[:rows, :columns]
    pattern = np.zeros((rows, columns))
    for _ in range(60):
        cx, cy, r = rng.uniform(0, columns), rng.uniform(0, rows), rng.uniform(8, 18)
        dx = np.minimum(np.abs(x - cx), columns - np.abs(x - cx))
        pattern[dx**2 + (y - cy) ** 2 < r**2] = 1.0
    return pattern


def _noise(rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
    """Returns the (rows, columns) weights of the accent colour: speckles without a seam."""
    import cv2

    pattern = np.zeros((rows, columns))
    for cells, weight in ((8, 0.3), (24, 0.4), (64, 0.3)):
        coarse = rng.uniform(size=(max(2, cells * rows // columns), cells))
        coarse = np.concatenate([coarse, coarse[:, :1]], axis=1)
        pattern += weight * cv2.resize(coarse, (columns, rows), interpolation=cv2.INTER_LINEAR)
    low, high = np.quantile(pattern, [0.02, 0.98])
    pattern = np.clip((pattern - low) / (high - low), 0, 1)
    return np.round(pattern * (_SHADES - 1)) / (_SHADES - 1)


def _logo(rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
    """Returns the (rows, columns) weights of the accent colour: random logos on two sides."""
    pattern = np.zeros((rows, columns))
    cells, size = 9, rows * 3 // 4 // 9
    for center in (columns // 4, 3 * columns // 4):
        half = rng.uniform(size=(cells, cells // 2 + 1)) < 0.5
        blocks = np.concatenate([half, half[:, -2::-1]], axis=1)
        blocks[[0, -1]] = True
        blocks[:, [0, -1]] = True
        sign = np.kron(blocks, np.ones((size, size)))
        top, left = (rows - len(sign)) // 2, center - len(sign) // 2
        pattern[top : top + len(sign), left : left + len(sign)] = sign
    return pattern


_PATTERNS = {
    "stripes": _stripes,
    "checks": _checks,
    "dots": _dots,
    "noise": _noise,
    "logo": _logo,
}
