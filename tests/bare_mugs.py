"""Mugs as users write them, without contact properties: of boxes, capsules or concave meshes."""

import itertools
from pathlib import Path

import numpy as np
import trimesh

WALL = 0.004
"""Thickness of the mugs' walls [m]."""

_MASS = 0.2  # [kg]
_HANDLE_RADIUS = 0.0045  # [m]


def body_radius(height: float) -> float:
    """Returns the outer radius of a mug's body [m]."""
    return 0.4 * height + WALL


def write_bare_mug(folder: Path, *, shapes: str, height: float) -> Path:
    """Writes a mug and its meshes, and returns the model file.

    The link "cup" is at the underside's centre. The handle, geometries "handle_.*", points to +x.

    Args:
        folder: Where to write.
        shapes: "boxes" (MJCF), "capsules" (URDF) or "meshes" (SDFormat).
        height: Height of the mug [m].
    """
    if shapes == "meshes":
        _write_meshes(folder, height)
    suffix, write = {"boxes": ("xml", _mjcf), "capsules": ("urdf", _urdf), "meshes": ("sdf", _sdf)}[
        shapes
    ]
    path = folder / f"mug.{suffix}"
    path.write_text(write(height))
    return path


def _handle_size(height: float) -> tuple[float, float]:
    """Returns how far the handle's centre line reaches from the wall, and up and down [m]."""
    return 0.024 + 0.1 * height, 0.19 * height + 0.008


def _handle(height: float) -> list[tuple[int, np.ndarray, float, float]]:
    """Returns number, centre, length and turn about the y axis [rad] of each piece of a handle."""
    (reach, rise), angle = _handle_size(height), np.linspace(-np.pi / 2, np.pi / 2, 8)
    x = body_radius(height) - WALL / 2 + reach * np.cos(angle)
    line = np.stack([x, 0 * x, 0.5 * height + rise * np.sin(angle)], axis=1)
    return [
        (i, (a + b) / 2, float(np.linalg.norm(b - a)), np.arctan2(b[0] - a[0], b[2] - a[2]))
        for i, (a, b) in enumerate(itertools.pairwise(line))
    ]


def _wall(height: float, count: int) -> list[tuple[int, np.ndarray, float]]:
    """Returns number, centre and direction [rad] of each of the pieces of a wall."""
    radius = body_radius(height) - WALL / 2
    return [
        (i, np.array([radius * np.cos(a), radius * np.sin(a), height / 2]), a)
        for i, a in enumerate(2 * np.pi * np.arange(count) / count)
    ]


def _mjcf(height: float) -> str:
    radius, sides = body_radius(height), 14
    width = radius * np.tan(np.pi / sides)
    geoms = [("floor", "cylinder", (radius - WALL, WALL / 2), (0, 0, WALL / 2), (0, 0, 0))]
    geoms += [
        (f"wall_{i}", "box", (WALL / 2, width, height / 2), center, (0, 0, np.degrees(turn)))
        for i, center, turn in _wall(height, sides)
    ]
    geoms += [
        (f"handle_{i}", "box", (0.0045, 0.0045, length / 2), center, (0, np.degrees(tilt), 0))
        for i, center, length, tilt in _handle(height)
    ]
    text = "".join(
        f'<geom name="{name}" type="{kind}" size="{_text(size)}" pos="{_text(center)}" '
        f'euler="{_text(turn)}" mass="{_MASS / len(geoms)}"/>\n'
        for name, kind, size, center, turn in geoms
    )
    body = f'<body name="cup"><freejoint/>\n{text}</body>'
    return f'<mujoco model="bare_mug"><worldbody>{body}</worldbody></mujoco>'


def _urdf(height: float) -> str:
    across, along = _inertia(height)
    text = f'<inertial><origin xyz="0 0 {height / 2}"/><mass value="{_MASS}"/><inertia '
    text += f'ixx="{across}" iyy="{across}" izz="{along}" ixy="0" ixz="0" iyz="0"/></inertial>'
    floor = f'<cylinder radius="{body_radius(height) - WALL}" length="{WALL}"/>'
    shapes = [("floor", np.array([0, 0, WALL / 2]), 0.0, floor)]
    capsule = '<drake:capsule radius="{}" length="{}"/>'
    shapes += [
        (f"wall_{i}", center, 0.0, capsule.format(WALL / 2, height - WALL))
        for i, center, _ in _wall(height, 45)
    ]
    shapes += [
        (f"handle_{i}", center, tilt, capsule.format(_HANDLE_RADIUS, length))
        for i, center, length, tilt in _handle(height)
    ]
    for name, center, tilt, shape in shapes:
        inner = f'<origin xyz="{_text(center)}" rpy="0 {tilt} 0"/><geometry>{shape}</geometry>'
        text += f'<visual name="{name}">{inner}</visual><collision name="{name}">{inner}'
        text += "</collision>\n"
    root = '<robot name="bare_mug" xmlns:drake="http://drake.mit.edu">'
    return f'{root}<link name="cup">{text}</link></robot>'


def _sdf(height: float) -> str:
    across, along = _inertia(height)
    text = f"<inertial><pose>0 0 {height / 2} 0 0 0</pose><mass>{_MASS}</mass><inertia>"
    text += f"<ixx>{across}</ixx><iyy>{across}</iyy><izz>{along}</izz></inertia></inertial>"
    for name in ("body", "handle_bow"):
        mesh = f"<geometry><mesh><uri>{name}.obj</uri></mesh></geometry>"
        text += f'<visual name="{name}">{mesh}</visual><collision name="{name}">{mesh}</collision>'
    return f'<sdf version="1.9"><model name="bare_mug"><link name="cup">{text}</link></model></sdf>'


def _write_meshes(folder: Path, height: float) -> None:
    radius = body_radius(height)
    inner = radius - WALL
    profile = [(0, 0), (radius, 0), (radius, height), (inner, height), (inner, WALL), (0, WALL)]
    trimesh.creation.revolve(np.array(profile), sections=32).export(folder / "body.obj")
    # Half a ring of square cross-section, about the y axis.
    (reach, rise), half = _handle_size(height), _HANDLE_RADIUS
    square = reach + half * np.array([-1, 1, 1, -1, -1]), half * np.array([-1, -1, 1, 1, -1])
    handle = trimesh.creation.revolve(np.stack(square, axis=1), angle=np.pi, sections=13)
    handle.fill_holes()
    turned = handle.vertices[:, [1, 2, 0]] * [1.0, 1.0, rise / reach]
    handle.vertices = np.add(turned, [radius - WALL / 2, 0.0, height / 2])
    handle.export(folder / "handle_bow.obj")


def _inertia(height: float) -> tuple[float, float]:
    return _MASS * height**2 / 6, _MASS * height**2 / 8


def _text(values: np.ndarray | tuple[float, ...]) -> str:
    return " ".join(f"{value:.6g}" for value in values)
