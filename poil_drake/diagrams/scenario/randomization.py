"""Draws randomized trials of a scenario."""

import copy
import dataclasses

import numpy as np
from pydrake.common.schema import Rotation, Transform
from pydrake.math import RollPitchYaw
from pydrake.multibody.parsing import AddModel, ModelDirective

from poil_drake.diagrams.scenario.model_parts import IsPartOf
from poil_drake.diagrams.scenario.poil_config import Randomization
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import ScenarioError


def ApplyRandomization(scenario: Scenario, seed: int) -> Scenario:
    """Returns a scenario with a random object, object pose and seed of the noise.

    `scenario.poil.randomization` gives the models and ranges. If there is a range, the object's
    default pose gives the height and all values without a range. A range of yaw sets roll and
    pitch to 0. Without models and ranges, only the noise's seed is drawn.

    Args:
        scenario: The scenario; it is not changed.
        seed: The seed, not negative; the same seed draws the same trial.

    Raises:
        ScenarioError: A model or pose is drawn, but no directive adds the object. Or a pose is
            drawn, but the object does not have exactly one default pose, or that pose is random.
    """
    rng = np.random.default_rng(seed)
    ranges = scenario.poil.randomization
    directives = copy.deepcopy(list(scenario.directives))
    # All values are drawn in any case, so that a changed range does not change the other draws.
    choice, x, y, yaw = rng.uniform(size=4)
    if ranges.models:
        model = ObjectDirective(directives, scenario.poil.object)
        if model.name != scenario.poil.object:
            raise ScenarioError(
                f"poil.randomization.models cannot replace '{scenario.poil.object}', which is part "
                f"of the model '{model.name}'.",
                remedy="Add the object in a separate directive, or remove the models.",
            )
        model.file = ranges.models[int(choice * len(ranges.models))]
    if ranges.x or ranges.y or ranges.yaw:
        _move(directives, scenario.poil.object, ranges, (x, y, yaw))
    return dataclasses.replace(
        scenario, directives=directives, random_seed=int(rng.integers(2**31))
    )


def _move(
    directives: list[ModelDirective],
    name: str,
    ranges: Randomization,
    draws: tuple[float, float, float],
) -> None:
    """Sets an object's default pose: `draws`, in [0, 1), are scaled to ranges of x, y and yaw."""
    model = ObjectDirective(directives, name)
    body, transform = _default_pose(model, name)
    translation = np.array(transform.translation, dtype=float)
    for axis, interval in enumerate((ranges.x, ranges.y)):
        if interval:
            translation[axis] = interval[0] + draws[axis] * (interval[1] - interval[0])
    rotation = transform.rotation
    if ranges.yaw:
        degrees = ranges.yaw[0] + draws[2] * (ranges.yaw[1] - ranges.yaw[0])
        rotation = Rotation(RollPitchYaw(0.0, 0.0, np.deg2rad(degrees)))
    moved = Transform(base_frame=transform.base_frame, translation=translation, rotation=rotation)
    model.default_free_body_pose = {**model.default_free_body_pose, body: moved}


def ObjectDirective(directives: list[ModelDirective], name: str) -> AddModel:
    """Returns the directive that adds an object. A change to it changes `directives`.

    Args:
        directives: The directives.
        name: The object: a model, or a body of a model.

    Raises:
        ScenarioError: No directive adds the model.
    """
    models = [d.add_model for d in directives if d.add_model is not None]
    for model in models:
        if IsPartOf(name, model.name):
            return model
    raise ScenarioError(
        f"No directive adds a model named '{name}'.",
        remedy=f"Set poil.object to one of: {', '.join(m.name for m in models)}.",
    )


def _default_pose(model: AddModel, name: str) -> tuple[str, Transform]:
    """Returns the name of the object's only body with a default pose, and this pose, fixed."""
    poses = dict(model.default_free_body_pose)
    link = name.removeprefix(f"{model.name}::")
    if link in poses:
        poses = {link: poses[link]}
    if len(poses) != 1 or not isinstance(next(iter(poses.values())).translation, np.ndarray):
        kind = "a random default pose" if len(poses) == 1 else f"{len(poses)} default poses"
        raise ScenarioError(
            f"The directive that adds '{model.name}' has {kind}, but randomization needs one fixed "
            "pose.",
            remedy="In this directive, define one default_free_body_pose, for the base link, with "
            "a deterministic translation; or remove the ranges of poil.randomization.",
        )
    return next(iter(poses.items()))
