"""Adds a scenario's models to a plant, and finds their parts."""

import copy
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from pydrake.geometry import GeometryId, SceneGraph, SceneGraphInspector
from pydrake.manipulation import ApplyNamedPositionsAsDefaults
from pydrake.multibody.parsing import (
    ModelDirective,
    ModelDirectives,
    Parser,
    ProcessModelDirectives,
)
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

import poil_drake.models
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.cameras.labels import model_instances
from poil_drake.errors import ScenarioError
from poil_drake.models.panda_model import PANDA_PACKAGE, panda_package_directory

_DRAKE_ERRORS = (RuntimeError, ValueError, TypeError, SystemExit)
"""What Drake raises for invalid values. A failed C++ assertion arrives in Python as SystemExit."""


@contextmanager
def DrakeErrorsExplained(problem: str, *, remedy: str) -> Iterator[None]:
    """Replaces an error that Drake raises in a `with` block by a ScenarioError.

    Args:
        problem: What is wrong, e.g. "plant_config cannot be used". Drake's reason is appended.
        remedy: What the user can do.
    """
    try:
        yield
    except _DRAKE_ERRORS as error:
        reason = " ".join(str(error).split())
        # An assertion: "Failure at <file>:<line> in <function>: condition '<C++>' failed."
        if reason.startswith("Failure at ") and ": condition " in reason:
            condition = reason.split(": condition ", 1)[1].removesuffix(" failed.")
            reason = f"Drake requires {condition}"
        raise ScenarioError(f"{problem}: {reason.rstrip('.')}.", remedy=remedy) from error


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
            remedy=f"Choose one of: {', '.join(model_instances(plant))}.",
        )


def CollisionGeometries(
    plant: MultibodyPlant, inspector: SceneGraphInspector, model: str, part: str
) -> list[GeometryId]:
    """Returns the collision geometries of a part.

    Args:
        plant: The plant.
        inspector: The inspector of the plant's scene graph.
        model: The model instance.
        part: A link of the model or, if no link has this name, a regular expression that matches
            the whole name of a geometry, without its scope.

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
