from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from poil_drake.planning.path_shortening import EdgeChecker
from poil_drake.planning.rrt_connect import VectorSpace, rrt_connect

START, GOAL = np.array([-0.5, 0.0]), np.array([0.5, 0.0])


def beside_the_wall(x):
    """A wall at x = 0 with a gap above y = 0.5."""
    return (np.abs(x[:, 0]) > 0.05) | (x[:, 1] > 0.5)


def closed(x):
    return np.abs(x[:, 0]) > 0.05


def search(is_free, seed=0, iterations=2000):
    return rrt_connect(
        VectorSpace(np.array([-1.0, -1.0]), np.array([1.0, 1.0])),
        START,
        GOAL,
        is_free=is_free,
        edge_is_free=EdgeChecker(is_free, 0.02).is_free,
        max_edge=0.4,
        iterations=iterations,
        seed=seed,
    )


@pytest.mark.parametrize("seed", range(5))
def test_path_leads_through_the_gap(seed):
    corners = search(beside_the_wall, seed)

    assert_allclose(corners[[0, -1]], [START, GOAL], atol=1e-12)
    edges = EdgeChecker(beside_the_wall, 0.002)
    assert all(edges.is_free(a, b) for a, b in pairwise(corners))
    assert np.linalg.norm(np.diff(corners, axis=0), axis=1).max() <= 0.4 + 1e-9


def test_earlier_searches_do_not_matter():
    first = search(beside_the_wall, seed=3)
    other = search(beside_the_wall, seed=4)
    for seed in range(5):
        search(closed, seed, iterations=50)

    assert_array_equal(search(beside_the_wall, seed=3), first)
    assert not np.array_equal(first, other)


def test_search_without_a_path_ends():
    assert search(closed, iterations=100) is None
