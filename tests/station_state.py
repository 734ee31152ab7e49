"""Reads and sets the poses of a simulated station's object and robot, for tests."""

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context

from poil_drake.diagrams.station.panda_arm import ARM_DRIVER, HAND_DRIVER
from poil_drake.diagrams.station.station import SimulatedStation


def GetObjectPose(station: SimulatedStation, context: Context) -> RigidTransform:
    """Returns X_WO, the pose of the object's base body, from the station's context."""
    plant_context = station.GetSubsystemContext(station.plant(), context)
    return station.object_body().EvalPoseInWorld(plant_context)


def SetObjectPose(station: SimulatedStation, context: Context, X_WO: RigidTransform) -> None:
    """Sets the pose of the object's base body to X_WO, at rest, in the station's context."""
    plant, body = station.plant(), station.object_body()
    plant_context = station.GetMutableSubsystemContext(plant, context)
    plant.SetFreeBodyPose(plant_context, body, X_WO)
    plant.SetVelocities(
        plant_context,
        body.model_instance(),
        np.zeros(plant.num_velocities(body.model_instance())),
    )


def SetRobotPosition(
    station: SimulatedStation, context: Context, q: np.ndarray, *, width: float | None = None
) -> None:
    """Sets the arm's joint positions q (7,) [rad] and the hand's width [m], at rest.

    Resets the drivers as well, so that the robot stays there.
    """
    plant = station.plant()
    robot = plant.GetModelInstanceByName(station.scenario.poil.robot)
    plant_context = station.GetMutableSubsystemContext(plant, context)
    positions = plant.GetPositions(plant_context, robot)
    positions[: len(q)] = q
    if width is not None:
        positions[len(q) :] = width / 2
    plant.SetPositions(plant_context, robot, positions)
    plant.SetVelocities(plant_context, robot, np.zeros(plant.num_velocities(robot)))
    for name in (ARM_DRIVER, HAND_DRIVER):
        driver = station.GetSubsystemByName(name)
        driver.Reset(station.GetMutableSubsystemContext(driver, context))
