from itertools import pairwise

import numpy as np
import pytest

from poil_drake.benchmarks.control.policies.policy import Observation
from poil_drake.benchmarks.control.policies.scripted import (
    OpenLoopPolicy,
    ScriptedPolicy,
    pose_difference,
)
from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, transform_points

BODY = np.array([[0.03, 0, 0], [-0.03, 0.01, 0], [0, 0.02, 0], [0, 0, 0.02], [0, -0.03, 0.01]])
PERIOD = 1 / 16


def path():
    share = np.linspace(0.0, 1.0, 33)[:, None]
    R = rotation_exp(share * np.array([0.0, 0.4, 0.8]))
    p = np.array([0.4, 0.0, 0.1]) + share * np.array([0.1, 0.2, 0.1])
    return make_transform(R, p)


def follow(policy, X_WO, steps):
    """Moves the object exactly as commanded; returns where it ends."""
    state = policy.start()
    for k in range(steps):
        observation = Observation(
            k * policy.period, transform_points(X_WO, BODY), np.ones(len(BODY)), X_WO, X_WO
        )
        state, (V, point) = policy.step(state, observation)
        turn = rotation_exp(V[:3] * policy.period)
        moved = turn @ (X_WO[:3, 3] - point) + point + V[3:] * policy.period
        X_WO = make_transform(turn @ X_WO[:3, :3], moved)
    return X_WO


def test_difference_leads_from_one_pose_to_the_other():
    first, second = path()[0], path()[-1]

    V = pose_difference(first, second)

    np.testing.assert_allclose(V, [0.0, 0.4, 0.8, 0.1, 0.2, 0.1], atol=1e-12)


def test_script_is_followed_and_its_end_kept():
    poses = path()

    end = follow(ScriptedPolicy(poses, period=PERIOD), poses[0], 60)

    np.testing.assert_allclose(end, poses[-1], atol=1e-6)


def test_script_corrects_errors():
    poses = path()
    elsewhere = poses[0].copy()
    elsewhere[:3, 3] += [0.02, 0.0, 0.0]

    end = follow(ScriptedPolicy(poses, period=PERIOD), elsewhere, 60)

    np.testing.assert_allclose(end, poses[-1], atol=1e-4)


def replay(poses):
    return OpenLoopPolicy(
        transform_points(poses, BODY[None]),
        period=PERIOD,
        max_angular_speed=2.0,
        max_linear_speed=0.25,
    )


def observe(time, X_WO, X_WH):
    return Observation(time, transform_points(X_WO, BODY), np.ones(5), X_WO, X_WH)


def test_replay_reaches_the_goal_from_elsewhere_without_disturbance():
    poses = path()
    start = make_transform(rotation_exp([0.0, 0.0, 2.5]), np.array([0.2, -0.3, 0.1]))

    end = follow(replay(poses), start, 200)

    np.testing.assert_allclose(end, poses[-1], atol=1e-6)


def test_way_to_the_start_keeps_the_speed_limits():
    poses = path()
    far = make_transform(rotation_exp([0.0, 0.0, 2.5]), np.array([-0.4, -0.6, 0.1]))
    dut = replay(poses)

    planned, _ = dut.step(dut.start(), observe(0.0, far, far))

    approach = planned.poses[: len(planned.poses) - len(poses) + 1]
    V = np.array([pose_difference(a, b) for a, b in pairwise(approach)]) / PERIOD
    assert np.linalg.norm(V[:, :3], axis=1).max() < 2.0
    assert 0.15 < np.linalg.norm(V[:, 3:], axis=1).max() < 0.25


def test_replay_ignores_the_object_after_its_first_observation():
    poses = path()
    dut = replay(poses)
    state, _ = dut.step(dut.start(), observe(0.0, poses[0], poses[0]))
    slipped = poses[10].copy()
    slipped[:3, 3] += 0.1

    commands = [dut.step(state, observe(1.0, X, poses[10]))[1] for X in (poses[10], slipped)]

    np.testing.assert_array_equal(commands[0].V, commands[1].V)
    assert np.linalg.norm(commands[0].V) > 0.05


def test_replay_returns_the_hand_to_its_plan():
    poses = path()
    dut = replay(poses)
    state, _ = dut.step(dut.start(), observe(0.0, poses[0], poses[0]))
    pushed = state.poses[16].copy()
    pushed[:3, 3] += [0.0, 0.0, 0.05]

    on, off = (dut.step(state, observe(1.0, X, X))[1] for X in (state.poses[16], pushed))

    assert off.V[5] - on.V[5] == pytest.approx(-5.0 * 0.05)


@pytest.mark.parametrize(("time", "resting"), [(1.0, False), (100.0, True)])
def test_replay_is_at_rest_in_the_end(time, resting):
    poses = path()
    dut = replay(poses)
    state, _ = dut.step(dut.start(), observe(0.0, poses[0], poses[0]))
    k = min(round(time / PERIOD), len(state.poses) - 1)

    _, command = dut.step(state, observe(time, state.poses[k], state.poses[k]))

    assert (np.linalg.norm(command.V) < 1e-9) == resting


def test_replay_waits_until_all_points_are_observed():
    poses = path()
    dut = replay(poses)
    hidden = Observation(0.0, np.full((5, 3), np.nan), np.zeros(5), poses[0], poses[0])

    waiting, command = dut.step(dut.start(), hidden)
    begun, _ = dut.step(waiting, observe(0.125, poses[0], poses[0]))

    assert waiting is None
    assert not command.V.any()
    assert begun.begin == 0.125
