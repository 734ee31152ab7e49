"""Concave collision meshes: Drake fills them, so they are refused or decomposed."""

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydrake.geometry import Convex, GeometryId, Mesh, Role, SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from scipy.spatial import ConvexHull, QhullError

from poil_drake.diagrams.scenario.poil_config import PoilConfig
from poil_drake.errors import MissingDependencyError, ScenarioError
from poil_drake.runtime.user_cache import cached_directory

if TYPE_CHECKING:
    import trimesh

_DEEPEST_DENT = 0.002
"""A mesh is concave if some of its surface lies deeper than this in its convex hull [m]. Simulated
contacts are off by as much."""

_SAMPLES = 2000  # Points on a mesh's surface at which the depth is computed.
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
        mesh = _load(path, shape.scale3())
        dent = _deepest_dent(mesh)
        if dent <= _DEEPEST_DENT:
            continue
        if poil.collision is None:
            body = plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
            raise ScenarioError(
                f"The collision mesh '{path}' of '{body.scoped_name()}' is concave, "
                f"{1000 * dent:.0f} mm deep, but in contacts Drake uses its convex hull: openings, "
                "as of a handle or a cup, are filled.",
                remedy="Set poil.collision to 'decompose' to replace such meshes by convex pieces, "
                "or to 'hull' if the filled shapes will do.",
            )
        _replace(plant, scene_graph, geometry, _pieces(mesh))


def _load(path: Path, scale: np.ndarray) -> "trimesh.Trimesh":
    import trimesh

    mesh = trimesh.load(path, force="mesh")
    if path.suffix.lower() == ".gltf":  # Its y axis points up.
        mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    return mesh.apply_transform(np.diag([*scale, 1.0]))


def _deepest_dent(mesh: "trimesh.Trimesh") -> float:
    """Returns the largest depth of a mesh's surface in its convex hull [m]; 0 for a flat mesh."""
    import trimesh

    try:
        planes = ConvexHull(mesh.vertices).equations
    except (QhullError, ValueError):
        return 0.0
    points = trimesh.sample.sample_surface(mesh, _SAMPLES, seed=0)[0]
    return float(np.min(-planes[:, 3] - points @ planes[:, :3].T, axis=1).max())


def _pieces(mesh: "trimesh.Trimesh") -> list[Path]:
    """Returns the files of a mesh's convex pieces, after computing them if they are not cached."""

    def make(directory: Path) -> None:
        try:
            import coacd
        except ImportError as error:
            raise MissingDependencyError(
                "CoACD, which decomposes concave meshes, is not installed.",
                remedy="Run: pip install coacd",
            ) from error
        import trimesh

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
