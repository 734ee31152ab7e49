"""Whether a scenario's names and start fit its models."""

from pydrake.geometry import SceneGraphInspector
from pydrake.multibody.plant import MultibodyPlant

from poil_drake.diagrams.scenario.collision_parts import CollisionGeometries, ScopedGeometryName
from poil_drake.diagrams.scenario.models import RequireModel
from poil_drake.diagrams.scenario.poil_config import PoilConfig
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import ScenarioError
from poil_drake.robots.panda import BASE_LINK

_LIMIT_TOLERANCE = 1e-6  # [rad or m]: what decimals in a file lose of a limit


def CheckScenarioFits(
    plant: MultibodyPlant, inspector: SceneGraphInspector, scenario: Scenario
) -> None:
    """Checks what would otherwise show only after minutes, or not at all.

    Args:
        plant: The plant with the scenario's models, finalized.
        inspector: Its scene graph's inspector.
        scenario: The scenario.

    Raises:
        ScenarioError: when the object cannot move or the robot's base can, the fixture or what
            holds the object there is missing, a driver drives nothing, or a joint starts beyond
            its limits.
    """
    poil = scenario.poil
    RequireModel(plant, poil.fixture, "fixture")
    _require_holder(plant, inspector, poil)
    RequireFreeObject(plant, poil.object)
    _require_welded_base(plant, poil)
    for name in scenario.model_drivers:
        if name != poil.robot:
            raise ScenarioError(
                f"model_drivers names '{name}', but only the robot '{poil.robot}' is driven.",
                remedy=f"Name it '{poil.robot}', or leave it out.",
            )
    for name in scenario.initial_position:
        _require_start_within_limits(plant, name)


def RequireFreeObject(plant: MultibodyPlant, name: str) -> None:
    """Checks that a model can be moved as a whole.

    Args:
        plant: The plant, finalized.
        name: The model's name.

    Raises:
        ScenarioError: when it is joined to something.
    """
    bodies = plant.GetBodyIndices(plant.GetModelInstanceByName(name))
    if not plant.get_body(bodies[0]).is_floating_base_body():
        raise ScenarioError(
            f"The object '{name}' is welded to something.",
            remedy="Do not weld the object in the directives: it shall move.",
        )


def _require_welded_base(plant: MultibodyPlant, poil: PoilConfig) -> None:
    robot = plant.GetModelInstanceByName(poil.robot)
    if not plant.IsAnchored(plant.GetBodyByName(BASE_LINK, robot)):
        raise ScenarioError(
            f"The base '{poil.robot}::{BASE_LINK}' of the robot is not fixed to the world.",
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
        f"The fixture '{poil.fixture}' has no link, and no geometries, named '{rod}' for the "
        "object to hang on.",
        remedy="Set poil.demonstration_motion.hanging.rod to one of the links "
        f"({', '.join(links)}) or to a regular expression on the names of the geometries that "
        f"collide ({', '.join(geometries)}).",
    )


def _require_start_within_limits(plant: MultibodyPlant, model: str) -> None:
    for index in plant.GetJointIndices(plant.GetModelInstanceByName(model)):
        joint = plant.get_joint(index)
        limits = zip(
            joint.default_positions(),
            joint.position_lower_limits(),
            joint.position_upper_limits(),
            strict=True,
        )
        for position, lower, upper in limits:
            if not lower - _LIMIT_TOLERANCE <= position <= upper + _LIMIT_TOLERANCE:
                raise ScenarioError(
                    f"initial_position.{model}.{joint.name()} is {position}, beyond the joint's "
                    f"limits {lower} and {upper}.",
                    remedy="Write a value between them, in radians or metres.",
                )
