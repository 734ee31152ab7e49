"""Finds models, their bodies and their parts in a plant."""

import re
from collections.abc import Collection, Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

from pydrake.geometry import GeometryId, Role, SceneGraphInspector
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex, RigidBody, world_index

from poil_drake.errors import ScenarioError


def ModelBodies(plant: MultibodyPlant, name: str) -> list[BodyIndex]:
    """Returns the bodies of a model; empty if there is no such model.

    Args:
        plant: The plant with all models.
        name: A model instance, e.g. "mug", which includes the models nested in it; or one body of
            a model instance, e.g. "kitchen::mug", which includes the bodies that its joints carry.
    """
    if plant.HasModelInstanceNamed(name):
        nested = [i for i in _instances(plant) if IsPartOf(plant.GetModelInstanceName(i), name)]
        return [body for instance in nested for body in plant.GetBodyIndices(instance)]
    model, _, link = name.rpartition("::")
    if not model or not plant.HasModelInstanceNamed(model):
        return []
    instance = plant.GetModelInstanceByName(model)
    if not plant.HasBodyNamed(link, instance):
        return []
    return CarriedBodies(plant, plant.GetBodyByName(link, instance))


def CarriedBodies(plant: MultibodyPlant, body: RigidBody) -> list[BodyIndex]:
    """Returns a body, and the bodies that joints connect to it as children, also indirectly."""
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    pairs = [(joint.parent_body().index(), joint.child_body().index()) for joint in joints]
    found = [body.index()]
    for parent in found:  # The loop visits what it appends.
        found += [b for a, b in pairs if a == parent and b not in (*found, world_index())]
    return found


def BaseBody(plant: MultibodyPlant, name: str) -> RigidBody:
    """Returns the base body of a model of a finalized plant; see `ModelBodies` for `name`.

    It is the model's floating base body or, for other models, its first body that no joint connects
    to another body of the model as a child.
    """
    bodies = ModelBodies(plant, name)
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    inner = {j.child_body().index() for j in joints if j.parent_body().index() in bodies}
    free = [body for body in bodies if plant.get_body(body).is_floating_base_body()]
    return plant.get_body((free or [body for body in bodies if body not in inner])[0])


def RequireModels(plant: MultibodyPlant, models: Mapping[str, str]) -> None:
    """Checks that the plant has the models that a scenario's `poil` section names.

    Args:
        plant: The plant with all models.
        models: Role, e.g. "object" -> the value of `poil.<role>`.

    Raises:
        ScenarioError: There is no such model, or two roles share a body.
    """
    for role, name in models.items():
        if ModelBodies(plant, name) and (role != "robot" or plant.HasModelInstanceNamed(name)):
            continue
        if plant.HasModelInstanceNamed(name):
            raise ScenarioError(
                f"poil.{role} is '{name}', a model without bodies.",
                remedy="Put its shapes into a link or, in MJCF, into a <body> of the world.",
            )
        raise ScenarioError(
            f"poil.{role} is '{name}', but no directive adds a model with that name.",
            remedy=f"Choose one of: {', '.join(BodiesByModel(plant))}; or <model>::<body> for one "
            "body of a model.",
        )
    for (role, name), (other, other_name) in combinations(models.items(), 2):
        if set(ModelBodies(plant, name)) & set(ModelBodies(plant, other_name)):
            raise ScenarioError(
                f"poil.{role} '{name}' and poil.{other} '{other_name}' have bodies in common.",
                remedy="If one file holds both, name a body of it for each, as <model>::<body>.",
            )


def RequireFreeObject(plant: MultibodyPlant, name: str) -> None:
    """Checks that the object `name` of a finalized plant moves freely, as one piece.

    Raises:
        ScenarioError: The object is welded or joined to something, or falls apart.
    """
    bodies = ModelBodies(plant, name)
    free = [body for body in bodies if plant.get_body(body).is_floating_base_body()]
    if not free:
        base = BaseBody(plant, name)
        joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
        [joint] = [j for j in joints if j.child_body().index() == base.index()]
        parent = joint.parent_body().scoped_name().get_full()
        parent = parent.removeprefix("WorldModelInstance::")
        raise ScenarioError(
            f"The object '{name}' is welded or joined to something, so it cannot move freely: its "
            f"base '{base.name()}' to '{parent}', by the joint '{joint.name()}'.",
            remedy="Remove the weld from the directives or the joint from the model's file "
            "(SDFormat: also <static>; MJCF: give the body a <freejoint/>). If the parent belongs "
            "to the object, set poil.object to the parent.",
        )
    if len(free) > 1:
        names = ", ".join(plant.get_body(body).name() for body in free)
        raise ScenarioError(
            f"The object '{name}' falls apart: no joint connects its links {names}.",
            remedy="Connect them by fixed joints in the model's file, or name one of them: "
            f"poil.object: {name}::{plant.get_body(free[0]).name()}.",
        )


