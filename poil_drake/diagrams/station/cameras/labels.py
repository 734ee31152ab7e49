"""Render labels: which pixels of a label image belong to which object and part."""

import re
from collections.abc import Mapping

from pydrake.geometry import GeometryId, PerceptionProperties, RenderLabel, Role, SceneGraph
from pydrake.multibody.plant import MultibodyPlant

from poil_drake.diagrams.scenario.models import (
    ModelGeometries,
    ModelGeometry,
    PartGeometries,
    model_names,
)
from poil_drake.diagrams.scenario.poil_config import PartRegion
from poil_drake.diagrams.station.cameras.part_regions import SeparateParts
from poil_drake.errors import ScenarioError


def AssignLabels(
    *,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    parts: Mapping[str, Mapping[str, str | PartRegion]],
) -> dict[str, tuple[int, ...]]:
    """Gives every model instance and every named part its own render label.

    Call this before `plant.Finalize()` and before cameras are added.

    Args:
        plant: The plant with all models.
        scene_graph: The plant's scene graph.
        parts: Model instance -> part -> name of the part's link, a regular expression for the
            whole names of the part's geometries, without the model's scope, or a region of the
            model's visual meshes. Meshes that reach into a region are split there.

    Returns:
        Name -> labels. "mug" has all labels of the model, and "mug/handle" those of the part.

    Raises:
        ScenarioError: if a model or part does not exist, a pattern is invalid, or parts overlap.
    """
    label_ids: dict[str, tuple[int, ...]] = {}
    next_label = 1
    models = model_names(plant)
    for unknown in set(parts) - set(models):
        raise ScenarioError(
            f"The scenario names parts of the model '{unknown}', which no directive adds.",
            remedy=f"Choose one of: {', '.join(models)}.",
        )
    for model in models:
        patterns = SeparateParts(plant, scene_graph, model, parts.get(model, {}))
        inspector = scene_graph.model_inspector()
        geometries = ModelGeometries(plant, inspector, model, Role.kPerception)
        assigned = {
            part: _geometries_of_part(geometries, pattern, model=model, part=part)
            for part, pattern in patterns.items()
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
                seen = PerceptionProperties(inspector.GetPerceptionProperties(geometry.id))
                seen.UpdateProperty("label", "id", RenderLabel(next_label))
                # Drake cannot replace perception properties in place.
                scene_graph.RemoveRole(plant.get_source_id(), geometry.id, Role.kPerception)
                scene_graph.AssignRole(plant.get_source_id(), geometry.id, seen)
            labels.append(next_label)
            if part:
                label_ids[f"{model}/{part}"] = (next_label,)
            next_label += 1
        label_ids[model] = tuple(labels)
    return label_ids


def _geometries_of_part(
    geometries: list[ModelGeometry], pattern: str, *, model: str, part: str
) -> list[ModelGeometry]:
    try:
        found = PartGeometries(geometries, pattern)
    except re.error as error:
        raise ScenarioError(
            f"The pattern '{pattern}' of part '{part}' is an invalid regular expression ({error}).",
            remedy="Correct the pattern in poil.parts.",
        ) from error
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
