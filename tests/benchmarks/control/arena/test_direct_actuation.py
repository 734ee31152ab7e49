import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from poil_drake.benchmarks.control.arena import direct_actuation as dut
from poil_drake.benchmarks.control.arena.arena import AddTaskPlant
from poil_drake.benchmarks.control.arena.tasks import MakeTask
from poil_drake.geometry.rigid_transform import inverse, rotation_exp


class Driven:
    """An object of a task with a hand that follows fixed commands."""

    def __init__(self, task: str, position):
        builder = DiagramBuilder()
        self.plant, _, self.body = AddTaskPlant(builder, MakeTask(task))
        hand = dut.DirectActuation(plant=self.plant, body=self.body, config=dut.ActuationConfig())
        self.hand = builder.AddSystem(hand)
        for name, port in (
            ("body_poses", self.plant.get_body_poses_output_port()),
            ("body_spatial_velocities", self.plant.get_body_spatial_velocities_output_port()),
        ):
            builder.Connect(port, self.hand.GetInputPort(name))
        builder.Connect(
            self.hand.GetOutputPort("applied_spatial_force"),
            self.plant.get_applied_spatial_force_input_port(),
        )
        self.simulator = Simulator(builder.Build())
        root = self.simulator.get_mutable_context()
        self.context = self.plant.GetMyMutableContextFromRoot(root)
        self.hand_context = self.hand.GetMyMutableContextFromRoot(root)
        self.plant.SetFreeBodyPose(self.context, self.body, RigidTransform(np.array(position)))

    def run(self, twist, point, duration):
        self.hand.GetInputPort("twist").FixValue(self.hand_context, np.array(twist, dtype=float))
        self.hand.GetInputPort("point").FixValue(self.hand_context, np.array(point, dtype=float))
        self.simulator.AdvanceTo(self.simulator.get_context().get_time() + duration)

    @property
    def pose(self):
        return self.body.EvalPoseInWorld(self.context)

    @property
    def velocity(self):
        V = self.body.EvalSpatialVelocityInWorld(self.context)
        return np.concatenate([V.rotational(), V.translational()])

    @property
    def hand_pose(self):
        return self.hand.GetOutputPort("hand_pose").Eval(self.hand_context).reshape(4, 4)


def test_wrench_is_gain_times_momentum_error():
    config = dut.ActuationConfig(gain=10.0, max_force=100.0, max_torque=100.0)
    commanded, measured = np.array([1.0, 0, 0, 0, 2.0, 0]), np.array([0.5, 0, 0, 0, 1.0, 0])

    wrench = dut.servo_wrench(commanded, measured, 0.3, np.diag([0.2, 1, 1]), config)

    # 10 / s * 0.2 kg m^2 * 0.5 rad/s, and 10 / s * 0.3 kg * 1 m/s.
    np.testing.assert_allclose(wrench, [1.0, 0, 0, 0, 3.0, 0])


def test_wrench_beyond_its_limits_keeps_its_direction():
    config = dut.ActuationConfig(gain=1000.0, max_force=5.0, max_torque=0.3)

    wrench = dut.servo_wrench(np.array([3.0, 0, 4, 0, 3, 4]), np.zeros(6), 1.0, np.eye(3), config)

    np.testing.assert_allclose(wrench, [0.18, 0.0, 0.24, 0.0, 3.0, 4.0])


def test_object_takes_on_the_commanded_twist_about_the_point():
    driven = Driven("pnp_cube", [0.4, 0.0, 0.3])

    # The cube's centre is 0.1 m from the point: v = omega x arm = (0, 0, 1) x (0.1, 0, 0).
    driven.run([0, 0, 1.0, 0, 0, 0], [0.3, 0.0, 0.3], 0.25)

    x, y, _ = driven.pose.translation() - [0.3, 0.0, 0.3]
    expected = np.array([-y, x, 0.0])
    np.testing.assert_allclose(driven.velocity[:3], [0, 0, 1.0], atol=0.01)
    np.testing.assert_allclose(driven.velocity[3:], [0.0, 0.1, 0.0], atol=0.03)
    assert driven.velocity[3:] @ expected > 0.0


def test_obstacle_stops_the_object():
    driven = Driven("reshelving", [0.72, 0.0, 0.11])
    turned = RigidTransform(RollPitchYaw(0, 0, 0.6), [0.72, 0.0, 0.11])
    driven.plant.SetFreeBodyPose(driven.context, driven.body, turned)

    driven.run([0, 0, 0, 0.25, 0, 0], [0.72, 0.0, 0.11], 3.0)

    # The shelf's back is at x = 0.85 and the book, 3 cm thick, has come to lie flat against it; 5 N
    # press it in by less than half a millimetre.
    assert driven.pose.translation()[0] == pytest.approx(0.85 - 0.015, abs=0.0005)
    np.testing.assert_allclose(driven.velocity[3:], np.zeros(3), atol=0.01)


def test_hand_carries_the_weight_of_a_deforming_object():
    driven = Driven("hanging_bag", [0.4, 0.0, 0.3])

    driven.run(np.zeros(6), [0.4, 0.0, 0.3], 2.0)

    # The strap's centre of mass is not exactly above the hand's force, hence 1 mm.
    np.testing.assert_allclose(driven.pose.translation(), [0.4, 0.0, 0.3], atol=1e-3)


def test_slip_moves_the_object_but_not_the_hand():
    driven = Driven("pnp_cube", [0.4, 0.0, 0.3])
    slip = dut.Slip(0.25, 0.25, np.array([0.03, 0, 0]), np.radians([0, 0, 20.0]))
    driven.hand.SetSlip(driven.hand_context, slip)

    driven.run(np.zeros(6), [0.4, 0.0, 0.3], 0.25)
    before = driven.hand_pose
    driven.run(np.zeros(6), [0.4, 0.0, 0.3], 0.75)

    # Taking on and leaving the slip's 0.12 m/s takes 1/60 s each.
    np.testing.assert_allclose(before[:3, 3], driven.hand_pose[:3, 3], atol=0.001)
    np.testing.assert_allclose(before[:3, :3], driven.hand_pose[:3, :3], atol=0.01)
    X_HO = inverse(driven.hand_pose) @ driven.pose.GetAsMatrix4()
    np.testing.assert_allclose(X_HO[:3, 3], slip.shift, atol=1e-12)
    np.testing.assert_allclose(X_HO[:3, :3], rotation_exp(slip.turn), atol=1e-12)
    assert driven.pose.translation()[0] == pytest.approx(0.43, abs=0.005)


def test_hand_is_where_the_object_is_before_it_slips():
    driven = Driven("pnp_cube", [0.4, 0.0, 0.3])

    driven.run([0, 0, 1.0, 0.1, 0, 0], [0.4, 0.0, 0.3], 0.25)

    np.testing.assert_allclose(driven.hand_pose, driven.pose.GetAsMatrix4(), atol=1e-15)
