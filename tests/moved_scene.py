"""The package's scenario, recorded coarsely, and moved as a whole in the world."""

import copy
import dataclasses

from pydrake.common.schema import Transform
from pydrake.math import RigidTransform, RollPitchYaw

from poil_drake.diagrams.scenario.load import LoadScenario
from poil_drake.diagrams.scenario.scenario import Scenario

SMALL = """
cameras:
  left: { width: 320, height: 240 }
  right: { width: 320, height: 240 }
poil:
  rates: { tracker: 1 }
"""
"""Makes demonstrations of a few small frames. Further keys of `poil` can be appended."""

LABELLED = f"{SMALL}  detector: label_image\n"
"""Likewise, with labels in the first frame."""


def moved(scenario: Scenario, *, height: float = 0.0, yaw: float = 0.0) -> Scenario:
    """Returns the scenario with robot, table, rack, mug and cameras moved.

    The demonstration starts where the mug starts.

    Args:
        scenario: The scenario. All of its welds are to the world.
        height: Displacement along the world's z axis [m].
        yaw: Turn about the world's z axis [deg].
    """
    X = RigidTransform(RollPitchYaw(0.0, 0.0, yaw * 3.141592653589793 / 180.0), [0.0, 0.0, height])

    def move(pose: Transform | None) -> Transform:
        own = RigidTransform() if pose is None else pose.GetDeterministicValue()
        return Transform(X @ own)

    directives = copy.deepcopy(scenario.directives)
    for directive in directives:
        if directive.add_weld is not None:
            directive.add_weld.X_PC = move(directive.add_weld.X_PC)
        elif directive.add_model is not None:
            poses = directive.add_model.default_free_body_pose
            directive.add_model.default_free_body_pose = {
                body: move(pose) for body, pose in poses.items()
            }
    cameras = copy.deepcopy(dict(scenario.cameras))
    for camera in cameras.values():
        camera.X_PB = move(camera.X_PB)
    poil = f"{{table_height: {height}, demonstration_motion: {{hanging: {{start: []}}}}}}"
    scene = dataclasses.replace(scenario, directives=directives, cameras=cameras)
    return LoadScenario(data=f"{{poil: {poil}}}", defaults=scene)
