"""Separates parts of an object whose visual meshes do not separate them."""

import re
from collections.abc import Mapping
from pathlib import Path

from pydrake.geometry import (
    Convex,
    GeometryInstance,
    Mesh,
    PerceptionProperties,
    Role,
    SceneGraph,
)
from pydrake.multibody.plant import MultibodyPlant

from poil_drake.diagrams.scenario.meshes import MeshInMemory, ReadMesh
from poil_drake.diagrams.scenario.model_parts import ModelGeometries, ModelGeometry
from poil_drake.diagrams.scenario.poil_config import PartRegion
from poil_drake.errors import ScenarioError


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
        ScenarioError: A region contains nothing of the model's meshes.
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
                remedy=f"Correct the region; it is in the frame of each link ({links}), in metres. "
                "Parts of other shapes than meshes are named by a link or expression.",
            )
        patterns[part] = f".*/{re.escape(part)}"
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
    if not (isinstance(shape, Mesh | Convex) and shape.source().is_path()):
        return False
    name = inspector.GetName(geometry.id)
    pieces = ReadMesh(shape, name)
    X_LG, frame = inspector.GetPoseInFrame(geometry.id), inspector.GetFrameId(geometry.id)
    inside = [region.contains((X_LG @ piece.triangles_center.T).T) for piece in pieces]
    if not any(faces.any() for faces in inside):
        return False
    properties = PerceptionProperties(inspector.GetPerceptionProperties(geometry.id))
    scene_graph.RemoveRole(source, geometry.id, Role.kPerception)
    for own_name, wanted in ((f"{name}/{part}", True), (name, False)):
        chosen = [piece.copy() for piece in pieces]
        for piece, faces in zip(chosen, inside, strict=True):
            piece.update_faces(faces == wanted)
            piece.remove_unreferenced_vertices()
        if chosen := [piece for piece in chosen if len(piece.faces)]:
            mesh = MeshInMemory(chosen, Path(shape.source().path()))
            instance = GeometryInstance(X_LG, mesh, own_name)
            instance.set_perception_properties(properties)
            scene_graph.RegisterGeometry(source, frame, instance)
    return True
