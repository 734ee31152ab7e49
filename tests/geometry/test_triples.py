from itertools import combinations

import numpy as np

from poil_drake.geometry import triples as dut


def test_every_set_of_few_points_is_tried():
    # No three corners of a regular pentagon form a thin triangle.
    angles = 0.4 * np.pi * np.arange(5)
    points = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)

    triples = dut.choose_triples(points)

    assert {tuple(t) for t in triples.tolist()} == set(combinations(range(5), 3))


def test_sets_of_many_points_are_random_but_reproducible():
    points = np.random.default_rng(1).normal(size=(30, 3))

    first = dut.choose_triples(points)
    dut._triples.cache_clear()

    np.testing.assert_array_equal(dut.choose_triples(points), first)
    assert 150 < len(first) <= 200
    assert len({tuple(sorted(t)) for t in first.tolist()}) > 150
    assert all(len(set(t)) == 3 for t in first.tolist())


def test_thin_triangles_are_skipped():
    # Height over longest side: 0.05 / 2 of the first three, 0 of the three on the x axis.
    points = np.array([[-1.0, 0, 0], [0, 0.05, 0], [1, 0, 0], [0, 0, 0], [0, 1, 0]])

    triples = dut.choose_triples(points).tolist()

    assert [0, 1, 2] not in triples
    assert [0, 2, 3] not in triples
    assert [0, 2, 4] in triples


def test_two_points_make_no_triple():
    assert dut.choose_triples(np.eye(3)[:2]).shape == (0, 3)
