"""A plant with a scenario's models."""

import copy
from collections.abc import Sequence
from pathlib import Path

from pydrake.geometry import SceneGraph
from pydrake.multibody.parsing import (
    ModelDirective,
    ModelDirectives,
    Parser,
    ProcessModelDirectives,
)
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

import poil_drake.models
from poil_drake.diagrams.labels import model_instances
from poil_drake.diagrams.scenario import Scenario
from poil_drake.errors import ScenarioError
from poil_drake.models.panda_model import PANDA_PACKAGE, panda_package_directory


def AddScenarioPlant(
    builder: DiagramBuilder, scenario: Scenario
) -> tuple[MultibodyPlant, SceneGraph]:
    """Adds an empty plant with the scenario's settings and time step."""
    config = copy.deepcopy(scenario.plant_config)
    config.time_step = scenario.poil.rates.plant
    plant, scene_graph = AddMultibodyPlant(config, builder)
    return plant, scene_graph


def AddPackages(parser: Parser, package_xmls: Sequence[str | Path]) -> None:
    """Tells a parser where our own models, the robot's and further packages are.

    Raises:
        MissingDependencyError: when the Panda's description is not installed.
    """
    packages = parser.package_map()
    packages.AddPackageXml(str(Path(poil_drake.models.__file__).parent / "package.xml"))
    packages.Add(PANDA_PACKAGE, str(panda_package_directory()))
    for path in package_xmls:
        packages.AddPackageXml(str(path))


def AddModels(parser: Parser, directives: Sequence[ModelDirective]) -> None:
    """Carries out directives.

    Raises:
        ScenarioError: when a file or frame does not exist.
    """
    try:
        ProcessModelDirectives(ModelDirectives(directives=list(directives)), parser)
    except RuntimeError as error:
        reason = " ".join(str(error).split())
        raise ScenarioError(
            f"The directives cannot be carried out: {reason}.",
            remedy="Check the files and the model, link and frame names in the directives.",
        ) from error


def RequireModel(plant: MultibodyPlant, name: str, role: str) -> None:
    """Checks that the model with a role in `poil` ("object", "robot", "fixture") exists.

    Raises:
        ScenarioError: naming the models that there are.
    """
    if not plant.HasModelInstanceNamed(name):
        raise ScenarioError(
            f"poil.{role} is '{name}', but no directive adds a model of that name.",
            remedy=f"Choose one of: {', '.join(model_instances(plant))}.",
        )
