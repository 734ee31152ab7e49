"""Adds a scenario's models to a plant."""

import copy
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.manipulation import ApplyNamedPositionsAsDefaults
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import (
    FlattenModelDirectives,
    GetScopedFrameByName,
    ModelDirective,
    ModelDirectives,
    PackageMap,
    Parser,
    ProcessModelDirectives,
)
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import DiagramBuilder

import poil_drake.models
from poil_drake.diagrams.scenario.drake_errors import DrakeErrorsExplained
from poil_drake.diagrams.scenario.model_parts import IsPartOf, LinkName, ModelBodies
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import ScenarioError
from poil_drake.models.panda_model import PANDA_PACKAGE, panda_package_directory

_REMEDIES = {
    "unknown package": "Add the package's package.xml to poil.packages.",
    "does not exist": "Correct the path. It is package://..., an absolute path, or relative to the "
    "file that holds it.",
    "unsupported extension": "Convert the mesh to .obj, e.g. with trimesh.load(OLD).export(NEW) in "
    "Python, and name the new file in the model's file.",
    "single <model>": "Save the one model that is needed as a file of its own.",
    "instance names must be unique": "Give each add_model a name of its own.",
    "no model instance named": "Correct the name of the model, or move the directive below the one "
    "that adds the model.",
    "already contains a joint": "Weld each link only once.",
    "form one or more loops": "Remove a weld: each link needs only one, to its parent.",
}
"""What a user can do about Drake's errors that contain these words."""

_REMEDY = "Check the files and the model, link and frame names in the directives."


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


def AddPackages(
    parser: Parser, scenario: Scenario, package_xmls: Sequence[str | Path] = ()
) -> None:
    """Adds packages to a parser: poil_drake's models, the Panda, and the user's.

    Args:
        parser: The parser.
        scenario: Names the user's packages.
        package_xmls: Further `package.xml` files, or folders that hold such files.

    Raises:
        MissingDependencyError: The Panda's description is not installed.
        ScenarioError: A file does not exist or is not a `package.xml`, or two have the same name.
    """
    packages = parser.package_map()
    packages.AddPackageXml(str(Path(poil_drake.models.__file__).parent / "package.xml"))
    packages.Add(PANDA_PACKAGE, str(panda_package_directory()))
    for path in map(Path, (*scenario.poil.packages, *package_xmls)):
        with DrakeErrorsExplained(
            f"The package '{path}' cannot be used",
            remedy="In poil.packages, name package.xml files or folders that hold them; each "
            "package once.",
        ):
            if path.is_dir():
                packages.PopulateFromFolder(str(path))
            else:
                packages.AddPackageXml(str(path))


def FlatDirectives(
    directives: Sequence[ModelDirective], packages: PackageMap
) -> list[ModelDirective]:
    """Returns copies of directives, with each `add_directives` replaced by its file's contents.

    Raises:
        ScenarioError: A file of directives cannot be read.
    """
    flat: list[ModelDirective] = []
    for directive in copy.deepcopy(list(directives)):
        if directive.add_directives is None:
            flat.append(directive)
            continue
        with DrakeErrorsExplained(
            "A file of directives cannot be read",
            remedy="Check the files that add_directives names.",
        ):
            file = ModelDirectives(directives=[directive])
            flat += FlattenModelDirectives(file, packages).directives
    return flat


def AddModels(parser: Parser, directives: Sequence[ModelDirective]) -> None:
    """Adds the models, frames and welds of directives to the parser's plant.

    A weld of the directives replaces the weld to the world that a model has from its file.
    `FinishModels` sets the default poses.

    Args:
        parser: The parser of the plant.
        directives: The directives; see `FlatDirectives`.

    Raises:
        ScenarioError: A file, model, link or frame does not exist.
    """
    plant, welded = parser.plant(), set[str]()
    for directive in copy.deepcopy(list(directives)):
        weld, model = directive.add_weld, directive.add_model
        problem = "A directive cannot be processed"
        if model is not None:
            model.default_free_body_pose = {}
            problem = f"The model '{model.name}' cannot be added"
        elif weld is not None:
            problem = f"'{weld.child}' cannot be welded to '{weld.parent}'"
        with DrakeErrorsExplained(problem, remedy=_REMEDY, remedies=_REMEDIES):
            if weld is None:
                ProcessModelDirectives(ModelDirectives(directives=[directive]), parser)
                continue
            parent, child = (GetScopedFrameByName(plant, n) for n in (weld.parent, weld.child))
            if weld.child not in welded:
                _unweld(plant, child.body())
                welded.add(weld.child)
            X_PC = RigidTransform() if weld.X_PC is None else weld.X_PC.GetDeterministicValue()
            plant.WeldFrames(parent, child, X_PC)


