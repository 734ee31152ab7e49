"""Adds the models of a scenario to the plant of a station, and checks that they fit together."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydrake.geometry import SceneGraph, SceneGraphInspector
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from poil_drake.diagrams.scenario.concave_meshes import ReplaceConcaveMeshes
from poil_drake.diagrams.scenario.meshes import MakeMeshesDrawable, RequireMetres
from poil_drake.diagrams.scenario.model_checks import CheckModels
from poil_drake.diagrams.scenario.model_parts import (
    CollisionGeometries,
    GeometryChoices,
    RequireModels,
)
from poil_drake.diagrams.scenario.models import (
    AddModels,
    AddPackages,
    FinishModels,
    FlatDirectives,
    SetInitialPositions,
)
from poil_drake.diagrams.scenario.poil_config import PoilConfig
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.cameras.labels import AssignLabels
from poil_drake.diagrams.station.panda_arm import SetControllerGains
from poil_drake.errors import ScenarioError
from poil_drake.robots.panda import BASE_LINK
from poil_drake.systems.disturbance_injector import pulses_with_bodies

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
    AddPackages(parser, scenario, package_xmls)
    if parser_preload_callback is not None:
        parser_preload_callback(parser)
    directives = FlatDirectives(scenario.directives, parser.package_map())
    AddModels(parser, directives)
    RequireModels(plant, {r: getattr(poil, r) for r in ("robot", "object", "fixture")})
    RequireMetres(scene_graph)
    ReplaceConcaveMeshes(plant, scene_graph, poil)
    SetControllerGains(plant, scenario)
    SetInitialPositions(plant, scenario)
    label_ids = AssignLabels(
        plant=plant,
        scene_graph=scene_graph,
        parts={poil.object: {poil.part: poil.part, **poil.parts}, poil.fixture: {}},
    )
    MakeMeshesDrawable(plant, scene_graph)
    if parser_prefinalize_callback is not None:
        parser_prefinalize_callback(parser)
    FinishModels(plant, directives)
    _check_fit(plant, scene_graph.model_inspector(), scenario)
    return label_ids


def _check_fit(plant: MultibodyPlant, inspector: SceneGraphInspector, scenario: Scenario) -> None:
    """Checks a scenario's names and initial positions against the models of a finalized plant.

    Raises:
        ScenarioError: The object cannot move freely, or its size is wrong; the robot's base is not
            fixed to the world; the fixture has no rod; `model_drivers` names another model than the
            robot; a joint starts outside its limits; or a disturbance acts on an unknown body.
    """
    poil = scenario.poil
    _require_holder(plant, inspector, poil)
    CheckModels(plant, inspector, poil.object)
    _require_welded_base(plant, poil)
    for name in scenario.model_drivers:
        if name != poil.robot:
            raise ScenarioError(
                f"model_drivers names '{name}', but only the robot '{poil.robot}' has a driver.",
                remedy=f"Rename this key of model_drivers to '{poil.robot}', or remove it.",
            )
    pulses_with_bodies(plant, poil.disturbances)


def _require_welded_base(plant: MultibodyPlant, poil: PoilConfig) -> None:
    robot = plant.GetModelInstanceByName(poil.robot)
    if not plant.IsAnchored(plant.GetBodyByName(BASE_LINK, robot)):
        raise ScenarioError(
            f"The robot's base '{poil.robot}::{BASE_LINK}' is not fixed to the world.",
            remedy="Weld it in the directives: add_weld: {parent: world, child: "
            f"{poil.robot}::{BASE_LINK}}}.",
        )


def _require_holder(
    plant: MultibodyPlant, inspector: SceneGraphInspector, poil: PoilConfig
) -> None:
    rod = poil.demonstration_motion.hanging.rod
    if CollisionGeometries(plant, inspector, poil.fixture, rod):
        return
    known = CollisionGeometries(plant, inspector, poil.fixture, ".*")
    raise ScenarioError(
        f"poil.demonstration_motion.hanging.rod is '{rod}', but the fixture '{poil.fixture}' has "
        "no such link or collision geometry.",
        remedy=f"Set this key to one of {GeometryChoices(known)}. Shapes that are only visual do "
        "not count.",
    )
