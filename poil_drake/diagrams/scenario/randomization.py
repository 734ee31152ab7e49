"""Draws randomized trials of a scenario."""

import copy
import dataclasses

import numpy as np
from pydrake.common.schema import Rotation, Transform
from pydrake.math import RollPitchYaw
from pydrake.multibody.parsing import AddModel, ModelDirective

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
        model.file = ranges.models[int(choice * len(ranges.models))]
    if ranges.x or ranges.y or ranges.yaw:
        _move(ObjectDirective(directives, scenario.poil.object), ranges, (x, y, yaw))
    return dataclasses.replace(
        scenario, directives=directives, random_seed=int(rng.integers(2**31))
    )


def _move(model: AddModel, ranges: Randomization, draws: tuple[float, float, float]) -> None:
    """Sets a model's default pose: `draws`, in [0, 1), are scaled to the ranges of x, y and yaw."""
    body, transform = _default_pose(model)
    translation = np.array(transform.translation, dtype=float)
    for axis, interval in enumerate((ranges.x, ranges.y)):
        if interval:
            translation[axis] = interval[0] + draws[axis] * (interval[1] - interval[0])
    rotation = transform.rotation
    if ranges.yaw:
        degrees = ranges.yaw[0] + draws[2] * (ranges.yaw[1] - ranges.yaw[0])
        rotation = Rotation(RollPitchYaw(0.0, 0.0, np.deg2rad(degrees)))
    model.default_free_body_pose = {
        body: Transform(base_frame=transform.base_frame, translation=translation, rotation=rotation)
    }


def ObjectDirective(directives: list[ModelDirective], name: str) -> AddModel:
    """Returns the directive that adds the model `name`. A change to it changes `directives`.

    Raises:
        ScenarioError: No directive adds the model.
    """
    models = [d.add_model for d in directives if d.add_model is not None]
    for model in models:
        if model.name == name:
            return model
    raise ScenarioError(
        f"No directive adds a model named '{name}'.",
        remedy=f"Set poil.object to one of: {', '.join(m.name for m in models)}.",
    )


def _default_pose(model: AddModel) -> tuple[str, Transform]:
    """Returns the name of the only body with a default pose, and this pose, which is fixed."""
    poses = list(model.default_free_body_pose.items())
    if len(poses) != 1 or not isinstance(poses[0][1].translation, np.ndarray):
        kind = "a random default pose" if len(poses) == 1 else f"{len(poses)} default poses"
        raise ScenarioError(
            f"The directive that adds '{model.name}' has {kind}, but randomization needs one fixed "
            "pose.",
            remedy="In this directive, define one default_free_body_pose, for the base link, with "
            "a deterministic translation; or remove the ranges of poil.randomization.",
        )
    return poses[0]
