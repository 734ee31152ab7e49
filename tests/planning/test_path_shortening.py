from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose

from poil_drake.planning.path_shortening import EdgeChecker, round_corners, shorten_path

CORNERS = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]])


def anywhere(x):
    return np.ones(len(x), dtype=bool)


def outside_a_disc(x):
    return np.linalg.norm(x - [0.5, 0.3], axis=1) > 0.35


def length(path):
    return np.linalg.norm(np.diff(path, axis=0), axis=1).sum()


def test_in_free_space_a_detour_becomes_nearly_straight():
    path = shorten_path(CORNERS, EdgeChecker(anywhere, 0.01), 200, np.random.default_rng(0))

    assert_allclose(path[[0, -1]], CORNERS[[0, -1]])
    assert length(path) < 1.05


def test_shorter_path_stays_clear():
    edges = EdgeChecker(outside_a_disc, 0.01)

    path = shorten_path(CORNERS, edges, 200, np.random.default_rng(0))

    fine = EdgeChecker(outside_a_disc, 0.001)
    # Between two checks of 1 cm a chord dips into the disc by 0.005^2 / (2 * 0.35) = 0.04 mm.
    dense = np.concatenate([fine.samples(a, b) for a, b in pairwise(path)])
    assert np.linalg.norm(dense - [0.5, 0.3], axis=1).min() > 0.35 - 5e-5
    # Two tangents and the arc between them, over the disc.
    away = np.hypot(0.5, 0.3)
    arc = np.pi + 2.0 * np.arctan2(0.3, 0.5) - 2.0 * np.arccos(0.35 / away)
    shortest = 2.0 * np.sqrt(away**2 - 0.35**2) + 0.35 * arc
    assert shortest - 1e-3 < length(path) < 1.05 * shortest


@pytest.mark.parametrize("count", [1, 2, 3])
def test_path_of_length_zero_is_kept(count: int):
    edges, corners = EdgeChecker(anywhere, 0.01), np.tile([0.2, 0.7], (count, 1))

    path = shorten_path(corners, edges, 5, np.random.default_rng(0))
    rounded = round_corners(path, edges, width=0.4)

    assert_allclose(path, corners)
    assert_allclose(rounded, np.broadcast_to([0.2, 0.7], rounded.shape))


def test_rounded_path_has_no_sharp_corner_and_the_same_ends():
    path = round_corners(CORNERS, EdgeChecker(anywhere, 0.01), width=0.4)

    assert_allclose(path[[0, -1]], CORNERS[[0, -1]])
    steps = np.diff(path, axis=0)
    headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    # A right angle over 0.4 m in steps of 0.01 m, four times the mean at the most.
    assert np.abs(np.diff(headings)).max() < 4 * (np.pi / 2) * 0.01 / 0.4


def test_corners_are_kept_where_there_is_no_room():
    def on_the_path(x):
        inside = (x[:, 0] > 1e-6) & (x[:, 0] < 1 - 1e-6) & (x[:, 1] < 1 - 1e-6)
        return ~inside

    path = round_corners(CORNERS, EdgeChecker(on_the_path, 0.01), width=0.4)

    assert length(path) == pytest.approx(3.0)
    assert on_the_path(path).all()
