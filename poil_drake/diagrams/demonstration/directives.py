"""Which models a simulated demonstration has: the scenario's, without its robot."""

from collections.abc import Sequence

from pydrake.multibody.parsing import ModelDirective, PackageMap

from poil_drake.diagrams.scenario.model_parts import IsPartOf
from poil_drake.diagrams.scenario.models import FlatDirectives
from poil_drake.diagrams.scenario.poil_config import PartRegion, PoilConfig
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import ScenarioError

_OWN_MUGS = "package://poil_drake/mugs/"
_OWN_MUGS_PART = "handle"


def demonstrated_parts(poil: PoilConfig) -> dict[str, str | PartRegion]:
    """Returns part name -> link, expression for geometries, or region, of the demonstrated object.

    What `poil.demonstration_parts` does not list is the link "handle" for the package's mugs, and
    as in `poil.parts` for other objects.
    """
    if poil.demonstration_object.startswith(_OWN_MUGS):
        return {poil.part: _OWN_MUGS_PART, **poil.demonstration_parts}
    return {poil.part: poil.part, **poil.parts, **poil.demonstration_parts}


def demonstration_directives(
    scenario: Scenario, packages: PackageMap
) -> tuple[list[ModelDirective], set[str]]:
    """Returns the scenario's directives without its robot and with the demonstration's object.

    Everything welded to the robot, directly or through frames and other models, is removed with
    it. Each `add_directives` is replaced by its file's contents. Collision filters are removed,
    because a demonstration has no contact.

    Args:
        scenario: The scenario; it is not changed.
        packages: The packages to which `package://` paths of `add_directives` may refer.

    Returns:
        The directives, and the names of the removed models.

    Raises:
        ScenarioError: A file of directives cannot be read, a weld names a link without its model,
            or the object or fixture is welded to the robot.
    """
    poil = scenario.poil
    directives = FlatDirectives(scenario.directives, packages)
    _require_scoped_names(directives)
    removed, frames = _attached(directives, poil.robot)
    for role, name in (("object", poil.object), ("fixture", poil.fixture)):
        if any(IsPartOf(name, model) for model in removed):
            raise ScenarioError(
                f"The {role} '{name}' is welded to the robot '{poil.robot}'.",
                remedy="Remove this weld from the directives: a demonstration has no robot.",
            )
    kept = [d for d in directives if not _mentions(d, removed, frames)]
    for model in (d.add_model for d in kept if d.add_model is not None):
        if model.name == poil.object:
            model.file = poil.demonstration_object
            # The defaults name links and joints of the other object.
            model.default_free_body_pose = {}
            model.default_joint_positions = {}
    return kept, removed


def is_held_by_larger_model(directives: Sequence[ModelDirective], poil: PoilConfig) -> bool:
    """Returns whether the object is one body of a model, and another object is demonstrated."""
    models = [d.add_model for d in directives if d.add_model is not None]
    files = {model.file for model in models if IsPartOf(poil.object, model.name)}
    known = any(model.name == poil.object for model in models)
    return not known and poil.demonstration_object not in files


def _require_scoped_names(directives: Sequence[ModelDirective]) -> None:
    """Checks that each weld names its links as <model>::<link>."""
    free = {"world", *(d.add_frame.name for d in directives if d.add_frame is not None)}
    for weld in (d.add_weld for d in directives if d.add_weld is not None):
        for name in (weld.parent, weld.child):
            if "::" not in name and name not in free:
                raise ScenarioError(
                    f"A weld names '{name}' without its model, so it is unknown whether this "
                    "link belongs to the robot.",
                    remedy=f"Use <model>::{name} in the directives.",
                )


def _attached(directives: Sequence[ModelDirective], model: str) -> tuple[set[str], set[str]]:
    """Returns the names of a model and of all models welded below it, and those of their frames."""
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


def _mentions(directive: ModelDirective, models: set[str], frames: set[str]) -> bool:
    """Returns whether a directive uses one of these models or frames, or filters collisions."""
    model, frame, weld = directive.add_model, directive.add_frame, directive.add_weld
    if model is not None:
        return model.name in models
    if frame is not None:
        return _belongs(frame.name, models, frames)
    if weld is not None:
        return any(_belongs(name, models, frames) for name in (weld.parent, weld.child))
    return directive.add_collision_filter_group is not None


def _belongs(frame: str | None, models: set[str], frames: set[str]) -> bool:
    """Returns whether a frame is in `frames`, or belongs to one of the models."""
    return frame in frames or any((frame or "").startswith(f"{model}::") for model in models)