def _unweld(plant: MultibodyPlant, body: RigidBody) -> None:
    """Removes the weld between the world and a body, so that another can replace it."""
    for joint in [plant.get_joint(index) for index in plant.GetJointIndices()]:
        pair = (joint.parent_body().index(), joint.child_body().index())
        if joint.type_name() != "weld" or pair != (plant.world_body().index(), body.index()):
            continue
        # Drake removes no joints while there are constraints, e.g. between a hand's fingers.
        if plant.num_constraints() > 0:
            raise ScenarioError(
                f"The file of '{body.scoped_name().get_full()}' welds it to the world already.",
                remedy="Remove its add_weld, and write the pose into the file (MJCF: pos and quat "
                "of the body; SDFormat: <pose>); or move the directives that add and weld the "
                "model above those of the robot.",
            )
        plant.RemoveJoint(joint)


def SetInitialPositions(
    plant: MultibodyPlant, scenario: Scenario, *, without: Collection[str] = ()
) -> None:
    """Sets the scenario's `initial_position` as the plant's default positions.

    Args:
        plant: The plant with all models.
        scenario: The scenario.
        without: Names of models whose positions are not set, with the models nested in them.

    Raises:
        ScenarioError: A model or joint does not exist, or a value does not fit its joint.
    """
    positions = {
        model: {joint: np.atleast_1d(q) for joint, q in joints.items()}
        for model, joints in scenario.initial_position.items()
        if not any(IsPartOf(model, name) for name in without)
    }
    with DrakeErrorsExplained(
        "initial_position cannot be set",
        remedy="Correct the name of the model or joint, or the number of values.",
    ):
        ApplyNamedPositionsAsDefaults(positions, plant)


def FinishModels(plant: MultibodyPlant, directives: Sequence[ModelDirective]) -> None:
    """Finalizes a plant, and sets the default poses of its free bodies from the directives.

    Raises:
        ScenarioError: The welds form a loop; or a default pose is random, or of a body that is not
            the base body of a free model.
    """
    with DrakeErrorsExplained("The models do not fit together", remedy=_REMEDY, remedies=_REMEDIES):
        plant.Finalize()
    for model in (d.add_model for d in directives if d.add_model is not None):
        for name, pose in model.default_free_body_pose.items():
            body = _free_body(plant, model.name, name)
            with DrakeErrorsExplained(
                f"The default_free_body_pose of '{model.name}::{name}' cannot be used",
                remedy="Use a deterministic pose. Leave base_frame out for the world, or name a "
                "frame of a model.",
            ):
                X_PB = pose.GetDeterministicValue()
                parent = GetScopedFrameByName(plant, pose.base_frame or "world")
            X_WP = parent.CalcPoseInWorld(plant.CreateDefaultContext())
            plant.SetDefaultFloatingBaseBodyPose(body, X_WP @ X_PB)


def _free_body(plant: MultibodyPlant, model: str, link: str) -> RigidBody:
    """Returns a link of a model, after checking that it is a floating base body."""
    bodies = [plant.get_body(index) for index in ModelBodies(plant, model)]
    scoped = {LinkName(body, model): body for body in bodies}
    given = f"The directive that adds '{model}' has a default_free_body_pose for '{link}'"
    if link not in scoped:
        raise ScenarioError(
            f"{given}, but the model has no such link.",
            remedy=f"Choose one of: {', '.join(scoped)}.",
        )
    body = scoped[link]
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    parents = {joint.child_body().index(): joint.parent_body() for joint in joints}
    base = body
    while not base.is_floating_base_body() and not plant.IsAnchored(base):
        base = parents[base.index()]
    if base is body and not plant.IsAnchored(body):
        return body
    if plant.IsAnchored(base):
        raise ScenarioError(
            f"{given}, which is welded or joined to the world.",
            remedy="Remove this pose: the X_PC of an add_weld places what is welded. To free it, "
            "remove the weld or joint from the directives or the model's file (also <static>).",
        )
    raise ScenarioError(
        f"{given}, which follows its base link '{base.scoped_name().get_full()}'.",
        remedy=f"Give the pose of the base link '{LinkName(base, model)}' instead.",
    )
