from collections.abc import Callable

import numpy as np

from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.geometry.rigid_transform import rotation_angle
from poil_drake.transfer.alignment.coarse_alignment import CoarseAlignment
from poil_drake.transfer.alignment.problem import AlignmentProblem, CoarseAlignmentConfig
from poil_drake.transfer.alignment.symmetric_alignments import (
    SYMMETRY_TOLERANCE,
    half_turns,
    symmetric_alignments,
)

Maker = Callable[..., PointCloud]


def test_a_box_is_symmetric_about_all_its_axes() -> None:
    box = np.stack(np.meshgrid(*[np.linspace(0.7, 1.7, 7)] * 3), axis=-1) * [0.1, 0.06, 0.03]

    turns, chamfers = half_turns(box.reshape(-1, 3))

    # Largest extent first.
    expected = [np.diag([1, -1, -1]), np.diag([-1, 1, -1]), np.diag([-1, -1, 1])]
    np.testing.assert_allclose(turns, expected, atol=1e-9)
    np.testing.assert_allclose(chamfers, 0.0, atol=1e-9)


def test_a_handle_is_symmetric_about_the_direction_in_which_it_protrudes(
    make_handle: Maker,
) -> None:
    turns, chamfers = half_turns(make_handle("c", count=800).points)

    # Along x: there the half turn is diag(1, -1, -1).
    np.testing.assert_array_equal(chamfers <= SYMMETRY_TOLERANCE, turns[:, 0, 0] > 0.99)


def test_an_ear_is_less_symmetric_than_a_half_circle(make_handle: Maker) -> None:
    ear, half_circle = (
        half_turns(make_handle(shape, count=800).points)[1].min() for shape in ("ear", "c")
    )

    assert ear > 1.5 * half_circle


def align(make_handle: Maker, shape: str, **config: float) -> list[CoarseAlignment]:
    source, target = make_handle(shape), make_handle(shape, seed=1)
    problem = AlignmentProblem.between(
        source, target, config=CoarseAlignmentConfig(**({"upright_weight": 0.0} | config))
    )
    return symmetric_alignments(problem, target.points)


def test_a_symmetric_part_has_alternatives(make_handle: Maker) -> None:
    found = align(make_handle, "c")

    assert len(found) == 2
    turn = rotation_angle(found[0].rotation.T @ found[1].rotation)
    np.testing.assert_allclose(np.rad2deg(turn), 180.0, atol=8.0)


def test_a_half_turn_that_the_search_did_not_find_is_refined(make_handle: Maker) -> None:
    assert len(align(make_handle, "c", max_modes=1)) == 2


def test_an_asymmetric_part_has_no_alternatives(make_handle: Maker) -> None:
    assert len(align(make_handle, "ear")) == 1


def test_alignments_beyond_the_cost_margin_are_left_out(make_handle: Maker) -> None:
    assert len(align(make_handle, "c", cost_margin=0.0)) == 1
