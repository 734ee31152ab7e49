import numpy as np
from scipy.spatial import cKDTree

from poil_drake.transfer.alignment.nearest_neighbours import nearest_both_ways


def test_agrees_with_a_tree_in_both_directions() -> None:
    rng = np.random.default_rng(0)
    sources, target = rng.normal(size=(4, 60, 6)), rng.normal(size=(45, 6))

    dut = nearest_both_ways(sources, target)

    for k in range(4):
        d, j = cKDTree(target).query(sources[k])
        e, i = cKDTree(sources[k]).query(target)
        np.testing.assert_array_equal(dut.target_of_source[k], j)
        np.testing.assert_array_equal(dut.source_of_target[k], i)
        np.testing.assert_allclose(dut.source_squares[k], d**2)
        np.testing.assert_allclose(dut.target_squares[k], e**2)
