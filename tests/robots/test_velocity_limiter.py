import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from poil_drake.errors import InvalidValueError
from poil_drake.robots import velocity_limiter as dut
from poil_drake.robots.panda_kinematics import PandaModel

PERIOD = 1 / 256
LIMITS = PandaModel().joint_limits
JERK = np.array(dut.VelocityLimiterConfig().jerk)
MIDDLE = 0.5 * (LIMITS.lower + LIMITS.upper)
OUTSIDE = np.where(np.arange(7) == 3, LIMITS.upper - 0.01, MIDDLE)
"""Joint 4 is beyond its margin, inside its limit."""
MOVING = dut.JointMotion(MIDDLE, np.full(7, 0.5), np.zeros(7))


def make_limiter(**changes):
    config = dut.VelocityLimiterConfig(**changes)
    return dut.VelocityLimiter(limits=LIMITS, period=PERIOD, config=config)


def drive(limiter, start, wanted):
    """Returns positions (K + 1, 7) and velocities (K + 1, 7) along K wanted velocities."""
    motion = dut.JointMotion.at_rest(np.asarray(start, dtype=float))
    motions = [motion]
    for velocity in wanted:
        motion = limiter.step(motion, velocity)
        motions.append(motion)
    return np.array([m.position for m in motions]), np.array([m.velocity for m in motions])


@given(st.integers(0, 2**32 - 1))
@settings(derandomize=True, max_examples=40)
def test_no_limit_is_exceeded_by_any_wanted_velocity(seed):
    rng = np.random.default_rng(seed)
    start = rng.uniform(LIMITS.lower + 0.06, LIMITS.upper - 0.06)
    sizes = rng.choice([0.0, 0.1, 1.0, 10.0], size=(12, 1))
    wanted = np.repeat(sizes * rng.normal(size=(12, 7)), rng.integers(1, 80, 12), axis=0)
    scales = {"velocity_scale": 0.7, "acceleration_scale": 0.4, "jerk_scale": 0.2}

    q, v = drive(make_limiter(**scales), start, wanted)

    a = np.diff(v, axis=0, prepend=0.0 * v[:1]) / PERIOD
    jerks = np.diff(a, axis=0, prepend=0.0 * v[:1]) / PERIOD
    assert np.all(np.abs(v) <= 0.7 * LIMITS.velocity + 1e-9)
    assert np.all(np.abs(a) <= 0.4 * LIMITS.acceleration + 1e-6)
    assert np.all(np.abs(jerks) <= 0.2 * JERK + 1e-3)
    assert np.all(q >= LIMITS.lower)
    assert np.all(q <= LIMITS.upper)


def test_wanted_velocity_is_reached_and_kept():
    wanted = np.array([0.3, -0.2, 0.1, 0.2, -0.4, 0.5, -0.6])

    q, v = drive(make_limiter(), MIDDLE, np.tile(wanted, (256, 1)))

    np.testing.assert_allclose(v[128:], np.tile(wanted, (len(v) - 128, 1)), atol=1e-9)
    np.testing.assert_allclose(np.diff(q[128:], axis=0), PERIOD * v[129:], atol=1e-9)


def test_direction_is_kept_from_rest_and_beyond_the_speed_limits():
    wanted = np.array([30.0, -2.0, 1.0, 2.0, -4.0, 5.0, -6.0])

    _, v = drive(make_limiter(velocity_scale=0.5), MIDDLE, np.tile(wanted, (100, 1)))

    np.testing.assert_allclose(v[1:] / v[1:, :1], np.tile(wanted / 30.0, (100, 1)), atol=0.01)
    assert v[-1, 0] == pytest.approx(0.5 * 2.175)


def test_arm_stops_before_its_limits_and_returns():
    towards = np.tile([0.0, 1.5, 0, 0, 0, 0, 0], (600, 1))

    q, v = drive(make_limiter(), MIDDLE, np.concatenate([towards, -towards[:100]]))

    margin = dut.VelocityLimiterConfig().position_margin
    assert LIMITS.upper[1] - q[600, 1] == pytest.approx(margin, abs=0.01)
    assert np.abs(v[600]).max() < 1e-6
    assert q[-1, 1] < q[600, 1] - 0.1


def test_arm_outside_of_its_limits_may_only_return():
    out, _ = drive(make_limiter(), OUTSIDE, np.tile([0, 0, 0, 0.5, 0, 0, 0], (100, 1)))
    back, _ = drive(make_limiter(), OUTSIDE, np.tile([0, 0, 0, -0.5, 0, 0, 0], (100, 1)))

    np.testing.assert_allclose(out[:, 3], OUTSIDE[3], atol=1e-9)
    assert back[-1, 3] < OUTSIDE[3] - 0.1


def test_velocity_that_is_not_finite_means_rest():
    limiter, moving = make_limiter(), MOVING
    wanted = np.full(7, 0.5)
    wanted[2] = np.nan

    braked = limiter.step(moving, wanted)

    np.testing.assert_array_equal(braked.velocity, limiter.step(moving, np.zeros(7)).velocity)
    assert np.all(braked.velocity < 0.5)


