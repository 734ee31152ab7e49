import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from poil_drake.geometry import rigid_transform as dut

property_test = settings(derandomize=True, max_examples=200)

axes = (
    st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array).filter(lambda a: np.linalg.norm(a) > 1e-3)
)
# Ordinary angles, and those where the formulas are delicate: near 0 and near pi.
angles = st.one_of(
    st.floats(0.0, np.pi),
    st.floats(-16.0, -1.0).map(lambda e: 10.0**e),
    st.floats(-15.0, -1.0).map(lambda e: np.pi - 10.0**e),
)


@st.composite
def rotation_vectors(draw):
    axis = draw(axes)
    return draw(angles) * axis / np.linalg.norm(axis)


@given(rotation_vectors())
@property_test
def test_exponential_agrees_with_scipy(w):
    np.testing.assert_allclose(
        dut.rotation_exp(w), Rotation.from_rotvec(w).as_matrix(), rtol=0.0, atol=2e-15
    )


@given(rotation_vectors())
@property_test
def test_logarithm_inverts_the_exponential(w):
    log = dut.rotation_log(dut.rotation_exp(w))
    # Within rounding of pi both signs name the same rotation.
    flipped = np.pi - np.linalg.norm(w) < 1e-14 and log @ w < 0.0
    np.testing.assert_allclose(-log if flipped else log, w, rtol=1e-14, atol=4e-15)


@given(rotation_vectors())
@property_test
def test_angle_is_the_length_of_the_logarithm(w):
    np.testing.assert_allclose(
        dut.rotation_angle(dut.rotation_exp(w)), np.linalg.norm(w), rtol=1e-14, atol=4e-15
    )


def test_small_rotations_keep_their_relative_precision():
    w = np.array([3e-9, -4e-9, 0.0])

    log = dut.rotation_log(dut.rotation_exp(w))

    np.testing.assert_allclose(log, w, rtol=1e-15, atol=0.0)


def test_logarithm_of_identity_and_half_turns():
    half_turns = np.stack([np.diag([1, -1, -1]), np.diag([-1, 1, -1]), np.diag([-1, -1, 1])])

    np.testing.assert_array_equal(dut.rotation_log(np.eye(3)), np.zeros(3))
    np.testing.assert_allclose(np.abs(dut.rotation_log(half_turns)), np.pi * np.eye(3))


def test_many_at_once_equal_one_by_one():
    w = np.random.default_rng(0).normal(size=(4, 5, 3))

    R = dut.rotation_exp(w)
    log = dut.rotation_log(R)

    assert R.shape == (4, 5, 3, 3)
    for index in np.ndindex(4, 5):
        np.testing.assert_allclose(R[index], dut.rotation_exp(w[index]), atol=1e-16)
        np.testing.assert_allclose(log[index], dut.rotation_log(R[index]), atol=1e-15)


def test_skew_is_the_cross_product_and_vee_its_inverse():
    rng = np.random.default_rng(1)
    v, u = rng.normal(size=(2, 6, 3))

    S = dut.skew(v)

    np.testing.assert_allclose((S @ u[..., None])[..., 0], np.cross(v, u), atol=1e-15)
    np.testing.assert_array_equal(dut.vee(S), v)


def test_inverse_undoes_a_transform():
    rng = np.random.default_rng(2)
    X = dut.make_transform(dut.rotation_exp(rng.normal(size=(7, 3))), rng.normal(size=(7, 3)))

    np.testing.assert_allclose(dut.inverse(X) @ X, np.broadcast_to(np.eye(4), X.shape), atol=1e-15)


def test_points_are_transformed_like_homogeneous_vectors():
    rng = np.random.default_rng(3)
    X = dut.make_transform(dut.rotation_exp(rng.normal(size=(7, 3))), rng.normal(size=(7, 3)))
    points = rng.normal(size=(5, 3))
    homogeneous = np.column_stack([points, np.ones(5)])

    one = dut.transform_points(X[0], points)
    many = dut.transform_points(X, points)

    np.testing.assert_allclose(one, (homogeneous @ X[0].T)[:, :3], atol=1e-15)
    np.testing.assert_allclose(many, (homogeneous @ np.swapaxes(X, 1, 2))[..., :3], atol=1e-15)


def test_a_twist_turns_a_body_about_a_point_that_translates():
    rng = np.random.default_rng(0)
    X = dut.make_transform(dut.rotation_exp(rng.normal(size=(3, 3))), rng.normal(size=(3, 3)))
    V, origin = rng.normal(size=(3, 6)), rng.normal(size=(3, 3))

    moved = dut.moved_by_twist(X, V, origin, 0.5)

    for before, after, twist, centre in zip(X, moved, V, origin, strict=True):
        turn = Rotation.from_rotvec(0.5 * twist[:3]).as_matrix()
        motion = after @ np.linalg.inv(before)
        np.testing.assert_allclose(motion[:3, :3], turn, atol=1e-12)
        expected = centre + 0.5 * twist[3:]
        np.testing.assert_allclose(motion[:3, :3] @ centre + motion[:3, 3], expected, atol=1e-12)
        np.testing.assert_allclose(dut.moved_by_twist(before, twist, centre, 0.5), after)
