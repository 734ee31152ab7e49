import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.multibody.inverse_kinematics import (
    DifferentialInverseKinematicsParameters,
    DoDifferentialInverseKinematics,
)
from scipy.optimize import linprog

from poil_drake.robots.differential_ik import (
    DifferentialInverseKinematicsConfig,
    achieved_fraction,
    approach_velocity,
    direction_preserving_velocity,
    resolve_twist,
)
from poil_drake.robots.joint_limits import JointLimits

DT = 1 / 256
LIMITS = JointLimits(
    lower=np.full(7, -2.0),
    upper=np.full(7, 2.0),
    velocity=np.ones(7),
    acceleration=np.full(7, 8.0),
)
CONFIG = DifferentialInverseKinematicsConfig(nominal_posture=(0.0,) * 7)

seeds = st.integers(0, 2**32 - 1)


def random_problem(seed: int, *, joints: int = 7) -> tuple[np.ndarray, ...]:
    """Returns V, J, pull, lowest, highest; some bounds are close to zero, some are zero."""
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(6, joints))
    V = rng.normal(size=6) * 10.0 ** rng.uniform(-3, 1)
    highest = 10.0 ** rng.uniform(-3, 0.3, joints) * (rng.random(joints) > 0.05)
    lowest = -(10.0 ** rng.uniform(-3, 0.3, joints)) * (rng.random(joints) > 0.05)
    return V, J, rng.normal(size=joints), lowest, highest


@given(seeds, st.sampled_from([6, 7]))
@settings(max_examples=100)
def test_as_much_of_the_twist_as_a_linear_program_finds(seed: int, joints: int) -> None:
    V, J, pull, lowest, highest = random_problem(seed, joints=joints)

    velocity, fraction = direction_preserving_velocity(V, J, pull, lowest, highest, 10.0)

    best = linprog(
        np.r_[np.zeros(joints), -1.0],
        A_eq=np.c_[J, -V],
        b_eq=np.zeros(6),
        bounds=[*zip(lowest, highest, strict=True), (0.0, 1.0)],
    )
    # The solver's own feasibility tolerance is 1e-7.
    assert fraction == pytest.approx(-best.fun, abs=1e-5)
    np.testing.assert_allclose(J @ velocity, fraction * V, atol=1e-9 * (1 + np.linalg.norm(V)))
    assert np.all(velocity >= lowest)
    assert np.all(velocity <= highest)


def test_the_answer_is_drakes_where_drake_has_one() -> None:
    compared = 0
    for seed in range(50):
        rng = np.random.default_rng(seed)
        J, V = rng.normal(size=(6, 7)), rng.normal(size=6)
        V /= np.linalg.norm(V)
        # So near the nominal posture that the pull is not capped, which Drake does not do.
        positions = 0.01 * rng.normal(size=7)
        parameters = DifferentialInverseKinematicsParameters(7, 7)
        parameters.set_time_step(DT)
        parameters.set_joint_velocity_limits((np.full(7, -50.0), np.full(7, 50.0)))
        parameters.set_nominal_joint_position(np.zeros(7))
        parameters.set_joint_centering_gain(np.eye(7))
        drakes = DoDifferentialInverseKinematics(positions, np.zeros(7), V, J, parameters)
        if drakes.joint_velocities is None:  # OSQP gives up now and then.
            continue

        velocity, fraction = direction_preserving_velocity(
            V, J, -positions, np.full(7, -50.0), np.full(7, 50.0), 1.0
        )

        assert fraction == 1.0
        np.testing.assert_allclose(velocity, drakes.joint_velocities, atol=1e-4)
        compared += 1
    assert compared > 40


@pytest.mark.parametrize("expected", [0.0, 1.0])
def test_a_singular_arm_produces_the_twists_that_it_can(expected: float) -> None:
    J = np.random.default_rng(0).normal(size=(6, 7))
    J[2] = 0.0  # No rotation about z.
    V = 0.1 * J @ np.array([1.0, -1.0, 0.5, 0.0, 0.2, -0.3, 0.4])
    V[2] = 0.1 * (1.0 - expected)
    bounds = np.ones(7)

    velocity, fraction = direction_preserving_velocity(V, J, np.zeros(7), -bounds, bounds, 1.0)

    assert fraction == expected
    np.testing.assert_allclose(J @ velocity, expected * V, atol=1e-12)


def test_no_twist_no_motion_even_away_from_the_nominal_posture() -> None:
    J = np.random.default_rng(1).normal(size=(6, 7))

    answer = resolve_twist(np.zeros(6), J, np.full(7, 0.5), np.zeros(7), LIMITS, CONFIG, DT)

    np.testing.assert_array_equal(answer.velocity, np.zeros(7))
    assert answer.scale == 1.0


def test_the_direction_is_kept_from_rest_under_saturation() -> None:
    J = np.random.default_rng(2).normal(size=(6, 7))
    V = np.array([5.0, -3.0, 1.0, 4.0, 2.0, -6.0])
    config = DifferentialInverseKinematicsConfig(nominal_posture=(0.0,) * 7, centering_gain=0.0)

    answer = resolve_twist(V, J, np.full(7, 1.8), np.zeros(7), LIMITS, config, DT)

    achieved = J @ answer.velocity
    assert 0.0 < answer.scale < 1.0
    np.testing.assert_allclose(achieved, answer.scale * V, atol=1e-12)


def test_joints_keep_their_margin_under_a_steady_twist() -> None:
    J = np.eye(6, 7)
    V = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    positions, velocity = np.zeros(7), np.zeros(7)
    scales = []
    for _ in range(2000):
        answer = resolve_twist(V, J, positions, velocity, LIMITS, CONFIG, DT)
        change = np.abs(answer.velocity - velocity)
        assert np.all(change <= CONFIG.acceleration_scale * LIMITS.acceleration * DT + 1e-12)
        velocity = answer.velocity
        positions = positions + DT * velocity
        scales.append(answer.scale)

    assert positions[0] == pytest.approx(LIMITS.upper[0] - CONFIG.position_margin, abs=1e-3)
    assert np.all(positions < LIMITS.upper - CONFIG.position_margin + 1e-9)
    assert answer.reachable_scale < 1e-3
    assert max(scales) == pytest.approx(CONFIG.velocity_scale)


@pytest.mark.parametrize(
    ("wanted", "expected"),
    [
        # Joint 1 may change by 0.5 of the 1.0 wanted, so joint 2 also goes half of its way.
        ([1.1, 0.4], [0.6, 0.2]),
        ([0.3, -0.1], [0.3, -0.1]),
    ],
)
def test_approach_is_limited_by_the_slowest_joint(wanted: list, expected: list) -> None:
    accelerations = np.array([10.0, 10.0])

    velocity = approach_velocity(np.array([0.1, 0.0]), np.array(wanted), accelerations, 0.05)

    np.testing.assert_allclose(velocity, expected)


@pytest.mark.parametrize(
    ("achieved", "fraction"),
    [(1.0, 1.0), (0.25, 0.25), (-0.5, 0.0), (2.0, 1.0)],
)
def test_achieved_fraction_is_a_projection(achieved: float, fraction: float) -> None:
    wanted = np.array([0.0, 1.0, 0.0, 0.3, 0.0, 0.0])
    # A part across the wanted twist, with the length of 0.1 m taken into account, counts nothing.
    across = np.array([0.0, 3.0, 0.0, -0.1, 0.0, 0.0])

    assert achieved_fraction(wanted, achieved * wanted + across) == pytest.approx(fraction)
