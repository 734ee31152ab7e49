from collections.abc import Callable

import numpy as np

from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.geometry.rigid_transform import rotation_angle
from poil_drake.transfer.alignment.config import CoarseAlignmentConfig
from poil_drake.transfer.alignment.symmetric_alignments import AmbiguityConfig, symmetric_alignments
from poil_drake.transfer.symmetry import SymmetryConfig, half_turns

Maker = Callable[..., PointCloud]
PART_ALONE = CoarseAlignmentConfig(upright_weight=0.0)


def axis_aligned_box(sides: list[float]) -> np.ndarray:
    grid = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, 7)] * 3), axis=-1).reshape(-1, 3)
    return grid * sides


def test_a_box_is_symmetric_about_all_its_axes() -> None:
    turns = half_turns(axis_aligned_box([0.1, 0.06, 0.03]) + 0.7)

    assert [turn.symmetric for turn in turns] == [True, True, True]
    # Largest extent first.
    np.testing.assert_allclose(np.abs([turn.axis for turn in turns]), np.eye(3), atol=1e-9)
    np.testing.assert_allclose(turns[0].rotation, np.diag([1.0, -1.0, -1.0]), atol=1e-9)
    np.testing.assert_allclose([turn.chamfer for turn in turns], 0.0, atol=1e-9)


def test_a_handle_is_symmetric_about_the_direction_it_stands_out_in(make_handle: Maker) -> None:
    turns = half_turns(make_handle("c", count=800).points)

    outward = [abs(turn.axis[0]) > 0.99 for turn in turns]
    assert [turn.symmetric for turn in turns] == outward


def test_an_ear_is_less_symmetric_than_a_half_circle(make_handle: Maker) -> None:
    ear, half_circle = (
        min(turn.chamfer for turn in half_turns(make_handle(shape, count=800).points))
        for shape in ("ear", "c")
    )

    assert ear > 1.5 * half_circle


def test_the_tolerance_decides(make_handle: Maker) -> None:
    strict = SymmetryConfig(tolerance=0.02)

    assert not any(turn.symmetric for turn in half_turns(make_handle("ear").points, strict))


def test_a_symmetric_part_has_alternatives(make_handle: Maker) -> None:
    found = symmetric_alignments(make_handle("c"), make_handle("c", seed=1), alignment=PART_ALONE)

    assert len(found) == 2
    turn = rotation_angle(found[0].rotation.T @ found[1].rotation)
    np.testing.assert_allclose(np.rad2deg(turn), 180.0, atol=8.0)


def test_a_half_turn_that_the_search_did_not_find_is_refined(make_handle: Maker) -> None:
    source, target = make_handle("c"), make_handle("c", seed=1)
    one_mode = CoarseAlignmentConfig(upright_weight=0.0, max_modes=1)

    found = symmetric_alignments(source, target, alignment=one_mode)

    assert len(found) == 2


def test_an_asymmetric_part_has_none(make_handle: Maker) -> None:
    found = symmetric_alignments(
        make_handle("ear"), make_handle("ear", seed=1), alignment=PART_ALONE
    )

    assert len(found) == 1


def test_what_costs_more_than_the_margin_is_left_out(make_handle: Maker) -> None:
    strict = AmbiguityConfig(cost_margin=0.0)

    found = symmetric_alignments(
        make_handle("c"), make_handle("c", seed=1), alignment=PART_ALONE, ambiguity=strict
    )

    assert len(found) == 1
