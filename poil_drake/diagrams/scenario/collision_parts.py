"""The collision geometries of a part of a model, which is a link or a pattern on their names."""

import re

from pydrake.geometry import GeometryId, Role, SceneGraphInspector
from pydrake.multibody.plant import MultibodyPlant


def CollisionGeometries(
    plant: MultibodyPlant, inspector: SceneGraphInspector, model: str, part: str
) -> list[GeometryId]:
    """Returns those of a link or, where no link is named so, those whose names match.

    Args:
        plant: The plant.
        inspector: Its scene graph's inspector.
        model: The model instance.
        part: A link, or a regular expression that must match the whole of a geometry's name
            (without the model's scope).

    Returns:
        The geometries; empty where there is no such part.
    """
    instance = plant.GetModelInstanceByName(model)
    bodies = [plant.get_body(index) for index in plant.GetBodyIndices(instance)]
    named = [body for body in bodies if body.name() == part]
    geometries = [
        geometry_id
        for body in named or bodies
        for geometry_id in inspector.GetGeometries(
            plant.GetBodyFrameIdOrThrow(body.index()), Role.kProximity
        )
    ]
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
    """Returns "model::link::geometry" of a geometry of the plant, e.g. "rack::rod::bar"."""
    body = plant.GetBodyFromFrameId(inspector.GetFrameId(geometry_id))
    model = plant.GetModelInstanceName(body.model_instance())
    return f"{model}::{body.name()}::{_own_name(inspector, geometry_id)}"


def _own_name(inspector: SceneGraphInspector, geometry_id: GeometryId) -> str:
    return inspector.GetName(geometry_id).split("::")[-1]
