"""The simulated Panda's joint controllers and command interface."""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, PdControllerGains
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Demultiplexer, MatrixGain, Multiplexer

from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station_base import COMMANDS, ExportPorts
from poil_drake.errors import StationError
from poil_drake.robots.joint_limits import JointLimits
from poil_drake.robots.panda import ARM_JOINTS, FINGER_JOINTS, NUM_JOINTS
from poil_drake.systems.panda.hand_driver import HandDriver
from poil_drake.systems.panda.velocity_driver import PandaVelocityDriver

ARM_DRIVER = "panda_velocity_driver"
HAND_DRIVER = "hand_driver"


def SetControllerGains(plant: MultibodyPlant, scenario: Scenario) -> None:
    """Sets the gains of the robot's actuators, and disables gravity on the robot.

    Call this before `plant.Finalize()`: gains cannot be set afterwards.

    Raises:
        StationError: if the model lacks one of the Panda's actuators.
    """
    robot, config = plant.GetModelInstanceByName(scenario.poil.robot), scenario.robot_driver
    gains = {
        name: PdControllerGains(p=p, d=d)
        for name, p, d in zip(ARM_JOINTS, config.stiffness, config.damping, strict=True)
    }
    gains[FINGER_JOINTS[0]] = PdControllerGains(p=config.hand_stiffness, d=config.hand_damping)
    for name, gain in gains.items():
        if not plant.HasJointActuatorNamed(name, robot):
            raise StationError(
                f"The robot '{scenario.poil.robot}' has no actuator '{name}'.",
                remedy="Set poil.robot to a model of package://poil_drake_panda/panda.urdf.",
            )
        plant.GetJointActuatorByName(name, robot).set_controller_gains(gain)
    # The real robot compensates for its own weight.
    plant.set_gravity_enabled(robot, False)


def ArmJointLimits(plant: MultibodyPlant, robot: ModelInstanceIndex) -> JointLimits:
    """Returns the arm's joint limits from the model."""
    joints = [plant.GetJointByName(name, robot) for name in ARM_JOINTS]
    return JointLimits(
        lower=np.array([j.position_lower_limits()[0] for j in joints]),
        upper=np.array([j.position_upper_limits()[0] for j in joints]),
        velocity=np.array([j.velocity_upper_limits()[0] for j in joints]),
        acceleration=np.array([j.acceleration_upper_limits()[0] for j in joints]),
    )


def AddPandaDrivers(*, builder: DiagramBuilder, plant: MultibodyPlant, scenario: Scenario) -> None:
    """Adds and connects the arm's and the hand's drivers, and exports their ports.

    Call this after `plant.Finalize()`. For a robot named `panda`, exports the inputs
    `panda.velocity`, `panda.velocity_time`, `hand.width` and the outputs
    `panda.position_measured`, `panda.velocity_measured`, `panda.torque_external`, `panda.status`,
    `hand.width_measured`.

    Args:
        builder: Receives the drivers; must already hold the plant.
        plant: The finalized plant.
        scenario: Names the Panda, and sets how it follows commands.
    """
    name, config, time_step = scenario.poil.robot, scenario.robot_driver, scenario.poil.rates.plant
    robot = plant.GetModelInstanceByName(name)
    fingers = plant.num_positions(robot) - NUM_JOINTS
    arm = builder.AddNamedSystem(
        ARM_DRIVER,
        PandaVelocityDriver(
            limits=ArmJointLimits(plant, robot), config=config, time_step=time_step
        ),
    )
    hand = builder.AddNamedSystem(
        HAND_DRIVER, HandDriver(speed=config.hand_speed, time_step=time_step)
    )
    state = builder.AddNamedSystem(
        "panda_state", Demultiplexer([NUM_JOINTS, fingers, NUM_JOINTS, fingers])
    )
    width = builder.AddNamedSystem("hand_width", MatrixGain(np.ones((1, fingers))))
    torque = builder.AddNamedSystem("panda_torque", Demultiplexer([NUM_JOINTS, fingers]))
    desired = builder.AddNamedSystem(
        "panda_desired_state", Multiplexer([NUM_JOINTS, 1, NUM_JOINTS, 1])
    )
    builder.Connect(plant.get_state_output_port(robot), state.get_input_port())
    builder.Connect(state.get_output_port(0), arm.GetInputPort("position_measured"))
    builder.Connect(state.get_output_port(1), width.get_input_port())
    builder.Connect(width.get_output_port(), hand.GetInputPort("width_measured"))
    builder.Connect(
        plant.get_generalized_contact_forces_output_port(robot), torque.get_input_port()
    )
    for i, source in enumerate(
        (
            arm.GetOutputPort("position_commanded"),
            hand.GetOutputPort("finger_position"),
            arm.GetOutputPort("velocity_commanded"),
            hand.GetOutputPort("finger_velocity"),
        )
    ):
        builder.Connect(source, desired.get_input_port(i))
    builder.Connect(desired.get_output_port(), plant.get_desired_state_input_port(robot))
    ExportPorts(builder, arm, COMMANDS, name)
    ExportPorts(builder, hand, ["width"], "hand")
    builder.ExportOutput(state.get_output_port(0), f"{name}.position_measured")
    builder.ExportOutput(state.get_output_port(2), f"{name}.velocity_measured")
    builder.ExportOutput(torque.get_output_port(0), f"{name}.torque_external")
    ExportPorts(builder, arm, ["status"], name)
    builder.ExportOutput(width.get_output_port(), "hand.width_measured")
