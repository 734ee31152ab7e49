"""Finds the geometries that a model is inside."""

from collections.abc import Collection
from typing import NamedTuple

from pydrake.geometry import GeometryId, Mesh, QueryObject, Role, SceneGraphInspector
from pydrake.multibody.plant import MultibodyPlant

from poil_drake.diagrams.scenario.model_parts import BodiesByModel, ModelGeometries

WORLD = "world::world::"
"""Stands for the names of geometries that belong to no model."""


START_TOLERANCE = 0.005
"""How deep an object may be inside another, or how far above its support it may start [m]."""


class Penetration(NamedTuple):
    """A geometry that a model is inside.

    Attributes:
        depth: How deep [m].
        geometry: The geometry's scoped name, e.g. "rack::rod::bar".
        is_mesh: Whether it is a mesh, which counts as its convex hull.
    """

    depth: float
    geometry: str
    is_mesh: bool


def ScopedNames(
    plant: MultibodyPlant, inspector: SceneGraphInspector, models: Collection[str]
) -> dict[GeometryId, str]:
    """Returns the names of all models' collision geometries, e.g. "rack::rod::bar".

    Args:
        plant: The plant with all models.
        inspector: The inspector of the plant's scene graph.
        models: Models whose names are scopes even if they are parts of others; see `ModelBodies`.
    """
    return {
        geometry.id: f"{model}::{geometry.link}::{geometry.name}"
        for model, bodies in BodiesByModel(plant, models).items()
        for geometry in ModelGeometries(plant, inspector, model, Role.kProximity, bodies=bodies)
    }


def Penetrations(
    plant: MultibodyPlant, query: QueryObject, model: str, *, fixture: str
) -> list[Penetration]:
    """Returns what a model is inside.

    Args:
        plant: The plant with all models.
        query: The value of the scene graph's query port.
        model: The model, e.g. the object.
        fixture: The fixture, whose name is the scope of its geometries.
    """
    inspector, found = query.inspector(), []
    names = ScopedNames(plant, inspector, (model, fixture))
    for pair in query.ComputePointPairPenetration():
        for own, other in ((pair.id_A, pair.id_B), (pair.id_B, pair.id_A)):
            name = names.get(other, WORLD)
            is_own = names.get(own, WORLD).startswith(f"{model}::")
            if is_own and not name.startswith(f"{model}::"):
                is_mesh = isinstance(inspector.GetShape(other), Mesh)
                found.append(Penetration(pair.depth, name, is_mesh))
    return found
