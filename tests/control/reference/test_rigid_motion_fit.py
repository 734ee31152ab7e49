import numpy as np
import pytest

from poil_drake.control.reference.rigid_motion_fit import fit_rigid_motion as dut
from poil_drake.errors import TransferError
from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, transform_points

DISTANCE = 0.01


def motion(rng, count=40):
    body = rng.normal(scale=0.03, size=(8, 3))
    body -= body.mean(axis=0)
    X = make_transform(rotation_exp(rng.normal(size=(count, 3))), rng.normal(size=(count, 3)))
    return body, X, transform_points(X, body)


def test_rigid_points_are_fitted_exactly():
    _, _, positions = motion(np.random.default_rng(0))

    body, X, usable = dut(positions, DISTANCE)

    assert usable.all()
    np.testing.assert_allclose(transform_points(X, body), positions, atol=1e-12)
    np.testing.assert_allclose(body.mean(axis=0), np.zeros(3), atol=1e-15)


def test_shape_is_the_mean_over_the_samples():
    rng = np.random.default_rng(1)
    true_body, _, positions = motion(rng, 100)

    body, _, _ = dut(positions + rng.normal(scale=1e-3, size=positions.shape), DISTANCE)

    # Distances within the shape do not depend on its frame. Each coordinate is a mean of 100.
    distances = np.linalg.norm(body[:, None] - body, axis=2)
    expected = np.linalg.norm(true_body[:, None] - true_body, axis=2)
    assert np.max(np.abs(distances - expected)) < 5 * 1e-3 / 10 * np.sqrt(2)


def test_missing_and_stray_points_are_left_out():
    rng = np.random.default_rng(2)
    _, _, positions = motion(rng)
    broken = positions.copy()
    broken[3, 2:5] = np.nan
    broken[5, 1:] = np.nan
    broken[10:25, 6] += [0.0, 0.1, 0.0]

    body, X, usable = dut(broken, DISTANCE)

    assert np.flatnonzero(~usable).tolist() == [5]
    np.testing.assert_allclose(transform_points(X, body), positions[usable], atol=1e-9)


def test_one_sample_with_every_point_is_needed():
    _, _, positions = motion(np.random.default_rng(3))
    positions[:, 0] = np.nan

    with pytest.raises(TransferError, match="0 have all"):
        dut(positions, DISTANCE)


def test_points_that_change_places_later_are_left_out_from_then_on():
    _, _, positions = motion(np.random.default_rng(4))
    swapped = positions.copy()
    swapped[25:, [1, 6]] = swapped[25:, [6, 1]]

    body, X, _ = dut(swapped, DISTANCE)

    np.testing.assert_allclose(transform_points(X, body), positions, atol=1e-9)


@pytest.mark.parametrize("change", ["swap", "drift"])
def test_points_that_were_elsewhere_at_the_start_are_refused_by_name(change):
    _, X, positions = motion(np.random.default_rng(4))
    if change == "swap":
        positions[10:, [1, 6]] = positions[10:, [6, 1]]
    else:
        shifts = np.linspace(0.0, 0.03, 40)[:, None] * np.array([0.0, 0.0, 1.0])
        positions[:, 6] += (X[:, :3, :3] @ shifts[:, :, None])[:, :, 0]

    with pytest.raises(TransferError, match=r"the points \[(1, )?6\] move by up to \d+ mm"):
        dut(positions, DISTANCE)
