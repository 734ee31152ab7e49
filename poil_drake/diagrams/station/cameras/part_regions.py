"""Separates parts of an object whose visual meshes do not separate them."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import trimesh
from pydrake.common import MemoryFile
from pydrake.geometry import (
    GeometryInstance,
    InMemoryMesh,
    Mesh,
    PerceptionProperties,
    Role,
    SceneGraph,
)
from pydrake.multibody.plant import MultibodyPlant
from trimesh.visual import TextureVisuals
from trimesh.visual.material import SimpleMaterial

from poil_drake.diagrams.scenario.meshes import LoadScene
from poil_drake.diagrams.scenario.model_parts import ModelGeometries, ModelGeometry
from poil_drake.diagrams.scenario.poil_config import PartRegion
from poil_drake.errors import ScenarioError

_WHITE = np.full(4, 255, np.uint8)


def SeparateParts(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    model: str,
    parts: Mapping[str, str | PartRegion],
) -> dict[str, str]:
    """Splits the visual meshes of a model where they reach into the region of a part.

    A triangle belongs to a region if its centre lies in it. Only what cameras see is split, not
    what collides or what Meshcat shows.

    Args:
        plant: The plant, before `Finalize`.
        scene_graph: The plant's scene graph.
        model: The model.
        parts: Part -> a link or regular expression, which stays as it is, or a region.

    Returns:
        `parts`, with a regular expression for the names of the new geometries for each region.

    Raises:
        ScenarioError: A region contains nothing of the model's meshes, or one cannot be read.
    """
    patterns = {part: what for part, what in parts.items() if isinstance(what, str)}
    for part, region in parts.items():
        if isinstance(region, str):
            continue
        inspector = scene_graph.model_inspector()
        geometries = ModelGeometries(plant, inspector, model, Role.kPerception)
        inside = [_split(plant, scene_graph, geometry, part, region) for geometry in geometries]
        if not any(inside):
            links = ", ".join(sorted({geometry.link for geometry in geometries}))
            raise ScenarioError(
                f"The region of the part '{part}' contains no triangle of the visual meshes of "
                f"'{model}'.",
                remedy=f"Correct the region; it is in the frame of each link ({links}).",
            )
        patterns[part] = f".*/{part}"
    return patterns


def _split(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    geometry: ModelGeometry,
    part: str,
    region: PartRegion,
) -> bool:
    """Splits a geometry; returns whether something of it lies in the region."""
    inspector, source = scene_graph.model_inspector(), plant.get_source_id()
    shape = inspector.GetShape(geometry.id)
    if not (isinstance(shape, Mesh) and shape.source().is_path()):
        return False
    mesh = _whole(LoadScene(shape.source().path(), inspector.GetName(geometry.id)))
    mesh.vertices *= shape.scale3()
    X_LG, frame = inspector.GetPoseInFrame(geometry.id), inspector.GetFrameId(geometry.id)
    inside = region.contains((X_LG @ mesh.triangles_center.T).T)
    if not inside.any():
        return False
    name = inspector.GetName(geometry.id)
    properties = PerceptionProperties(inspector.GetPerceptionProperties(geometry.id))
    scene_graph.RemoveRole(source, geometry.id, Role.kPerception)
    for own_name, faces in ((f"{name}/{part}", inside), (name, ~inside)):
        if faces.any():
            piece = _as_shape(mesh.submesh([faces], append=True, repair=False))
            instance = GeometryInstance(X_LG, piece, own_name)
            instance.set_perception_properties(properties)
            scene_graph.RegisterGeometry(source, frame, instance)
    return True


def _whole(scene: trimesh.Scene) -> trimesh.Trimesh:
    """Returns the meshes of a file as one, whose materials become one texture."""
    mesh = scene.to_mesh()
    if len(scene.geometry) > 1 and isinstance(mesh.visual, TextureVisuals):
        # The texture has the materials' colours already, which a grey default would darken.
        image = getattr(mesh.visual.material, "image", None)
        image = image or getattr(mesh.visual.material, "baseColorTexture", None)
        mesh.visual.material = SimpleMaterial(image=image, diffuse=_WHITE)
    return mesh


def _as_shape(mesh: trimesh.Trimesh) -> Mesh:
    """Returns a triangle mesh as a shape, with its colours and texture."""
    text, files = trimesh.exchange.obj.export_obj(mesh, include_normals=True, return_texture=True)
    supporting = {name: MemoryFile(data, Path(name).suffix, name) for name, data in files.items()}
    main = MemoryFile(text.encode(), ".obj", "part.obj")
    return Mesh(InMemoryMesh(mesh_file=main, supporting_files=supporting))
