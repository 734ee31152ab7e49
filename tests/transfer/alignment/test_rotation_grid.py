import numpy as np
from scipy.spatial.transform import Rotation

from poil_drake.transfer.alignment.rotation_grid import (
    distinct_rotations,
    super_fibonacci_rotations,
)


def test_every_orientation_is_near_one_of_720() -> None:
    R = super_fibonacci_rotations(720)
    np.testing.assert_allclose(
        R @ np.swapaxes(R, 1, 2), np.tile(np.eye(3), (720, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(R), 1.0)
    anywhere = Rotation.random(2000, random_state=0).as_matrix()

    traces = np.einsum("kij,nij->nk", R, anywhere).max(axis=1)

    # The descent converges from 40 degrees; the docstring promises about 25.
    assert np.rad2deg(np.arccos((traces - 1.0) / 2.0)).max() < 28.0


def test_distinct_rotations_keep_the_cheapest_of_each_group() -> None:
    angles = np.deg2rad([0.0, 5.0, 90.0, 93.0, 180.0])
    R = Rotation.from_rotvec(angles[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    costs = np.array([3.0, 2.0, 1.0, 0.5, 4.0])

    kept = distinct_rotations(R, costs, angle=np.deg2rad(20.0), count=10)

    np.testing.assert_array_equal(kept, [3, 1, 4])
    assert len(distinct_rotations(R, costs, angle=np.deg2rad(20.0), count=2)) == 2
