"""Concave collision meshes: Drake fills them in most places, so they are refused or decomposed."""

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydrake.geometry import Convex, GeometryId, Mesh, Role, SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from scipy.spatial import QhullError, cKDTree

from poil_drake.diagrams.scenario.meshes import ReadMesh
from poil_drake.diagrams.scenario.poil_config import PoilConfig
from poil_drake.errors import MissingDependencyError, ScenarioError
from poil_drake.runtime.user_cache import cached_directory

if TYPE_CHECKING:
    import trimesh

_NEGLIGIBLE_GAP = 0.002  # [m] between a mesh and its convex hull.
_SAMPLES, _HULL_SAMPLES = 10_000, 2_000  # Points on a mesh's surface, and on its convex hull.
_SPACINGS = 3.0  # Random samples of one surface are up to 2 mean distances apart.
_PIECE_CONCAVITY = 0.05  # CoACD's `threshold`: of a mug's handle, 6 pieces remain; of a mug, 26.


def ReplaceConcaveMeshes(plant: MultibodyPlant, scene_graph: SceneGraph, poil: PoilConfig) -> None:
    """Replaces concave collision meshes by convex pieces, or refuses them; see `poil.collision`.

    Pieces keep the mesh's name after the last "::", so parts are found by the same patterns. They
    are computed once, and kept in the user's cache.

    Args:
        plant: The plant with all models, not finalized.
        scene_graph: The plant's scene graph.
        poil: The scenario's `poil` section.

    Raises:
        ScenarioError: A collision mesh is concave, and `poil.collision` is not set.
        MissingDependencyError: CoACD, which makes the pieces, is not installed.
    """
    if poil.collision == "hull":
        return
    inspector = scene_graph.model_inspector()
    for geometry in inspector.GetAllGeometryIds(Role.kProximity):
        shape = inspector.GetShape(geometry)
        path = Path(shape.source().path()) if isinstance(shape, Mesh) else Path()
        if path.suffix.lower() not in (".obj", ".gltf"):
            continue
        mesh = _joined(ReadMesh(shape, inspector.GetName(geometry)))
        gap = _largest_gap(mesh)
        if gap == 0.0:
            continue
        if poil.collision is None:
            body = plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
            raise ScenarioError(
                f"The collision mesh '{path}' of '{body.scoped_name()}' is concave: its convex "
                "hull, which Drake uses for distances and all but rigid hydroelastic contact, is "
                f"up to {1000 * gap:.0f} mm away from it. This fills openings, as of a handle.",
                remedy="Set poil.collision to 'decompose' to replace such meshes by convex pieces, "
                "or to 'hull' if the filled shapes will do.",
            )
        _replace(plant, scene_graph, geometry, _pieces(mesh))


def _joined(pieces: "list[trimesh.Trimesh]") -> "trimesh.Trimesh":
    """Returns one mesh without colours."""
    import trimesh

    return trimesh.util.concatenate([trimesh.Trimesh(p.vertices, p.faces) for p in pieces])


def _largest_gap(mesh: "trimesh.Trimesh") -> float:
    """Returns the largest distance of the convex hull's surface from the mesh's [m].

    The result is 0 if it is too small to matter or to be told from the distance between samples.
    """
    try:
        hull = mesh.convex_hull
    except (QhullError, ValueError):  # A flat mesh.
        return 0.0
    from trimesh.sample import sample_surface

    points, _ = sample_surface(mesh, _SAMPLES, seed=0)
    covering, _ = sample_surface(hull, _HULL_SAMPLES, seed=0)
    gap = float(cKDTree(points).query(covering)[0].max())
    spacing = np.sqrt(mesh.area / _SAMPLES)
    return gap if gap > max(_NEGLIGIBLE_GAP, _SPACINGS * spacing) else 0.0


def _pieces(mesh: "trimesh.Trimesh") -> list[Path]:
    """Returns the files of a mesh's convex pieces, after computing them if they are not cached."""

    def make(directory: Path) -> None:
        try:
            import coacd
            import trimesh
        except ImportError as error:
            raise MissingDependencyError(
                "CoACD, which decomposes concave meshes, is not installed.",
                remedy="Run: pip install coacd",
            ) from error
        coacd.set_log_level("error")
        whole = coacd.Mesh(mesh.vertices, mesh.faces)
        parts = coacd.run_coacd(whole, threshold=_PIECE_CONCAVITY, seed=0)
        for number, (vertices, faces) in enumerate(parts):
            trimesh.Trimesh(vertices, faces).export(directory / f"{number:03}.obj")

    digest = hashlib.sha256(Path(__file__).read_bytes())
    digest.update(mesh.vertices.tobytes() + mesh.faces.tobytes())
    directory = cached_directory(name="convex_pieces", version=digest.hexdigest()[:16], make=make)
    return sorted(directory.glob("*.obj"))


def _replace(
    plant: MultibodyPlant, scene_graph: SceneGraph, geometry: GeometryId, pieces: list[Path]
) -> None:
    """Changes a geometry to the first piece, and adds the others to its body."""
    inspector = scene_graph.model_inspector()
    body = plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
    X_BG, name = inspector.GetPoseInFrame(geometry), inspector.GetName(geometry).split("::")[-1]
    properties = inspector.GetProximityProperties(geometry)
    scene_graph.ChangeShape(plant.get_source_id(), geometry, Convex(str(pieces[0])))
    for number, piece in enumerate(pieces[1:], start=2):
        plant.RegisterCollisionGeometry(
            body, X_BG, Convex(str(piece)), f"piece_{number}::{name}", properties
        )
