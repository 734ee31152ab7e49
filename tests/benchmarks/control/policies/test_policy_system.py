import numpy as np
from pydrake.systems.analysis import Simulator

from poil_drake.benchmarks.control.policies.policy import CommandedTwist, PolicySystem

HAND = [0.5, 0.0, 0.0]


class CountingPolicy:
    """Counts its steps, and moves along x ever faster."""

    period = 0.25

    def start(self):
        return 0

    def step(self, state, observation):
        V = np.array([0, 0, 0, 0.1 * (state + 1), 0, 0])
        return state + 1, CommandedTwist(V, observation.points[0])

    def note(self, state):
        return f"{state} steps"


class BrokenPolicy(CountingPolicy):
    def step(self, state, observation):
        return state, CommandedTwist(np.full(6, np.nan), np.zeros(3))


def run(policy, duration):
    """Returns a system with a policy, and its context after some time."""
    dut = PolicySystem(policy=policy, num_points=2, max_angular_speed=1.0, max_linear_speed=0.25)
    simulator = Simulator(dut)
    context = simulator.get_mutable_context()
    dut.GetInputPort("points").FixValue(context, np.arange(6.0))
    dut.GetInputPort("confidence").FixValue(context, np.ones(2))
    dut.GetInputPort("object_pose").FixValue(context, np.eye(4).ravel())
    hand = np.eye(4)
    hand[:3, 3] = HAND
    dut.GetInputPort("hand_pose").FixValue(context, hand.ravel())
    if duration:
        simulator.AdvanceTo(duration)
    return dut, context


def twist(policy, duration):
    dut, context = run(policy, duration)
    return dut.GetOutputPort("twist").Eval(context)


def test_nothing_is_commanded_before_the_first_step():
    assert not twist(CountingPolicy(), 0.0).any()


def test_policy_takes_one_step_each_period():
    dut, context = run(CountingPolicy(), 0.3)

    # Steps at 0 and at 0.25 s.
    np.testing.assert_allclose(dut.GetOutputPort("twist").Eval(context), [0, 0, 0, 0.2, 0, 0])
    np.testing.assert_array_equal(dut.GetOutputPort("point").Eval(context), HAND)
    assert dut.GetNote(context) == "2 steps"


def test_command_is_scaled_to_the_limits():
    # The fifth step commands 0.5 m/s.
    np.testing.assert_allclose(twist(CountingPolicy(), 1.1), [0, 0, 0, 0.25, 0, 0])


def test_command_that_is_not_finite_counts_as_zero():
    assert not twist(BrokenPolicy(), 0.3).any()


def test_limits_hold_at_the_hand_for_any_commanded_point():
    class Turning(CountingPolicy):
        def step(self, state, observation):
            return state, CommandedTwist(np.array([0, 0, 0.8, 0, 0, 0]), np.zeros(3))

    # Half a metre from the axis the hand would move at 0.4 m/s along y; 0.25 m/s are allowed.
    np.testing.assert_allclose(twist(Turning(), 0.3), [0, 0, 0.5, 0, 0.25, 0])


def test_each_context_has_its_own_state():
    dut, _ = run(CountingPolicy(), 0.6)

    assert dut.GetNote(dut.CreateDefaultContext()) == "0 steps"
