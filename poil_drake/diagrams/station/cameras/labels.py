"""Render labels: which pixels of a label image belong to which object and part."""

import re
from collections.abc import Mapping
from dataclasses import dataclass

from pydrake.geometry import GeometryId, PerceptionProperties, RenderLabel, Role, SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from poil_drake.errors import ScenarioError


@dataclass(frozen=True)
class PartGeometry:
    """A geometry that cameras see.

    Attributes:
        id: The geometry's ID.
        link: Name of the geometry's link, without the model's scope.
        name: Name of the geometry, without the model's scope.
    """

    id: GeometryId
    link: str
    name: str


def AssignLabels(
    *,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    parts: Mapping[str, Mapping[str, str]],
) -> dict[str, tuple[int, ...]]:
    """Gives every model instance and every named part its own render label.

    Call this before `plant.Finalize()` and before cameras are added.

    Args:
        plant: The plant with all models.
        scene_graph: The plant's scene graph.
        parts: Model instance -> part -> name of the part's link, or a regular expression for the
            whole names of the part's geometries, without the model's scope.

    Returns:
        Name -> labels. "mug" has all labels of the model, and "mug/handle" those of the part.

    Raises:
        ScenarioError: if a model or part does not exist, a pattern is invalid, or parts overlap.
    """
    label_ids: dict[str, tuple[int, ...]] = {}
    next_label = 1
    instances = model_instances(plant)
    for unknown in set(parts) - set(instances):
        raise ScenarioError(
            f"The scenario names parts of the model '{unknown}', which no directive adds.",
            remedy=f"Choose one of: {', '.join(instances)}.",
        )
    for model, instance in instances.items():
        geometries = drawn_geometries(plant, scene_graph, instance)
        assigned = {
            part: _geometries_of_part(geometries, pattern, model=model, part=part)
            for part, pattern in parts.get(model, {}).items()
        }
        taken: dict[GeometryId, str] = {}
        for part, found in assigned.items():
            for geometry in found:
                if geometry.id in taken:
                    raise ScenarioError(
                        f"The geometry '{geometry.name}' of '{model}' belongs to two parts, "
                        f"'{taken[geometry.id]}' and '{part}'.",
                        remedy="Change the patterns in poil.parts so that they do not overlap.",
                    )
                taken[geometry.id] = part
        assigned[""] = [g for g in geometries if g.id not in taken]
        labels = []
        for part, found in assigned.items():
            for geometry in found:
                _set_label(plant, scene_graph, geometry.id, next_label)
            labels.append(next_label)
            if part:
                label_ids[f"{model}/{part}"] = (next_label,)
            next_label += 1
        label_ids[model] = tuple(labels)
    return label_ids


def drawn_geometries(
    plant: MultibodyPlant, scene_graph: SceneGraph, instance: ModelInstanceIndex
) -> list[PartGeometry]:
    """Returns the geometries of a model instance that cameras see."""
    inspector = scene_graph.model_inspector()
    found = []
    for index in plant.GetBodyIndices(instance):
        body = plant.get_body(index)
        frame = plant.GetBodyFrameIdOrThrow(index)
        for geometry_id in inspector.GetGeometries(frame, Role.kPerception):
            name = inspector.GetName(geometry_id).split("::")[-1]
            found.append(PartGeometry(geometry_id, body.name(), name))
    return found


def model_instances(plant: MultibodyPlant) -> dict[str, ModelInstanceIndex]:
    """Returns the plant's model instances by name, except the world and those without bodies."""
    instances = (ModelInstanceIndex(i) for i in range(plant.num_model_instances()))
    return {
        plant.GetModelInstanceName(i): i
        for i in instances
        if plant.GetBodyIndices(i) and int(i) > 0
    }


def _geometries_of_part(
    geometries: list[PartGeometry], pattern: str, *, model: str, part: str
) -> list[PartGeometry]:
    try:
        expression = re.compile(pattern)
    except re.error as error:
        raise ScenarioError(
            f"The pattern '{pattern}' of part '{part}' is an invalid regular expression ({error}).",
            remedy="Correct the pattern in poil.parts.",
        ) from error
    found = [g for g in geometries if g.link == pattern]
    found = found or [g for g in geometries if expression.fullmatch(g.name)]
    if not found:
        links = ", ".join(sorted({g.link for g in geometries}))
        names = ", ".join(sorted({g.name for g in geometries}))
        raise ScenarioError(
            f"The part '{part}' of '{model}' was not found: no link is named '{pattern}', and no "
            "geometry's name matches this expression.",
            remedy=f"Set poil.parts.{part} to one of the links ({links}) or to a regular "
            f"expression for the geometry names ({names}).",
        )
    return found


def _set_label(
    plant: MultibodyPlant, scene_graph: SceneGraph, geometry_id: GeometryId, label: int
) -> None:
    source = plant.get_source_id()
    properties = PerceptionProperties(
        scene_graph.model_inspector().GetPerceptionProperties(geometry_id)
    )
    properties.UpdateProperty("label", "id", RenderLabel(label))
    # Drake cannot replace perception properties in place.
    scene_graph.RemoveRole(source, geometry_id, Role.kPerception)
    scene_graph.AssignRole(source, geometry_id, properties)
