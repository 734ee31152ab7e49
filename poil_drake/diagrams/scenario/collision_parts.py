"""Finds the collision geometries of a part of a model: a link, or a pattern on their names."""

import re

from pydrake.geometry import GeometryId, SceneGraphInspector
from pydrake.multibody.plant import MultibodyPlant


def CollisionGeometries(
    plant: MultibodyPlant, inspector: SceneGraphInspector, model: str, part: str
) -> list[GeometryId]:
    """Returns the collision geometries of a part.

    Args:
        plant: The plant.
        inspector: Its scene graph's inspector.
        model: The model instance.
        part: A link or, if no link has that name, a regular expression that matches the whole
            name of a geometry (without the model's scope).

    Returns:
        The geometries; empty if there is no such part.
    """
    instance = plant.GetModelInstanceByName(model)
    bodies = [plant.get_body(index) for index in plant.GetBodyIndices(instance)]
    named = [body for body in bodies if body.name() == part]
    geometries = [g for b in named or bodies for g in plant.GetCollisionGeometriesForBody(b)]
    if named:
        return geometries
    try:
        pattern = re.compile(part)
    except re.error:
        return []
    return [g for g in geometries if pattern.fullmatch(_own_name(inspector, g))]


def ScopedGeometryName(
    plant: MultibodyPlant, inspector: SceneGraphInspector, geometry_id: GeometryId
) -> str:
    """Returns "model::link::geometry" for a geometry of the plant, e.g. "rack::rod::bar"."""
    body = plant.GetBodyFromFrameId(inspector.GetFrameId(geometry_id))
    model = plant.GetModelInstanceName(body.model_instance())
    return f"{model}::{body.name()}::{_own_name(inspector, geometry_id)}"


def _own_name(inspector: SceneGraphInspector, geometry_id: GeometryId) -> str:
    return inspector.GetName(geometry_id).split("::")[-1]
