from itertools import pairwise

import numpy as np
import pytest

from poil_drake.benchmarks.control.policies.policy import Observation
from poil_drake.benchmarks.control.policies.scripted import (
    OpenLoopPolicy,
    ScriptedPolicy,
    pose_difference,
)
from poil_drake.geometry.rigid_transform import (
    make_transform,
    moved_by_twist,
    rotation_exp,
    transform_points,
)

BODY = np.array([[0.03, 0, 0], [-0.03, 0.01, 0], [0, 0.02, 0], [0, 0, 0.02], [0, -0.03, 0.01]])
PERIOD = 1 / 16


SHARE = np.linspace(0.0, 1.0, 33)[:, None]
POSES = make_transform(
    rotation_exp(SHARE * [0.0, 0.4, 0.8]), [0.4, 0.0, 0.1] + SHARE * [0.1, 0.2, 0.1]
)


def observe(time, X_WO, X_WH):
    return Observation(time, transform_points(X_WO, BODY), np.ones(5), X_WO, X_WH)


def follow(policy, X_WO, steps):
    """Moves the object exactly as commanded; returns where it ends."""
    state = policy.start()
    for k in range(steps):
        observation = observe(k * policy.period, X_WO, X_WO)
        state, (V, point) = policy.step(state, observation)
        X_WO = moved_by_twist(X_WO, V, point, policy.period)
    return X_WO


def test_difference_leads_from_one_pose_to_the_other():
    V = pose_difference(POSES[0], POSES[-1])

    np.testing.assert_allclose(V, [0.0, 0.4, 0.8, 0.1, 0.2, 0.1], atol=1e-12)


def test_script_is_followed_and_its_end_kept():
    end = follow(ScriptedPolicy(POSES, period=PERIOD), POSES[0], 60)

    np.testing.assert_allclose(end, POSES[-1], atol=1e-6)


def test_script_corrects_errors():
    elsewhere = POSES[0].copy()
    elsewhere[:3, 3] += [0.02, 0.0, 0.0]

    end = follow(ScriptedPolicy(POSES, period=PERIOD), elsewhere, 60)

    np.testing.assert_allclose(end, POSES[-1], atol=1e-4)


def replay():
    points = transform_points(POSES, BODY[None])
    return OpenLoopPolicy(points, period=PERIOD, max_angular_speed=2.0, max_linear_speed=0.25)


def begun_replay():
    """Returns a policy that replays, and its state after the first step, at the start."""
    dut = replay()
    return dut, dut.step(dut.start(), observe(0.0, POSES[0], POSES[0]))[0]


def test_replay_reaches_the_goal_from_elsewhere_without_disturbance():
    start = make_transform(rotation_exp([0.0, 0.0, 2.5]), np.array([0.2, -0.3, 0.1]))

    end = follow(replay(), start, 200)

    np.testing.assert_allclose(end, POSES[-1], atol=1e-6)


def test_way_to_the_start_keeps_the_speed_limits():
    far = make_transform(rotation_exp([0.0, 0.0, 2.5]), np.array([-0.4, -0.6, 0.1]))
    dut = replay()

    planned, _ = dut.step(dut.start(), observe(0.0, far, far))

    approach = planned.poses[: len(planned.poses) - len(POSES) + 1]
    V = np.array([pose_difference(a, b) for a, b in pairwise(approach)]) / PERIOD
    assert np.linalg.norm(V[:, :3], axis=1).max() < 2.0
    assert 0.15 < np.linalg.norm(V[:, 3:], axis=1).max() < 0.25


def test_replay_ignores_the_object_after_its_first_observation():
    dut, state = begun_replay()
    slipped = POSES[10].copy()
    slipped[:3, 3] += 0.1

    commands = [dut.step(state, observe(1.0, X, POSES[10]))[1] for X in (POSES[10], slipped)]

    np.testing.assert_array_equal(commands[0].V, commands[1].V)
    assert np.linalg.norm(commands[0].V) > 0.05


def test_replay_returns_the_hand_to_its_plan():
    dut, state = begun_replay()
    pushed = state.poses[16].copy()
    pushed[:3, 3] += [0.0, 0.0, 0.05]

    on, off = (dut.step(state, observe(1.0, X, X))[1] for X in (state.poses[16], pushed))

    assert off.V[5] - on.V[5] == pytest.approx(-5.0 * 0.05)


@pytest.mark.parametrize(("time", "resting"), [(1.0, False), (100.0, True)])
def test_replay_is_at_rest_in_the_end(time, resting):
    dut, state = begun_replay()
    k = min(round(time / PERIOD), len(state.poses) - 1)

    _, command = dut.step(state, observe(time, state.poses[k], state.poses[k]))

    assert (np.linalg.norm(command.V) < 1e-9) == resting


def test_replay_waits_until_all_points_are_observed():
    dut = replay()
    hidden = Observation(0.0, np.full((5, 3), np.nan), np.zeros(5), POSES[0], POSES[0])

    waiting, command = dut.step(dut.start(), hidden)
    begun, _ = dut.step(waiting, observe(0.125, POSES[0], POSES[0]))

    assert waiting is None
    assert not command.V.any()
    assert begun.begin == 0.125
