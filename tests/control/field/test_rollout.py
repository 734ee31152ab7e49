import numpy as np
import pytest
from point_references import moving_reference, resting_reference

from poil_drake.control.field.point_set_bcsdm import BcsdmConfig
from poil_drake.control.field.rollout import rollout as dut
from poil_drake.control.field.rollout import rollouts
from poil_drake.control.theory.stability import moment_matrix, rotation_velocity
from poil_drake.errors import TrackingError
from poil_drake.geometry.rigid_transform import (
    make_transform,
    rotation_angle,
    rotation_exp,
    transform_points,
)

BODY = 0.03 * np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1.5, 0], [0, -1.5, 0], [0, 0, 2], [0, 0, -2]])
STEP = 1.0 / 32.0


def curved_reference():
    """Half a circle in the xy plane that the body turns with, slowing down to rest."""
    angles = np.pi * np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, 65))
    turns = rotation_exp(angles[:, None] * np.array([0.0, 0, 1]))
    centres = 0.1 * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    return moving_reference(BODY @ np.swapaxes(turns, -1, -2) + centres[:, None], STEP)


CURVED = curved_reference()


def test_offset_from_a_resting_reference_decays_geometrically():
    offset = np.array([0.1, -0.2, 0.05])

    run = dut(BODY + offset, resting_reference(BODY), BcsdmConfig(eta=3.0), STEP, 10.0)

    # Each step removes 3 / 32 of the rest.
    expected = -offset * (1.0 - (1.0 - 3.0 * STEP) ** np.arange(len(run.times))[:, None])
    np.testing.assert_allclose(run.X_W[:, :3, 3], expected, atol=1e-12)
    assert run.converged
    left = np.linalg.norm(offset) * (1.0 - 3.0 * STEP) ** (np.arange(len(run.times)))
    assert left[-1] < 0.003 <= left[-2]


def test_turn_follows_the_closed_form_flow():
    start = rotation_exp(np.array([0.5, 1.0, -0.7]))
    W = moment_matrix(BODY)

    run = dut(BODY @ start.T, resting_reference(BODY), BcsdmConfig(eta=1.0), STEP, 2.0)

    R = start
    for X in run.X_W:
        np.testing.assert_allclose(X[:3, :3] @ start, R, atol=1e-11)
        R = R @ rotation_exp(STEP * rotation_velocity(W, R))


def test_reference_is_followed_to_its_end_from_anywhere_near():
    rng = np.random.default_rng(0)
    for _ in range(5):
        turn = rotation_exp(rng.normal(scale=0.5, size=3))
        start = (CURVED.positions[0] - [0.1, 0, 0]) @ turn.T + [0.1, 0, 0]
        start = start + rng.normal(scale=0.05, size=3)

        run = dut(start, CURVED, BcsdmConfig(), STEP, 20.0)

        assert run.converged
        end = transform_points(run.X_W[-1], start)
        assert np.mean(np.linalg.norm(end - CURVED.positions[-1], axis=1)) < 0.003
        assert run.taus[-1] == pytest.approx(CURVED.times[-1], abs=0.5)


def test_motion_starts_at_the_identity_and_stays_rigid():
    run = dut(CURVED.positions[0] + 0.02, CURVED, BcsdmConfig(), STEP, 20.0)

    np.testing.assert_array_equal(run.X_W[0], np.eye(4))
    R = run.X_W[:, :3, :3]
    np.testing.assert_allclose(
        R @ np.swapaxes(R, -1, -2), np.broadcast_to(np.eye(3), R.shape), atol=1e-12
    )
    assert len(run.times) == len(run.X_W) == len(run.potentials) == len(run.taus)
    np.testing.assert_array_equal(np.diff(run.times), STEP)


def test_speed_limits_hold():
    start = CURVED.positions[0] + [0.0, 0.0, 0.3]

    run = dut(start, CURVED, BcsdmConfig(), STEP, max_angular_speed=0.4, max_linear_speed=0.1)

    assert run.converged
    path = transform_points(run.X_W, start).mean(axis=1)
    speeds = np.linalg.norm(np.diff(path, axis=0), axis=1) / STEP
    turns = run.X_W[1:, :3, :3] @ np.swapaxes(run.X_W[:-1, :3, :3], -1, -2)
    assert np.max(speeds) == pytest.approx(0.1)
    assert np.max(rotation_angle(turns)) / STEP == pytest.approx(0.4)


def test_run_that_runs_out_of_time_has_not_converged():
    run = dut(CURVED.positions[0], CURVED, BcsdmConfig(), STEP, 0.5)

    assert not run.converged
    assert run.times[-1] == 0.5


def test_smaller_steps_lead_to_the_same_pose():
    turn = make_transform(rotation_exp([0.3, 0.0, 0.2]), [0.0, 0.02, 0.01])
    start = transform_points(turn, CURVED.positions[0])

    coarse = dut(start, CURVED, BcsdmConfig(), 1.0 / 32.0, 1.0)
    fine = dut(start, CURVED, BcsdmConfig(), 1.0 / 256.0, 1.0)

    np.testing.assert_allclose(coarse.X_W[-1], fine.X_W[-1], atol=0.01)


def test_collinear_points_are_rejected():
    body = np.linspace(0.0, 1.0, 5)[:, None] * np.array([1.0, 0, 0])

    with pytest.raises(TrackingError, match="do not determine"):
        dut(body, resting_reference(body), BcsdmConfig())


def test_runs_from_many_starts_are_those_from_each():
    rng = np.random.default_rng(1)
    turns = rotation_exp(rng.normal(scale=0.8, size=(6, 3)))
    starts = CURVED.positions[0] @ turns.swapaxes(1, 2) + rng.normal(scale=0.1, size=(6, 1, 3))
    starts[0] = CURVED.positions[-1]
    config = BcsdmConfig(progress_window=(0.3, 0.3))
    limits = {"max_angular_speed": 0.8, "max_linear_speed": 0.15}

    runs = rollouts(starts, CURVED, config, STEP, 8.0, **limits)

    for start, run in zip(starts, runs, strict=True):
        one = dut(start, CURVED, config, STEP, 8.0, **limits)
        assert run.converged == one.converged
        np.testing.assert_array_equal(run.times, one.times)
        np.testing.assert_allclose(run.X_W, one.X_W, atol=1e-9)
        np.testing.assert_allclose(run.taus, one.taus, atol=1e-9)
        np.testing.assert_allclose(run.potentials, one.potentials, atol=1e-9)
    assert len({len(run.times) for run in runs}) > 3
    assert len(runs[0].times) == 1


def test_starts_that_do_not_determine_a_motion_are_named():
    starts = np.stack([CURVED.positions[0]] * 3)
    starts[1] = starts[1, :1]
    with pytest.raises(TrackingError, match=r"\[1\]"):
        rollouts(starts, CURVED, BcsdmConfig())
