"""Checks that a scenario's names and initial positions fit its models."""

import numpy as np
from pydrake.geometry import SceneGraphInspector
from pydrake.multibody.plant import MultibodyPlant

from poil_drake.diagrams.scenario.models import (
    CollisionGeometries,
    RequireModel,
    ScopedGeometryName,
)
from poil_drake.diagrams.scenario.poil_config import PoilConfig
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import ScenarioError
from poil_drake.robots.panda import BASE_LINK

_LIMIT_TOLERANCE = 1e-6  # [rad or m]; limits in files are rounded.


def CheckScenarioFits(
    plant: MultibodyPlant, inspector: SceneGraphInspector, scenario: Scenario
) -> None:
    """Checks a scenario's names and initial positions against its models before a run starts.

    Args:
        plant: The finalized plant with the scenario's models.
        inspector: The inspector of the plant's scene graph.
        scenario: The scenario.

    Raises:
        ScenarioError: The object cannot move freely; the robot's base is not fixed to the world;
            the fixture or its rod does not exist; `model_drivers` names another model than the
            robot; or a joint starts outside its limits.
    """
    poil = scenario.poil
    RequireModel(plant, poil.fixture, "fixture")
    _require_holder(plant, inspector, poil)
    RequireFreeObject(plant, poil.object)
    _require_welded_base(plant, poil)
    for name in scenario.model_drivers:
        if name != poil.robot:
            raise ScenarioError(
                f"model_drivers names '{name}', but only the robot '{poil.robot}' has a driver.",
                remedy=f"Rename this key of model_drivers to '{poil.robot}', or remove it.",
            )
    for name in scenario.initial_position:
        _require_start_within_limits(plant, name)


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
    names = [ScopedGeometryName(plant, inspector, geometry_id) for geometry_id in known]
    links = sorted({name.split("::")[1] for name in names})
    geometries = sorted(name.split("::")[2] for name in names)
    raise ScenarioError(
        f"poil.demonstration_motion.hanging.rod is '{rod}', but the fixture '{poil.fixture}' has "
        "no such link or collision geometry.",
        remedy=f"Set this key to one of the links ({', '.join(links)}), or to a regular expression "
        f"for names of collision geometries ({', '.join(geometries)}).",
    )


def _require_start_within_limits(plant: MultibodyPlant, model: str) -> None:
    for index in plant.GetJointIndices(plant.GetModelInstanceByName(model)):
        joint = plant.get_joint(index)
        q = joint.default_positions()
        lower, upper = joint.position_lower_limits(), joint.position_upper_limits()
        if np.any(q < lower - _LIMIT_TOLERANCE) or np.any(q > upper + _LIMIT_TOLERANCE):
            raise ScenarioError(
                f"initial_position.{model}.{joint.name()} is {q.tolist()}, beyond the joint's "
                f"limits {lower.tolist()} and {upper.tolist()}.",
                remedy="Use values within the limits, in radians or metres.",
            )
