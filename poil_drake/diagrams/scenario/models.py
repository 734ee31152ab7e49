"""Adds a scenario's models to a plant."""

import copy
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np
from pydrake.common.schema import Transform
from pydrake.geometry import SceneGraph
from pydrake.manipulation import ApplyNamedPositionsAsDefaults
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import (
    AddModel,
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
from poil_drake.diagrams.scenario.meshes import CONVERT_MESH
from poil_drake.diagrams.scenario.model_parts import IsPartOf, LinkName, ModelBodies
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import ScenarioError
from poil_drake.models.panda_model import PANDA_PACKAGE, panda_package_directory

_REMEDIES = {
    "unknown package": "Add the package's package.xml to poil.packages.",
    "does not exist": "Correct the path: package://..., absolute, or relative to the file that "
    "holds it.",
    "XML_ERROR": "Correct the XML of this file.",
    "not a recognized type": "Use a URDF, SDFormat or MJCF file; expand a .xacro with the program "
    "xacro.",
    "unsupported extension": CONVERT_MESH,
    "supports mesh files in .obj": CONVERT_MESH,
    "instance names must be unique": "Give each add_model a name that no other has.",
    "no model instance named": "Correct the name of the model, or move this directive below the "
    "one that adds the model.",
    "no Joint named": "Correct the name of the joint.",
    "world_welds_to": "Weld each link only once. A model whose file welds it to the world (MJCF: a "
    "body without a joint; SDFormat: <static>) needs no add_weld: write its pose into the file.",
    "'found' failed": "The child of a weld is a link: exchange its parent and child.",
    "one or more loops": "Remove a weld: a link needs only the one to its parent.",
}
"""Words in Drake's errors -> what the user can do about them."""

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
            "A file of add_directives cannot be read",
            remedy="Check the files that add_directives names.",
            remedies=_REMEDIES,
        ):
            file = ModelDirectives(directives=[directive])
            flat += FlattenModelDirectives(file, packages).directives
    return flat


def AddModels(parser: Parser, directives: Sequence[ModelDirective]) -> None:
    """Adds the models, frames and welds of directives to the parser's plant.

    `FinishModels` sets the default poses of free bodies.

    Args:
        parser: The parser of the plant.
        directives: The directives; see `FlatDirectives`.

    Raises:
        ScenarioError: A file, model, link or frame does not exist; or a pose is random or infinite.
    """
    for directive in directives:
        frame, weld = directive.add_frame, directive.add_weld
        if frame is not None:
            _value(frame.X_PF, f"The X_PF of the frame '{frame.name}'")
        if weld is not None and weld.X_PC is not None:
            _value(weld.X_PC, f"The X_PC of the weld of '{weld.child}'")
    unposed = copy.deepcopy(list(directives))
    for model in _models(unposed):
        model.default_free_body_pose = {}
    with DrakeErrorsExplained(
        "The directives cannot be processed", remedy=_REMEDY, remedies=_REMEDIES
    ):
        ProcessModelDirectives(ModelDirectives(directives=unposed), parser)


def _models(directives: Sequence[ModelDirective]) -> list[AddModel]:
    return [d.add_model for d in directives if d.add_model is not None]


def _value(pose: Transform, name: str) -> RigidTransform:
    """Returns the value of a pose, after checking that it is finite and not random."""
    remedy = "Use finite numbers, and no random distribution."
    with DrakeErrorsExplained(f"{name} cannot be used", remedy=remedy):
        value = pose.GetDeterministicValue()
    if not np.isfinite(value.GetAsMatrix4()).all():
        raise ScenarioError(f"{name} is not finite.", remedy=remedy)
    return value


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
    for model in _models(directives):
        for link, pose in model.default_free_body_pose.items():
            body, name = _free_body(plant, model.name, link), f"{model.name}::{link}"
            X_PB = _value(pose, f"The default_free_body_pose of '{name}'")
            with DrakeErrorsExplained(
                f"The base_frame of the default_free_body_pose of '{name}' cannot be used",
                remedy="Leave it out for the world, or name a frame of a model.",
            ):
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
        problem = "is welded or joined to the world"
        remedy = (
            "Remove this pose: the X_PC of an add_weld places what is welded. To free it, remove "
            "the weld or joint from the directives or the model's file (also <static>)."
        )
    else:
        problem = f"follows its base link '{base.scoped_name().get_full()}'"
        remedy = f"Give the pose of the base link '{LinkName(base, model)}' instead."
    raise ScenarioError(f"{given}, which {problem}.", remedy=remedy)