def test_step_depends_on_nothing_but_its_arguments():
    limiter, other = make_limiter(), make_limiter()
    motion = dut.JointMotion.at_rest(MIDDLE)
    for wanted in (np.zeros(7), np.full(7, 9.0), np.full(7, -9.0)):
        limiter.step(motion, wanted)

    after, expected = (one.step(motion, np.full(7, 0.1)) for one in (limiter, other))

    for one, another in zip(after, expected, strict=True):
        np.testing.assert_array_equal(one, another)


@pytest.mark.parametrize("share", [1.0, 0.25])
def test_the_share_is_what_the_speed_limits_leave(share):
    # The limit of joint 1 is 2.175 rad/s.
    wanted = 2.175 / share * np.eye(7)[0]
    rest = dut.JointMotion.at_rest(MIDDLE)

    step = make_limiter().guarded_step(rest, wanted, lambda postures: None)

    np.testing.assert_array_equal(step.motion, make_limiter().step(rest, wanted))
    assert step.share == pytest.approx(share)
    assert step.reason is None


def test_postures_to_check_are_those_after_the_step_and_of_the_braking():
    limiter, moving, asked = make_limiter(), MOVING, []

    after = limiter.guarded_step(moving, np.full(7, 0.5), asked.append).motion

    # The braking is that of the limiter itself, until it is at rest.
    braked, q = after, []
    while braked.velocity.any():
        braked = limiter.step(braked, np.zeros(7))
        q.append(braked.position)
    (postures,) = asked
    np.testing.assert_array_equal(postures[0], after.position)
    np.testing.assert_allclose(postures[2], q[-1], atol=1e-9)
    assert np.all((postures[0] < postures[1]) & (postures[1] < postures[2]))


def test_a_smaller_share_is_taken_if_the_whole_is_refused():
    moving = dut.JointMotion(MIDDLE, 0.3 * np.eye(7)[0], np.zeros(7))
    wanted = 0.6 * np.eye(7)[0]
    # The wall is just before where the arm would stop if the full velocity were allowed.
    ends = []
    make_limiter().guarded_step(moving, wanted, lambda postures: ends.append(postures[-1, 0]))
    wall = ends[0] - 1e-6

    step = make_limiter().guarded_step(
        moving, wanted, lambda postures: "wall" if postures[-1, 0] > wall else None
    )

    # Half of 0.6 rad/s is what it does already.
    assert (step.share, step.reason) == (0.5, "wall")
    np.testing.assert_allclose(step.motion.velocity, moving.velocity, atol=1e-12)


def test_if_every_share_is_refused_the_arm_brakes_with_a_reason():
    limiter, moving = make_limiter(), MOVING

    step = limiter.guarded_step(moving, np.full(7, 0.5), lambda postures: "wall")

    np.testing.assert_array_equal(step.motion, limiter.step(moving, np.zeros(7)))
    assert (step.share, step.reason) == (0.0, "wall")


def test_joint_limits_are_no_reason():
    asked = []

    step = make_limiter().guarded_step(
        dut.JointMotion.at_rest(OUTSIDE), 0.5 * np.eye(7)[3], asked.append
    )

    assert (step.share, step.reason) == (0.0, None)
    assert not asked


def test_braking_is_never_refused():
    asked = []

    for wanted in (np.zeros(7), np.full(7, np.nan)):
        step = make_limiter().guarded_step(MOVING, wanted, asked.append)

        assert (step.share, step.reason) == (1.0, None)
    assert not asked


def test_an_arm_never_stops_beyond_a_wall():
    # The wall is where the first joint is at 0.3 rad; every speed is checked against it.
    motion, limiter, reasons = dut.JointMotion.at_rest(MIDDLE), make_limiter(), set()
    for _ in range(400):
        step = limiter.guarded_step(
            motion, 2.0 * np.eye(7)[0], lambda q: "wall" if q[:, 0].max() > 0.3 else None
        )
        motion = step.motion
        reasons.add(step.reason)
        assert motion.position[0] <= 0.3

    assert reasons == {None, "wall"}
    assert not motion.velocity.any()
    assert motion.position[0] == pytest.approx(0.3, abs=0.01)


def test_braking_ends_in_exact_rest():
    motion, limiter = MOVING, make_limiter()
    for _ in range(256):
        motion = limiter.step(motion, np.zeros(7))

    assert not motion.velocity.any()
    assert not motion.acceleration.any()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"velocity_scale": 0.0}, "velocity_scale"),
        ({"jerk_scale": 1.5}, "jerk_scale"),
        ({"position_margin": -0.1}, "position_margin"),
        ({"jerk": (1.0,) * 6 + (0.0,)}, "jerk"),
        ({"jerk": (1.0,) * 6}, "jerk"),
    ],
)
def test_settings_are_checked(changes, said):
    with pytest.raises(InvalidValueError, match=said):
        make_limiter(**changes)
