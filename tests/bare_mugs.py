"""Mugs as users write them, in MJCF, URDF and SDFormat, without hydroelastic properties."""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

WALL = 0.004
"""Thickness of the mugs' walls [m]."""

MASS = 0.2  # [kg]
_SIDES = 14
_HANDLE_RADIUS = 0.0045  # [m]


class Piece(NamedTuple):
    """A geometry of a mug: its size [m] is a box's edges, (radius, length), or a mesh file."""

    name: str
    kind: str
    size: tuple[float, ...] | str
    xyz: np.ndarray
    rotation: Rotation


def write_bare_mug(folder: Path, *, file_format: str, shapes: str, height: float) -> Path:
    """Writes a mug and its meshes, and returns the model file.

    The link "cup" is at the underside's centre. The handle, geometries "handle_.*", points to +x.

    Args:
        folder: Where to write.
        file_format: "xml" (MJCF), "urdf" or "sdf".
        shapes: "boxes", "capsules", "cylinders" (a solid body), or "meshes", which are concave.
        height: Height of the mug [m].
    """
    folder.mkdir(parents=True, exist_ok=True)
    body, handle = _meshes(folder, height) if shapes == "meshes" else _pieces(shapes, height)
    write = {"xml": _mjcf, "urdf": _urdf, "sdf": _sdf}[file_format]
    path = folder / f"mug.{file_format}"
    path.write_text(write([*body, *handle], height))
    return path


def body_radius(height: float, shapes: str) -> float:
    """Returns the outer radius of a mug's body [m]; solid bodies fit between the fingers."""
    return 0.026 if shapes == "cylinders" else 0.4 * height + 0.004


def _handle_line(height: float, radius: float, count: int) -> np.ndarray:
    """Returns points (count, 3) on the handle's centre line [m]."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, count)
    reach, rise = 0.024 + 0.1 * height, 0.19 * height + 0.008
    x = radius - WALL / 2 + reach * np.cos(angle)
    return np.stack([x, np.zeros(count), 0.5 * height + rise * np.sin(angle)], axis=1)


def _pieces(shapes: str, height: float) -> tuple[list[Piece], list[Piece]]:
    radius = body_radius(height, shapes)
    floor = Piece(
        "floor", "cylinder", (radius - WALL, WALL), np.array([0, 0, WALL / 2]), Rotation.identity()
    )
    body = [floor]
    if shapes == "cylinders":
        body = [
            floor._replace(name="body", size=(radius, height), xyz=np.array([0, 0, height / 2]))
        ]
    else:
        count = _SIDES if shapes == "boxes" else 45
        for i, angle in enumerate(2 * np.pi * np.arange(count) / count):
            turn = Rotation.from_euler("z", angle)
            kind, size = "box", (WALL, 2 * radius * np.tan(np.pi / count), height)
            if shapes == "capsules":
                kind, size = "capsule", (WALL / 2, height - WALL)
            center = turn.apply([radius - WALL / 2, 0, height / 2])
            body.append(Piece(f"wall_{i}", kind, size, center, turn))
    line = _handle_line(height, radius, 8)
    handle = []
    for i, (a, b) in enumerate(itertools.pairwise(line)):
        axis = b - a
        length = float(np.linalg.norm(axis))
        tilt = Rotation.from_euler("y", np.arctan2(axis[0], axis[2]))
        kind, size = "capsule", (_HANDLE_RADIUS, length)
        if shapes == "boxes":
            kind, size = "box", (2 * _HANDLE_RADIUS, 2 * _HANDLE_RADIUS, length)
        elif shapes == "cylinders":
            kind = "cylinder"
        handle.append(Piece(f"handle_{i}", kind, size, (a + b) / 2, tilt))
    return body, handle


def _meshes(folder: Path, height: float) -> tuple[list[Piece], list[Piece]]:
    radius = body_radius(height, "meshes")
    inner = radius - WALL
    profile = [(0, 0), (radius, 0), (radius, height), (inner, height), (inner, WALL), (0, WALL)]
    body = trimesh.creation.revolve(np.array(profile), sections=32)
    line = _handle_line(height, radius, 13)
    tangents = np.gradient(line, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    angle = 2 * np.pi * np.arange(10) / 10
    side = np.array([0.0, 1.0, 0.0])
    rings = [
        p
        + _HANDLE_RADIUS
        * (np.outer(np.cos(angle), side) + np.outer(np.sin(angle), np.cross(t, side)))
        for p, t in zip(line, tangents, strict=True)
    ]
    n, last = len(angle), len(line) - 1
    faces = [
        face
        for k in range(last)
        for i, j in ((i, (i + 1) % n) for i in range(n))
        for face in (
            (k * n + i, k * n + j, k * n + n + j),
            (k * n + i, k * n + n + j, k * n + n + i),
        )
    ]
    for i in range(1, n - 1):
        faces += [(0, i + 1, i), (last * n, last * n + i, last * n + i + 1)]
    handle = trimesh.Trimesh(np.concatenate(rings), faces)
    handle.fix_normals()
    pieces = []
    for name, mesh in (("body", body), ("handle_bow", handle)):
        (folder / f"{name}.obj").write_text(
            trimesh.exchange.obj.export_obj(mesh, include_normals=True)
        )
        pieces.append(Piece(name, "mesh", f"{name}.obj", np.zeros(3), Rotation.identity()))
    return pieces[:1], pieces[1:]


def _numbers(values: Sequence[float] | np.ndarray) -> str:
    return " ".join(f"{value:.6g}" for value in values)


def _color(index: int) -> str:
    return f"{0.9 if index % 2 else 0.2} {0.2 + 0.6 * (index % 3) / 2:.2f} 0.3 1"


def _inertia(height: float) -> dict[str, float]:
    across, along = MASS * height**2 / 6, MASS * height**2 / 8
    return {"ixx": across, "iyy": across, "izz": along, "ixy": 0, "ixz": 0, "iyz": 0}


def _mjcf(pieces: Sequence[Piece], height: float) -> str:
    assets, geoms = "", ""
    for i, piece in enumerate(pieces):
        x, y, z, w = piece.rotation.as_quat()
        if isinstance(piece.size, str):
            assets += f'<mesh name="{piece.name}" file="{piece.size}"/>'
            size = f'mesh="{piece.name}"'
        else:
            halves = np.array(piece.size) / 2
            if piece.kind != "box":
                halves[0] *= 2
            size = f'size="{_numbers(halves)}"'
        geoms += (
            f'<geom name="{piece.name}" type="{piece.kind}" {size} pos="{_numbers(piece.xyz)}" '
            f'quat="{_numbers((w, x, y, z))}" rgba="{_color(i)}" mass="{MASS / len(pieces)}"/>\n'
        )
    inertia = _inertia(height)
    diagonal = _numbers([inertia[key] for key in ("ixx", "iyy", "izz")])
    return f"""<mujoco model="bare_mug">
