"""Converts the Panda's .dae visual meshes to small .obj files with plain colours."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import trimesh

_MESHES = (*(f"link{i}" for i in range(8)), "hand", "finger")
"""The visual meshes, named as in `meshes/visual/<name>.dae`."""

_FACE_FRACTION = 0.1
"""Fraction of the triangles to keep. With all of them, rendering takes 2 to 3 times as long."""

_FEWEST_FACES = 60
"""Pieces with at most this many triangles keep all of them."""

_SHARPEST_SMOOTH_ANGLE = 0.6
"""An edge is not smoothed if the normals of its faces differ by more than this angle [rad]."""


def convert_visuals(*, source: Path, target: Path) -> None:
    """Writes `<name>.obj` and `<name>.mtl` into `target` for every visual mesh of the Panda.

    The format is .obj with vertex normals, because a single glTF file switches Drake's whole render
    engine to physically based rendering, which takes a quarter longer.

    Args:
        source: The directory that holds the .dae files.
        target: The directory to write to.
    """
    for name in _MESHES:
        _write_obj(_load_by_color(source / f"{name}.dae"), name=name, directory=target)


def _load_by_color(path: Path) -> "dict[tuple[int, ...], list[trimesh.Trimesh]]":
    """Returns the decimated pieces of a .dae file in the link's frame, keyed by RGB colour."""
    import trimesh

    pieces: dict[tuple[int, ...], list[trimesh.Trimesh]] = {}
    scene = trimesh.load(path, force="scene")
    for node in sorted(scene.graph.nodes_geometry):
        transform, geometry_name = scene.graph[node]
        mesh = scene.geometry[geometry_name].copy()
        color = tuple(int(c) for c in mesh.visual.material.main_color[:3])
        mesh.apply_transform(transform)
        pieces.setdefault(color, []).append(_decimate(mesh))
    return pieces


def _decimate(mesh: "trimesh.Trimesh") -> "trimesh.Trimesh":
    import open3d
    import trimesh

    mesh = trimesh.Trimesh(vertices=mesh.vertices, faces=mesh.faces, process=True)
    if len(mesh.faces) > _FEWEST_FACES:
        dense = open3d.geometry.TriangleMesh(
            open3d.utility.Vector3dVector(np.asarray(mesh.vertices)),
            open3d.utility.Vector3iVector(np.asarray(mesh.faces, dtype=np.int32)),
        )
        light = dense.simplify_quadric_decimation(
            max(_FEWEST_FACES, int(_FACE_FRACTION * len(mesh.faces)))
        )
        mesh = trimesh.Trimesh(
            vertices=np.asarray(light.vertices), faces=np.asarray(light.triangles), process=True
        )
    return trimesh.graph.smooth_shade(mesh, angle=_SHARPEST_SMOOTH_ANGLE)


def _write_obj(
    pieces: "dict[tuple[int, ...], list[trimesh.Trimesh]]", *, name: str, directory: Path
) -> None:
    lines = [f"mtllib {name}.mtl"]
    materials = []
    offset = 1
    for color, meshes in sorted(pieces.items()):
        material = "color_" + "_".join(map(str, color))
        rgb = " ".join(f"{c / 255:.4f}" for c in color)
        materials += [f"newmtl {material}", f"Kd {rgb}", "Ks 0 0 0", "d 1", ""]
        lines.append(f"usemtl {material}")
        for mesh in meshes:
            lines += ["v {:.6f} {:.6f} {:.6f}".format(*v) for v in mesh.vertices]
            lines += ["vn {:.4f} {:.4f} {:.4f}".format(*n) for n in mesh.vertex_normals]
            lines += [
                "f " + " ".join(f"{i + offset}//{i + offset}" for i in face) for face in mesh.faces
            ]
            offset += len(mesh.vertices)
    (directory / f"{name}.obj").write_text("\n".join(lines) + "\n")
    (directory / f"{name}.mtl").write_text("\n".join(materials))
