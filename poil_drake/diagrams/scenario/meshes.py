"""Makes the meshes of models usable by Drake's renderer, and checks their units."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import CalcObb, Convex, InMemoryMesh, Mesh, SceneGraph, Shape
from pydrake.multibody.plant import MultibodyPlant

from poil_drake.diagrams.scenario.drake_errors import DrakeErrorsExplained
from poil_drake.errors import ScenarioError

if TYPE_CHECKING:
    import trimesh

_READ = (".obj", ".gltf", ".vtk")  # Formats that Drake reads.
_LARGEST = 10.0  # [m]; a mesh in millimetres is larger if its object is larger than 1 cm.

_CORNER_WITHOUT_NORMAL = re.compile(r"^\s*f\b.*[ \t]-?\d+(?:/-?\d*)?(?=\s|$)", re.MULTILINE)
_USED_FILE = re.compile(r"^[ \t]*(?:mtllib|map_\w+)[ \t].*?([^ \t\r\n]+)[ \t\r]*$", re.MULTILINE)


def RequireMetres(scene_graph: SceneGraph) -> None:
    """Checks that no mesh is so large that its unit must be millimetres.

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
        ScenarioError: A mesh cannot be read or drawn, or is in millimetres.
    """
    inspector = scene_graph.model_inspector()
    for geometry in inspector.GetAllGeometryIds():
        shape, name = inspector.GetShape(geometry), inspector.GetName(geometry)
        if (
            inspector.GetPerceptionProperties(geometry) is None
            or not isinstance(shape, Mesh | Convex)
            or not shape.source().is_path()
        ):
            continue
        path = Path(shape.source().path())
        text = _replacement(path, name)
        if text is not None:
            mesh = InMemoryMesh(
                mesh_file=MemoryFile(text, ".obj", str(path)),
                supporting_files=_supporting_files(text, path.parent),
            )
            drawn = Mesh(mesh, scale3=shape.scale3())
            _require_metres(drawn, name)
            scene_graph.ChangeShape(plant.get_source_id(), geometry, drawn)


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
            f"The mesh {file} of '{name}' is {size:.0f} m large; it looks like millimetres.",
            remedy="Set the mesh's scale to 0.001 0.001 0.001 in the model's file.",
        )


def BoxCorners(shape: Shape) -> np.ndarray:
    """Returns the corners (3, 8) of a box around a shape [m]; the origin if none is known."""
    unread = isinstance(shape, Mesh | Convex) and shape.extension() not in _READ
    box = None if unread else CalcObb(shape)
    if box is None:
        return np.zeros((3, 8))
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, 8)
    return box.pose().multiply(signs * box.half_width()[:, np.newaxis])


def _replacement(path: Path, name: str) -> str | None:
    """Returns OBJ text that replaces a visual mesh; None if Drake can draw the file itself."""
    suffix = path.suffix.lower()
    if suffix == ".gltf":
        return None
    with _ReadErrorsExplained(path, name):
        if suffix == ".obj":
            text = path.read_text(encoding="utf-8", errors="replace")
            return _with_normals(text) if _CORNER_WITHOUT_NORMAL.search(text) else None
        if suffix in (".stl", ".ply"):
            import trimesh

            # Without merged vertices, each face keeps its normal.
            mesh = trimesh.load_mesh(path, process=False)
            mesh.unmerge_vertices()
            return mesh.export(file_type="obj", include_normals=True, include_texture=False)
    raise ScenarioError(
        f"The mesh {path} of '{name}' has a format that cameras cannot draw.",
        remedy="Convert the mesh to .obj or .gltf, e.g. with trimesh.load(OLD).export(NEW) in "
        "Python, and name the new file in the model's file.",
    )


def LoadScene(path: Path, name: str) -> "trimesh.Scene":
    """Returns the meshes in the file of a geometry `name` as Drake reads it: z up, not scaled.

    Raises:
        ScenarioError: The file cannot be read.
    """
    import trimesh

    with _ReadErrorsExplained(path, name):
        scene = trimesh.load(path, force="scene", process=False)
    if path.suffix.lower() == ".gltf":  # Its y axis points up.
        scene.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    return scene


@contextmanager
def _ReadErrorsExplained(path: Path, name: str) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError, IndexError, KeyError) as error:
        raise ScenarioError(
            f"The mesh {path} of '{name}' cannot be read ({error}).",
            remedy="Export the mesh again as OBJ.",
        ) from error


def _with_normals(text: str) -> str:
    """Returns the text of an OBJ file in which each face has its own normal."""
    vertices: list[np.ndarray] = []
    lines, count = [], 0
    for line in text.replace("\\\n", " ").splitlines():
        kind, *words = line.split() or [""]
        if kind == "v":
            vertices.append(np.array(words[:3], dtype=float))
        elif kind == "f":
            corners = [(*word.split("/"), "")[:2] for word in words]
            # Indices begin at 1; negative ones count from the last vertex.
            points = np.array([vertices[int(v) - (int(v) > 0)] for v, _ in corners])
            normal = np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)
            normal /= np.linalg.norm(normal) or 1.0
            count += 1
            lines.append("vn {:.6f} {:.6f} {:.6f}".format(*normal))
            line = "f " + " ".join(f"{v}/{t}/{count}" for v, t in corners)
        if kind != "vn":
            lines.append(line)
    return "\n".join(lines) + "\n"


def _supporting_files(text: str, folder: Path) -> dict[str, Path]:
    """Returns the material files that an OBJ text names, and their textures, by name."""
    found: dict[str, Path] = {}
    for name in _USED_FILE.findall(text):
        path = folder / name
        if path.is_file():
            found[name] = path
            if path.suffix.lower() == ".mtl":
                found |= _supporting_files(path.read_text(errors="replace"), folder)
    return found
