"""Checks the models of a finalized plant: where joints and the object start, mass and size."""

import numpy as np
from pydrake.geometry import QueryObject, Role, SceneGraphInspector
from pydrake.multibody.plant import MultibodyPlant

from poil_drake.diagrams.scenario.meshes import BoxCorners
from poil_drake.diagrams.scenario.model_parts import BaseBody, CarriedBodies, ModelBodies
from poil_drake.errors import ScenarioError

_LIMIT_TOLERANCE = 1e-6  # [rad or m]; limits in files are rounded.
_UNITS = {"revolute": " rad", "prismatic": " m"}
_LARGEST_OBJECT = 1.0  # [m]; nothing that a Panda's hand can carry is larger.
_SMALLEST_OBJECT = 0.005  # [m]; cameras and fingers lose smaller objects.
_LARGEST_MASS = 3.0  # [kg]; a Panda carries no more.
_LARGEST_OVERLAP = 0.01  # [m] of an object and what it stands on.
_LEAST_INERTIA = 1e-9  # Of a mass at the distance of an object's size.


def RequireStartWithinLimits(plant: MultibodyPlant) -> None:
    """Checks that every joint of a finalized plant starts within its limits.

    Raises:
        ScenarioError: A joint does not, whatever set its position.
    """
    for joint in [plant.get_joint(index) for index in plant.GetJointIndices()]:
        q = joint.default_positions()
        lower, upper = joint.position_lower_limits(), joint.position_upper_limits()
        if np.all(q >= lower - _LIMIT_TOLERANCE) and np.all(q <= upper + _LIMIT_TOLERANCE):
            continue
        model = plant.GetModelInstanceName(joint.model_instance())
        unit = _UNITS.get(joint.type_name(), "")
        limits = f"{_text(lower)} and {_text(upper)}{unit}"
        raise ScenarioError(
            f"The joint '{joint.name()}' of '{model}' starts at {_text(q)}{unit}, beyond its "
            f"limits {limits}.",
            remedy=f"Set initial_position.{model}.{joint.name()}, or default_joint_positions in "
            f"the directive that adds '{model}', to a value within the limits, in radians or "
            "metres.",
        )


def RequireMass(plant: MultibodyPlant) -> None:
    """Checks that whatever moves in a finalized plant has mass.

    Raises:
        ScenarioError: A joint, or nothing, connects bodies without mass to the rest.
    """
    for joint in [plant.get_joint(index) for index in plant.GetJointIndices()]:
        carried = [plant.get_body(body) for body in CarriedBodies(plant, joint.child_body())]
        if joint.num_velocities() == 0 or sum(body.default_mass() for body in carried) > 0.0:
            continue
        names = ", ".join(body.scoped_name().get_full() for body in carried)
        raise ScenarioError(
            f"The links {names} move, but have no mass, so they cannot be simulated.",
            remedy="Give one of them a mass and an inertia in the model's file: <inertial> in URDF "
            "and SDFormat, the mass or density of a geom in MJCF.",
        )


def RequireObjectSize(plant: MultibodyPlant, inspector: SceneGraphInspector, name: str) -> None:
    """Checks that the object `name` of a finalized plant has a size that a hand can hold.

    Raises:
        ScenarioError: It does not, so a unit is wrong.
    """
    size = float(np.max(_sides(plant, inspector, name)))
    if size == 0.0 or _SMALLEST_OBJECT <= size <= _LARGEST_OBJECT:
        return
    text = f"{1000.0 * size:.3g} mm" if size < _SMALLEST_OBJECT else f"{size:.3g} m"
    raise ScenarioError(
        f"The object '{name}' is {text} large.",
        remedy="Check the units of its model's file: lengths are in metres, and each mesh has a "
        f"scale. An object is {_SMALLEST_OBJECT:g} m to {_LARGEST_OBJECT:g} m large.",
    )


def RequireObjectInertia(plant: MultibodyPlant, inspector: SceneGraphInspector, name: str) -> None:
    """Checks that the object `name` of a finalized plant has a mass and an inertia that fit it.

    Raises:
        ScenarioError: It has no inertia, or one that no body within the object's bounding box can
            have; or it is too heavy.
    """
    frame, bodies = BaseBody(plant, name).body_frame(), ModelBodies(plant, name)
    inertia = plant.CalcSpatialInertia(plant.CreateDefaultContext(), frame, bodies)
    about_center = inertia.Shift(inertia.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
    moments, mass = np.linalg.eigvalsh(about_center), inertia.get_mass()
    diagonal = float(np.linalg.norm(_sides(plant, inspector, name))) or _LARGEST_OBJECT
    # Of a body within the diagonal; a point mass has rounding errors instead of moments.
    if _LEAST_INERTIA * mass * diagonal**2 < moments[0] and moments[-1] <= mass * diagonal**2:
        if mass <= _LARGEST_MASS:
            return
        raise ScenarioError(
            f"The object '{name}' has a mass of {mass:.3g} kg, but the robot carries at most "
            f"{_LARGEST_MASS:g} kg.",
            remedy="Correct the masses in the model's file; they are in kilograms.",
        )
    raise ScenarioError(
        f"The object '{name}' has a mass of {mass:.3g} kg and moments of inertia of "
        f"{max(moments[0], 0.0):.1g} to {moments[-1]:.3g} kg m^2, which do not fit a size of "
        f"{diagonal:.3g} m.",
        remedy="Correct the mass and inertia in the model's file. A link without <inertial> has "
        "1 kg and 1 kg m^2 in SDFormat.",
    )


def RequireFreeStart(plant: MultibodyPlant, query: QueryObject, name: str) -> None:
    """Checks that the object `name` is not inside another model at the time of a query.

    Raises:
        ScenarioError: It is, as one that nothing has placed is in the base of the robot.
    """
    own, inspector = set(ModelBodies(plant, name)), query.inspector()
    for pair in query.ComputePointPairPenetration():
        frames = map(inspector.GetFrameId, (pair.id_A, pair.id_B))
        others = [b for b in map(plant.GetBodyFromFrameId, frames) if b.index() not in own]
        if len(others) == 1 and pair.depth > _LARGEST_OVERLAP:
            raise ScenarioError(
                f"The object '{name}' starts {1000 * pair.depth:.0f} mm inside "
                f"'{others[0].scoped_name().get_full()}'.",
                remedy="Set default_free_body_pose of its base link in the directive that adds "
                f"'{name}', or its pose in the model's file, to a free place.",
            )


def _sides(plant: MultibodyPlant, inspector: SceneGraphInspector, name: str) -> np.ndarray:
    """Returns the sides (3,) of a model's box along its base's axes [m]; 0 without geometry."""
    context = plant.CreateDefaultContext()
    X_BW = BaseBody(plant, name).EvalPoseInWorld(context).inverse()
    corners = []
    for body in ModelBodies(plant, name):
        X_BL = X_BW @ plant.get_body(body).EvalPoseInWorld(context)
        for role in (Role.kProximity, Role.kPerception):
            for geometry in inspector.GetGeometries(plant.GetBodyFrameIdOrThrow(body), role):
                X_BG = X_BL @ inspector.GetPoseInFrame(geometry)
                corners.append(X_BG.multiply(BoxCorners(inspector.GetShape(geometry))))
    return np.ptp(np.concatenate(corners, axis=1), axis=1) if corners else np.zeros(3)


def _text(q: np.ndarray) -> str:
    return f"{q[0]:g}" if len(q) == 1 else str(q.tolist())