def BodiesByModel(
    plant: MultibodyPlant, models: Collection[str] = ()
) -> dict[str, list[BodyIndex]]:
    """Returns the bodies of every model, except the world; each body occurs once.

    Args:
        plant: The plant with all models.
        models: Models that have precedence; see `ModelBodies`. All others are model instances, with
            the models nested in them.
    """
    owners = {body: name for name in models for body in ModelBodies(plant, name)}
    found: dict[str, list[BodyIndex]] = {}
    for instance in _instances(plant):
        parts = plant.GetModelInstanceName(instance).split("::")
        scopes = ["::".join(parts[: k + 1]) for k in range(len(parts))]
        model = next(name for name in scopes if plant.HasModelInstanceNamed(name))
        for body in plant.GetBodyIndices(instance):
            found.setdefault(owners.get(body, model), []).append(body)
    return found


def _instances(plant: MultibodyPlant) -> list[ModelInstanceIndex]:
    """Returns the model instances, except the world and Drake's empty default instance."""
    return [ModelInstanceIndex(i) for i in range(2, plant.num_model_instances())]


def IsPartOf(instance: str, model: str) -> bool:
    """Returns whether a model instance is the model `model` or nested in it."""
    return instance == model or instance.startswith(f"{model}::")


class ModelGeometry(NamedTuple):
    """A geometry of a model.

    Attributes:
        id: The geometry's ID.
        link: Name of the geometry's link, without the model's scope, e.g. "handle", or
            "cup::handle" for the link of a nested model.
        name: Name of the geometry, without the model's scope.
    """

    id: GeometryId
    link: str
    name: str


def ModelGeometries(
    plant: MultibodyPlant,
    inspector: SceneGraphInspector,
    model: str,
    role: Role,
    *,
    bodies: Sequence[BodyIndex] | None = None,
) -> list[ModelGeometry]:
    """Returns the geometries of a model that have a role.

    Args:
        plant: The plant with all models.
        inspector: The inspector of the plant's scene graph.
        model: The model, see `ModelBodies`.
        role: The role.
        bodies: The bodies whose geometries are returned; None stands for all bodies of the model.
    """
    found = []
    for index in ModelBodies(plant, model) if bodies is None else bodies:
        link = LinkName(plant.get_body(index), model)
        for geometry_id in inspector.GetGeometries(plant.GetBodyFrameIdOrThrow(index), role):
            name = inspector.GetName(geometry_id).split("::")[-1]
            found.append(ModelGeometry(geometry_id, link, name))
    return found


def LinkName(body: RigidBody, model: str) -> str:
    """Returns a body's name within a model, e.g. "handle", or "cup::handle" in a nested model."""
    name = body.scoped_name().get_full()
    return (
        name.removeprefix(f"{model}::") if IsPartOf(name, model) and name != model else body.name()
    )


def PartGeometries(geometries: Sequence[ModelGeometry], part: str) -> list[ModelGeometry]:
    """Returns the geometries of a part; empty if there is no such part.

    Args:
        geometries: The geometries of a model.
        part: A link of the model, with or without the scope of a nested model, or, if no link has
            this name, a regular expression that matches the whole name of a geometry.

    Raises:
        re.error: There is no such link, and the regular expression is invalid.
    """
    of_link = [g for g in geometries if part in (g.link, g.link.rpartition("::")[2])]
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


def GeometryChoices(geometries: Sequence[ModelGeometry]) -> str:
    """Returns what may be named as a part, for error messages: links and names of geometries."""
    links = ", ".join(sorted({geometry.link for geometry in geometries}))
    names = ", ".join(sorted({geometry.name for geometry in geometries}))
    return f"the links ({links}), or a regular expression for the geometry names ({names})"
