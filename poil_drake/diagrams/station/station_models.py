"""Adds the models of a scenario to the plant of a station."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydrake.geometry import SceneGraph
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from poil_drake.diagrams.scenario.models import (
    AddModels,
    AddPackages,
    RequireModel,
    SetInitialPositions,
)
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.cameras.labels import AssignLabels
from poil_drake.diagrams.station.panda_arm import SetControllerGains
from poil_drake.systems.panda.velocity_driver import PandaDriver

PrefinalizeCallback = Callable[[Parser], None]
"""Called with the parser while models can still be added."""


def MakeUnsimulatedPlant(
    scenario: Scenario, **options: Any
) -> tuple[MultibodyPlant, SceneGraph, Mapping[str, tuple[int, ...]]]:
    """Makes a plant of the scenario's models for kinematics; nothing simulates it.

    Args:
        scenario: Names the models.
        options: Further arguments of `AddStationModels`.

    Returns:
        The plant, its scene graph, and its render labels by name.
    """
    plant, scene_graph = MultibodyPlant(scenario.poil.rates.plant), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    label_ids = AddStationModels(plant=plant, scene_graph=scene_graph, scenario=scenario, **options)
    return plant, scene_graph, label_ids


def AddStationModels(
    *,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    scenario: Scenario,
    package_xmls: Sequence[str | Path] = (),
    parser_preload_callback: PrefinalizeCallback | None = None,
    parser_prefinalize_callback: PrefinalizeCallback | None = None,
) -> Mapping[str, tuple[int, ...]]:
    """Adds the scenario's models to an empty plant, finalizes it, and returns the render labels.

    Args:
        plant: The plant.
        scene_graph: The plant's scene graph.
        scenario: Names the models and their initial positions.
        package_xmls: Further `package.xml` files, for `package://` URLs in the directives.
        parser_preload_callback: Called with the parser before the directives are read.
        parser_prefinalize_callback: Called with the parser before the plant is finalized.

    Returns:
        Render labels by name, such as "mug", "mug/handle" or "rack".

    Raises:
        ScenarioError: if the scenario is inconsistent.
        StationError: if the robot is not a Panda.
        MissingDependencyError: if the Panda's description is not installed.
    """
    poil = scenario.poil
    parser = Parser(plant)
    AddPackages(parser, package_xmls)
    if parser_preload_callback is not None:
        parser_preload_callback(parser)
    AddModels(parser, scenario.directives)
    for role, name in (("robot", poil.robot), ("object", poil.object)):
        RequireModel(plant, name, role)
    SetControllerGains(
        plant=plant,
        robot=plant.GetModelInstanceByName(poil.robot),
        config=scenario.model_drivers.get(poil.robot, PandaDriver()),
    )
    SetInitialPositions(plant, scenario)
    label_ids = AssignLabels(
        plant=plant,
        scene_graph=scene_graph,
        parts={poil.object: {poil.part: poil.part, **poil.parts}},
    )
    if parser_prefinalize_callback is not None:
        parser_prefinalize_callback(parser)
    plant.Finalize()
    return label_ids
