import numpy as np
from scipy.spatial.transform import Rotation

from poil_drake.geometry.rotation_grid import super_fibonacci_rotations


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
