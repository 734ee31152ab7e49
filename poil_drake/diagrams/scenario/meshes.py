"""Reads the meshes of models, checks their units, and makes them usable by Drake's renderer."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import CalcObb, Convex, InMemoryMesh, Mesh, Role, SceneGraph, Shape
from pydrake.multibody.plant import MultibodyPlant

from poil_drake.diagrams.scenario.drake_errors import DrakeErrorsExplained
from poil_drake.errors import ScenarioError

if TYPE_CHECKING:
    import trimesh

CONVERT_MESH = (
    "Convert the mesh to .obj, e.g. with trimesh.load(OLD).export(NEW) in Python, and name the new "
    "file in the model's file."
)
"""The remedy for formats of meshes that cannot be used."""

_READ = (".obj", ".gltf", ".vtk")  # Formats that Drake reads.
_LARGEST = 10.0  # [m]; a mesh in millimetres is larger if its object is larger than 1 cm.
_CORNER_WITHOUT_NORMAL = re.compile(r"^\s*f\b.*[ \t]-?\d+(?:/-?\d*)?(?=\s|$)", re.MULTILINE)


def RequireMetres(scene_graph: SceneGraph) -> None:
    """Checks that no mesh is so large that its unit must be another than metres.

    Raises:
        ScenarioError: A mesh is, or it cannot be read.
    """
    inspector = scene_graph.model_inspector()
    for geometry in inspector.GetAllGeometryIds():
        _require_metres(inspector.GetShape(geometry), inspector.GetName(geometry))


def MakeMeshesDrawable(plant: MultibodyPlant, scene_graph: SceneGraph) -> None:
    """Replaces visual meshes that Drake's renderer cannot draw, in memory.

    OBJ files without normals get the normals of their faces; STL and PLY files become OBJ. Call
    this before cameras are added.

    Args:
        plant: The plant with all models.
        scene_graph: The plant's scene graph.

    Raises:
        ScenarioError: A mesh cannot be read or drawn, or its unit is another than metres.
    """
    inspector = scene_graph.model_inspector()
    for geometry in inspector.GetAllGeometryIds(Role.kPerception):
        shape, name = inspector.GetShape(geometry), inspector.GetName(geometry)
        if not isinstance(shape, Mesh | Convex) or not shape.source().is_path():
            continue
        path = Path(shape.source().path())
        if _lacks_normals(path):
            drawn = MeshInMemory(ReadMesh(shape, name), path)
            _require_metres(drawn, name)
            scene_graph.ChangeShape(plant.get_source_id(), geometry, drawn)


def ReadMesh(shape: Mesh | Convex, name: str) -> "list[trimesh.Trimesh]":
    """Returns the triangles of a mesh file in its geometry's frame [m]: a piece for each material.

    Meshes without normals get the normals of their faces.

    Args:
        shape: The mesh; its source is a file.
        name: The geometry's name, for errors.

    Raises:
        ScenarioError: The file cannot be read.
    """
    import trimesh

    path = Path(shape.source().path())
    suffix = path.suffix.lower()
    if suffix not in (".obj", ".gltf", ".stl", ".ply"):
        raise ScenarioError(
            f"The mesh {path} of '{name}' has a format that cameras cannot draw.",
            remedy=CONVERT_MESH,
        )
    try:
        found = trimesh.load(path, force="scene", process=False).dump()
        pieces = [piece for piece in found if isinstance(piece, trimesh.Trimesh)]
        if not all(np.isfinite(piece.vertices).all() for piece in pieces):
            raise ValueError("a vertex is not finite")
    except Exception as error:  # Its readers raise errors of many types.
        raise ScenarioError(
            f"The mesh {path} of '{name}' cannot be read ({error}).",
            remedy="Export the mesh again as OBJ.",
        ) from error
    X_GM = np.diag([*shape.scale3(), 1.0])
    if suffix == ".gltf":  # Its y axis points up; Drake turns it so that the z axis does.
        X_GM = X_GM @ trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0])
    for piece in pieces:
        if _lacks_normals(path):
            piece.unmerge_vertices()  # Each triangle has its own corners, with its own normal.
        piece.apply_transform(X_GM)
    return pieces


def MeshInMemory(pieces: "Sequence[trimesh.Trimesh]", path: Path) -> Mesh:
    """Returns a shape of triangles, with their normals, colours and textures.

    Args:
        pieces: The triangles.
        path: The file from which they are, for errors.
    """
    import trimesh

    text, files = trimesh.exchange.obj.export_obj(
        trimesh.Scene(pieces), include_normals=True, return_texture=True
    )
    supporting = {name: MemoryFile(data, Path(name).suffix, name) for name, data in files.items()}
    main = MemoryFile(text.encode(), ".obj", str(path))
    return Mesh(InMemoryMesh(mesh_file=main, supporting_files=supporting))


def _lacks_normals(path: Path) -> bool:
    """Returns whether a file lacks normals; STL and PLY count as files without."""
    suffix = path.suffix.lower()
    if suffix == ".obj":
        return _CORNER_WITHOUT_NORMAL.search(path.read_text(errors="replace")) is not None
    return suffix != ".gltf"


def _require_metres(shape: Shape, name: str) -> None:
    if not isinstance(shape, Mesh | Convex):
        return
    source = shape.source()
    file = source.path() if source.is_path() else source.in_memory().mesh_file.filename_hint()
    with DrakeErrorsExplained(
        f"The mesh {file} of '{name}' cannot be read", remedy="Export the mesh again as OBJ."
    ):
        size = np.max(np.ptp(BoxCorners(shape), axis=1))
    if size > _LARGEST:
        raise ScenarioError(
            f"The mesh {file} of '{name}' is {size:.0f} m large, so its unit is not metres.",
            remedy="Set the mesh's scale in the model's file: 0.001 0.001 0.001 for millimetres.",
        )


def BoxCorners(shape: Shape) -> np.ndarray:
    """Returns the corners (3, 8) of a box around a shape [m]; the origin if none is known."""
    unread = isinstance(shape, Mesh | Convex) and shape.extension() not in _READ
    box = None if unread else CalcObb(shape)
    if box is None:
        return np.zeros((3, 8))
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, 8)
    return box.pose().multiply(signs * box.half_width()[:, np.newaxis])
