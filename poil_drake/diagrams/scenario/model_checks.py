"""Checks the models of a finalized plant: where joints start, mass and size."""

import numpy as np
from pydrake.geometry import Role, SceneGraphInspector
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia

from poil_drake.diagrams.scenario.meshes import BoxCorners
from poil_drake.diagrams.scenario.model_parts import (
    BaseBody,
    CarriedBodies,
    ModelBodies,
    RequireFreeObject,
)
from poil_drake.errors import ScenarioError

_LIMIT_TOLERANCE = 1e-6  # [rad or m]; limits in files are rounded.
_UNITS = {"revolute": " rad", "prismatic": " m"}
_LARGEST_OBJECT = 1.0  # [m]; nothing that a Panda's hand can carry is larger.
_SMALLEST_OBJECT = 0.005  # [m]; cameras and fingers lose smaller objects.
_PAYLOAD = 3.0  # [kg], the Panda's.
_LEAST_INERTIA = 1e-9  # Of a mass at the distance of an object's size.
_SUBSTITUTE = SpatialInertia.SolidSphereWithDensity(
    density=1000.0, radius=np.cbrt(3.0 / (4000.0 * np.pi))
).CopyToFullMatrix6()
"""What Drake takes instead of a mass that is not positive in a URDF file, with a warning."""


def CheckModels(plant: MultibodyPlant, inspector: SceneGraphInspector, name: str) -> None:
    """Checks the object `name` and the joints of a finalized plant.

    Raises:
        ScenarioError: The object does not move freely as one piece, or is too large or too small;
            or a joint starts beyond its limits.
    """
    RequireFreeObject(plant, name)
    _require_object_size(plant, inspector, name)
    _require_start_within_limits(plant)


def _require_start_within_limits(plant: MultibodyPlant) -> None:
    """Checks that every joint starts within its limits, whatever set its position."""
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


def _require_object_size(plant: MultibodyPlant, inspector: SceneGraphInspector, name: str) -> None:
    """Checks that an object has a size that a hand can hold; if not, a unit is wrong."""
    size = float(np.max(np.ptp(_box(plant, inspector, name), axis=0)))
    if size == 0.0 or _SMALLEST_OBJECT <= size <= _LARGEST_OBJECT:
        return
    text = f"{1000.0 * size:.3g} mm" if size < _SMALLEST_OBJECT else f"{size:.3g} m"
    raise ScenarioError(
        f"The object '{name}' is {text} large.",
        remedy="Check the units of its model's file: lengths are in metres, and each mesh has a "
        f"scale. An object is {_SMALLEST_OBJECT:g} m to {_LARGEST_OBJECT:g} m large.",
    )


def RequireObjectInertia(plant: MultibodyPlant, inspector: SceneGraphInspector, name: str) -> None:
    """Checks that the object `name` of a finalized plant has a plausible mass and inertia.

    Raises:
        ScenarioError: It is too heavy for the robot. Or it has no inertia, or one that no body
            within the object's bounding box can have; or its centre of mass is outside; or Drake
            has replaced a mass.
    """
    frame, bodies = BaseBody(plant, name).body_frame(), ModelBodies(plant, name)
    for body in map(plant.get_body, bodies):
        own = body.default_spatial_inertia()
        about_center = own.Shift(own.get_com()).CopyToFullMatrix6()
        if np.allclose(about_center, _SUBSTITUTE, rtol=1e-9, atol=1e-12):
            raise ScenarioError(
                f"The mass of '{body.scoped_name()}' is impossible in its file; Drake warns of it, "
                "and takes a ball of 1 kg.",
                remedy="Give the link a positive mass.",
            )
    inertia = plant.CalcSpatialInertia(plant.CreateDefaultContext(), frame, bodies)
    rotational = inertia.Shift(inertia.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
    moments, mass = np.linalg.eigvalsh(rotational), inertia.get_mass()
    if mass > _PAYLOAD:
        raise ScenarioError(
            f"The object '{name}' has a mass of {mass:.3g} kg; a Panda carries {_PAYLOAD:g} kg.",
            remedy="Correct the mass in the model's file; it is in kilograms.",
        )
    lower, upper = _box(plant, inspector, name)
    if np.array_equal(lower, upper):
        return
    diagonal, center = float(np.linalg.norm(upper - lower)), inertia.get_com()
    is_inside = np.all((lower - 0.1 * diagonal < center) & (center < upper + 0.1 * diagonal))
    # Of a body within the box; a point mass has rounding errors instead of moments.
    least, most = _LEAST_INERTIA * mass * diagonal**2, mass * diagonal**2
    if is_inside and least < moments[0] and moments[-1] <= most:
        return
    raise ScenarioError(
        f"The object '{name}' has a mass of {mass:.3g} kg at {_text(center.round(4))} m and "
        f"moments of inertia of {max(moments[0], 0.0):.1g} to {moments[-1]:.3g} kg m^2, which do "
        f"not fit its shapes, from {_text(lower.round(4))} to {_text(upper.round(4))} m.",
        remedy="Correct the mass and inertia in the model's file; lengths are in metres. A link "
        "without <inertial> has 1 kg and 1 kg m^2 in SDFormat.",
    )


def _box(plant: MultibodyPlant, inspector: SceneGraphInspector, name: str) -> np.ndarray:
    """Returns the corners (2, 3) of a model's box along its base's axes [m]; 0 without geometry."""
    context = plant.CreateDefaultContext()
    X_BW = BaseBody(plant, name).EvalPoseInWorld(context).inverse()
    corners = []
    for body in ModelBodies(plant, name):
        X_BL = X_BW @ plant.get_body(body).EvalPoseInWorld(context)
        for role in (Role.kProximity, Role.kPerception):
            for geometry in inspector.GetGeometries(plant.GetBodyFrameIdOrThrow(body), role):
                X_BG = X_BL @ inspector.GetPoseInFrame(geometry)
                corners.append(X_BG.multiply(BoxCorners(inspector.GetShape(geometry))))
    if not corners:
        return np.zeros((2, 3))
    joined = np.concatenate(corners, axis=1)
    return np.stack([joined.min(axis=1), joined.max(axis=1)])


def _text(q: np.ndarray) -> str:
    return f"{q[0]:g}" if len(q) == 1 else str(q.tolist())
