"""The directives of a simulated demonstration: the scenario's, without robot and own object."""

import copy
from collections.abc import Sequence

from pydrake.multibody.parsing import (
    AddCollisionFilterGroup,
    FlattenModelDirectives,
    ModelDirective,
    ModelDirectives,
    PackageMap,
)

from poil_drake.diagrams.scenario.drake_errors import DRAKE_ERRORS, drake_reason
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import ScenarioError


def demonstration_directives(scenario: Scenario, packages: PackageMap) -> list[ModelDirective]:
    """Returns the scenario's directives without the robot, and with the demonstration's object.

    What is welded to the robot, directly or through frames and further models, goes with it. Files
    of directives are read in place. Of collision filters, members that are gone are left out.

    Args:
        scenario: The scenario; it stays as it is.
        packages: Where the files of directives are.

    Raises:
        ScenarioError: when a file of directives cannot be read, a weld does not say whose link it
            means, or object or fixture are welded to the robot.
    """
    poil = scenario.poil
    directives = _flat(scenario.directives, packages)
    _require_scoped_names(directives)
    gone, frames = _attached(directives, poil.robot)
    for role, name in (("object", poil.object), ("fixture", poil.fixture)):
        if name in gone:
            raise ScenarioError(
                f"The {role} '{name}' is welded to the robot '{poil.robot}'.",
                remedy="Do not weld it in the directives: the demonstration has no robot.",
            )
    kept = [d for d in directives if not _mentions(d, gone, frames)]
    return _without_members([_with_other_object(d, scenario) for d in kept], {*gone, poil.object})


def models_left_out(scenario: Scenario, packages: PackageMap) -> set[str]:
    """Returns the robot's name, and those of the models that go with it."""
    return _attached(_flat(scenario.directives, packages), scenario.poil.robot)[0]


def _attached(directives: Sequence[ModelDirective], model: str) -> tuple[set[str], set[str]]:
    """Returns a model, the models welded to it as children, at any remove, and added frames."""
    attached, frames = {model}, set[str]()
    while True:
        before = len(attached) + len(frames)
        for directive in directives:
            frame, weld = directive.add_frame, directive.add_weld
            if frame is not None and _belongs(frame.X_PF.base_frame, attached, frames):
                frames.add(frame.name)
            elif weld is not None and _belongs(weld.parent, attached, frames):
                attached.add(weld.child.rsplit("::", 1)[0])
        if len(attached) + len(frames) == before:
            return attached, frames


def _belongs(frame: str | None, models: set[str], frames: set[str]) -> bool:
    name = frame or ""
    return name in frames or any(name.startswith(f"{model}::") for model in models)


def _flat(directives: Sequence[ModelDirective], packages: PackageMap) -> list[ModelDirective]:
    """Returns copies, with what files of directives hold in place of their names."""
    copies = copy.deepcopy(list(directives))
    if all(directive.add_directives is None for directive in copies):
        return copies
    try:
        return list(FlattenModelDirectives(ModelDirectives(directives=copies), packages).directives)
    except DRAKE_ERRORS as error:
        raise ScenarioError(
            f"A file of directives cannot be read: {drake_reason(error)}.",
            remedy="Check the files that add_directives names.",
        ) from error


def _require_scoped_names(directives: Sequence[ModelDirective]) -> None:
    """Checks that welds tell which model their links belong to."""
    free = {"world", *(d.add_frame.name for d in directives if d.add_frame is not None)}
    for directive in directives:
        weld = directive.add_weld
        for name in () if weld is None else (weld.parent, weld.child):
            if "::" not in name and name not in free:
                raise ScenarioError(
                    f"A weld names '{name}' without its model, so that it is not known whether it "
                    "goes with the robot.",
                    remedy=f"Write <model>::{name} in the directives.",
                )


def _mentions(directive: ModelDirective, models: set[str], frames: set[str]) -> bool:
    """Returns whether a directive adds one of the models, or joins something to it."""
    if directive.add_model is not None:
        return directive.add_model.name in models
    joined: list[str | None] = []
    if directive.add_weld is not None:
        joined = [directive.add_weld.parent, directive.add_weld.child]
    elif directive.add_frame is not None:
        joined = [directive.add_frame.name, directive.add_frame.X_PF.base_frame]
    return any(_belongs(frame, models, frames) for frame in joined)


def _with_other_object(directive: ModelDirective, scenario: Scenario) -> ModelDirective:
    model = directive.add_model
    if model is not None and model.name == scenario.poil.object:
        model.file = scenario.poil.demonstration_object
        # The defaults name links and joints of the other object; this one is put elsewhere anyway.
        model.default_free_body_pose = {}
        model.default_joint_positions = {}
    return directive


def _without_members(
    directives: Sequence[ModelDirective], models: set[str]
) -> list[ModelDirective]:
    """Takes the bodies of models out of collision filters, and filters that are left empty."""
    filters = [d.add_collision_filter_group for d in directives if d.add_collision_filter_group]
    for group in filters:
        group.members = [m for m in group.members if not _belongs(m, models, set())]
    empty = set[str]()
    while True:
        found = {g.name for g in filters if not g.members and set(g.member_groups) <= empty}
        if found == empty:
            break
        empty = found
    for group in filters:
        group.member_groups = _without(group.member_groups, empty)
        group.ignored_collision_filter_groups = _without(
            group.ignored_collision_filter_groups, empty
        )
    return [d for d in directives if not _is_in(d.add_collision_filter_group, empty)]


def _without(names: Sequence[str], gone: set[str]) -> list[str]:
    return [name for name in names if name not in gone]


def _is_in(group: AddCollisionFilterGroup | None, names: set[str]) -> bool:
    return group is not None and group.name in names
