"""Adds a scenario's models to a plant, and finds their parts."""

import copy
import re
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydrake.geometry import GeometryId, Role, SceneGraph, SceneGraphInspector
from pydrake.manipulation import ApplyNamedPositionsAsDefaults
from pydrake.multibody.parsing import (
    ModelDirective,
    ModelDirectives,
    Parser,
    ProcessModelDirectives,
)
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder

import poil_drake.models
from poil_drake.diagrams.scenario.drake_errors import DrakeErrorsExplained
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import ScenarioError
from poil_drake.models.panda_model import PANDA_PACKAGE, panda_package_directory


def AddScenarioPlant(
    builder: DiagramBuilder, scenario: Scenario
) -> tuple[MultibodyPlant, SceneGraph]:
    """Adds an empty plant with the scenario's settings, and its scene graph; returns both.

    Raises:
        ScenarioError: Drake rejects `plant_config`.
    """
    config = copy.deepcopy(scenario.plant_config)
    config.time_step = scenario.poil.rates.plant
    with DrakeErrorsExplained(
        "plant_config cannot be used",
        remedy="Use values that the documentation of Drake's MultibodyPlantConfig allows.",
    ):
        plant, scene_graph = AddMultibodyPlant(config, builder)
    return plant, scene_graph


def AddPackages(parser: Parser, package_xmls: Sequence[str | Path] = ()) -> None:
    """Adds packages to a parser: poil_drake's models, the Panda, and those of `package_xmls`.

    Raises:
        MissingDependencyError: The Panda's description is not installed.
    """
    packages = parser.package_map()
    packages.AddPackageXml(str(Path(poil_drake.models.__file__).parent / "package.xml"))
    packages.Add(PANDA_PACKAGE, str(panda_package_directory()))
    for path in package_xmls:
        packages.AddPackageXml(str(path))


def AddModels(parser: Parser, directives: Sequence[ModelDirective]) -> None:
    """Adds the models, frames and welds of directives to the parser's plant.

    Raises:
        ScenarioError: A file, model, link or frame does not exist.
    """
    with DrakeErrorsExplained(
        "The directives cannot be processed",
        remedy="Check the files and the model, link and frame names in the directives.",
    ):
        ProcessModelDirectives(ModelDirectives(directives=list(directives)), parser)


def SetInitialPositions(
    plant: MultibodyPlant, scenario: Scenario, *, without: Collection[str] = ()
) -> None:
    """Sets the scenario's `initial_position` as the plant's default positions.

    Args:
        plant: The plant with all models.
        scenario: The scenario.
        without: Names of models whose positions are not set.

    Raises:
        ScenarioError: A model or joint does not exist, or a value does not fit its joint.
    """
    positions = {
        model: {joint: np.atleast_1d(q) for joint, q in joints.items()}
        for model, joints in scenario.initial_position.items()
        if model not in without
    }
    with DrakeErrorsExplained(
        "initial_position cannot be set",
        remedy="Correct the name of the model or joint, or the number of values.",
    ):
        ApplyNamedPositionsAsDefaults(positions, plant)


def RequireModel(plant: MultibodyPlant, name: str, role: str) -> None:
    """Checks that the plant has the model `name`, the value of `poil.<role>`.

    Raises:
        ScenarioError: There is no such model. The text lists the plant's models.
    """
    if not plant.HasModelInstanceNamed(name):
        raise ScenarioError(
            f"poil.{role} is '{name}', but no directive adds a model with that name.",
            remedy=f"Choose one of: {', '.join(model_names(plant))}.",
        )


def RequireFreeObject(plant: MultibodyPlant, name: str) -> None:
    """Checks that the model `name` of a finalized plant can move freely.

    Raises:
        ScenarioError: The model is welded or joined to something.
    """
    bodies = plant.GetBodyIndices(plant.GetModelInstanceByName(name))
    if not plant.get_body(bodies[0]).is_floating_base_body():
        raise ScenarioError(
            f"The object '{name}' is welded or joined to something, so it cannot move freely.",
            remedy="Remove the weld from the directives, or the joint from its model file.",
        )


def model_names(plant: MultibodyPlant) -> list[str]:
    """Returns the names of the plant's model instances that have bodies, except the world."""
    models = map(ModelInstanceIndex, range(1, plant.num_model_instances()))
    return [plant.GetModelInstanceName(i) for i in models if plant.GetBodyIndices(i)]


class ModelGeometry(NamedTuple):
    """A geometry of a model.

    Attributes:
        id: The geometry's ID.
        link: Name of the geometry's link, without the model's scope.
        name: Name of the geometry, without the model's scope.
    """

    id: GeometryId
    link: str
    name: str


def ModelGeometries(
    plant: MultibodyPlant, inspector: SceneGraphInspector, model: str, role: Role
) -> list[ModelGeometry]:
    """Returns the geometries of a model instance that have a role."""
    found = []
    for index in plant.GetBodyIndices(plant.GetModelInstanceByName(model)):
        link, frame = plant.get_body(index).name(), plant.GetBodyFrameIdOrThrow(index)
        for geometry_id in inspector.GetGeometries(frame, role):
            name = inspector.GetName(geometry_id).split("::")[-1]
            found.append(ModelGeometry(geometry_id, link, name))
    return found


def PartGeometries(geometries: Sequence[ModelGeometry], part: str) -> list[ModelGeometry]:
    """Returns the geometries of a part; empty if there is no such part.

    Args:
        geometries: The geometries of a model.
        part: A link of the model or, if no link has this name, a regular expression that matches
            the whole name of a geometry.

    Raises:
        re.error: There is no such link, and the regular expression is invalid.
    """
    of_link = [g for g in geometries if g.link == part]
    return of_link or [g for g in geometries if re.fullmatch(part, g.name)]


def CollisionGeometries(
    plant: MultibodyPlant, inspector: SceneGraphInspector, model: str, part: str
) -> list[ModelGeometry]:
    """Returns the collision geometries of a part of a model; empty if there is no such part.

    See `PartGeometries` for `part`; an invalid regular expression matches nothing.
    """
    try:
        return PartGeometries(ModelGeometries(plant, inspector, model, Role.kProximity), part)
    except re.error:
        return []