<asset>{assets}</asset>
<worldbody><body name="cup"><freejoint/>
<inertial pos="0 0 {height / 2}" mass="{MASS}" diaginertia="{diagonal}"/>
{geoms}</body></worldbody></mujoco>"""


def _urdf(pieces: Sequence[Piece], height: float) -> str:
    inertia = " ".join(f'{key}="{value}"' for key, value in _inertia(height).items())
    text = f'<inertial><origin xyz="0 0 {height / 2}"/><mass value="{MASS}"/>'
    text += f"<inertia {inertia}/></inertial>"
    for i, piece in enumerate(pieces):
        rpy = _numbers(piece.rotation.as_euler("xyz"))
        pose = f'<origin xyz="{_numbers(piece.xyz)}" rpy="{rpy}"/>'
        if isinstance(piece.size, str):
            shape = f'<mesh filename="{piece.size}"/>'
        elif piece.kind == "box":
            shape = f'<box size="{_numbers(piece.size)}"/>'
        else:
            prefix = "drake:" if piece.kind == "capsule" else ""
            shape = f'<{prefix}{piece.kind} radius="{piece.size[0]}" length="{piece.size[1]}"/>'
        color = f'<material name="m{i}"><color rgba="{_color(i)}"/></material>'
        for role, extra in (("visual", color), ("collision", "")):
            text += (
                f'<{role} name="{piece.name}">{pose}<geometry>{shape}</geometry>{extra}</{role}>\n'
            )
    root = '<robot name="bare_mug" xmlns:drake="http://drake.mit.edu">'
    return f'{root}<link name="cup">{text}</link></robot>'


def _sdf(pieces: Sequence[Piece], height: float) -> str:
    inertia = "".join(f"<{key}>{value}</{key}>" for key, value in _inertia(height).items())
    text = f"<inertial><pose>0 0 {height / 2} 0 0 0</pose><mass>{MASS}</mass>"
    text += f"<inertia>{inertia}</inertia></inertial>"
    for i, piece in enumerate(pieces):
        pose = f"<pose>{_numbers(piece.xyz)} {_numbers(piece.rotation.as_euler('xyz'))}</pose>"
        if isinstance(piece.size, str):
            shape = f"<mesh><uri>{piece.size}</uri></mesh>"
        elif piece.kind == "box":
            shape = f"<box><size>{_numbers(piece.size)}</size></box>"
        else:
            radius, length = piece.size
            shape = (
                f"<{piece.kind}><radius>{radius}</radius><length>{length}</length></{piece.kind}>"
            )
        color = f"<material><diffuse>{_color(i)}</diffuse></material>"
        for role, extra in (("visual", color), ("collision", "")):
            text += (
                f'<{role} name="{piece.name}">{pose}<geometry>{shape}</geometry>{extra}</{role}>\n'
            )
    return f'<sdf version="1.9"><model name="bare_mug"><link name="cup">{text}</link></model></sdf>'
