import numpy as np
from box_scene import BLOCK, CUP, RACK, agreement, box, picture, placed, pose

from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.perception.detectors.known_shape.moved_object import (
    arrived_masks,
    departed_masks,
    world_points,
)

HERE, THERE = pose(0.0, -0.1), pose(0.03, 0.08, 0.1, yaw=40.0)
STILL = {"block": placed(BLOCK, pose(0.1, 0.0)), "rack": RACK}
BEFORE = picture({"cup": placed(CUP, HERE), **STILL})
AFTER = picture({"cup": placed(CUP, THERE), **STILL})


def test_only_what_left_its_place_is_found() -> None:
    (found,) = departed_masks(BEFORE.frame, AFTER.frame, table_height=0.0)

    precision, recall = agreement(found, BEFORE.masks["cup"])
    assert precision == 1.0
    # The lowest 4 mm count as the table.
    assert recall > 0.93


def test_what_only_arrives_has_not_left() -> None:
    alone = picture(STILL)

    assert departed_masks(alone.frame, AFTER.frame, table_height=0.0) == []


def test_the_larger_of_two_that_left_comes_first() -> None:
    tower = placed(BLOCK, pose(0.0, -0.1), size=2.0)
    before = picture({"block": placed(BLOCK, pose(0.0, 0.1)), "tower": tower})

    found = departed_masks(before.frame, picture({}).frame, table_height=0.0)

    assert [
        agreement(masks, before.masks[name])[0]
        for masks, name in zip(found, ("tower", "block"), strict=True)
    ] == [1.0, 1.0]


def test_a_view_that_shows_nothing_of_it_has_an_empty_mask() -> None:
    board = (box([0.25, 0.175, 0.25], [0.1, 0.1, 0.1]),)
    before = picture({"cup": placed(CUP, HERE), "board": board})
    after = picture({"board": board})
    hidden = [not mask.any() for mask in before.masks["cup"]]
    assert hidden == [False, True]

    (found,) = departed_masks(before.frame, after.frame, table_height=0.0)

    assert [not mask.any() for mask in found] == hidden


def test_an_object_is_found_where_it_went() -> None:
    motion = THERE @ inverse(HERE)
    seen = np.concatenate(
        [
            world_points(camera, image.depth)[mask]
            for camera, image, mask in zip(
                BEFORE.frame.cameras, BEFORE.frame.images, BEFORE.masks["cup"], strict=True
            )
        ]
    )

    found = arrived_masks(
        BEFORE.frame, AFTER.frame, transform_points(motion, seen), table_height=0.0
    )

    precision, recall = agreement(found, AFTER.masks["cup"])
    assert precision > 0.99
    assert recall > 0.95


def test_pixels_become_points_in_the_world() -> None:
    camera, image = BEFORE.frame.cameras[0], BEFORE.frame.images[0]

    points = world_points(camera, image.depth)

    table = ~np.any([own[0] for own in BEFORE.masks.values()], axis=0) & (image.depth > 0.0)
    np.testing.assert_allclose(points[table][:, 2], 0.0, atol=1e-6)
    (block,) = STILL["block"]
    own = transform_points(inverse(block.X), points[BEFORE.masks["block"][0]])
    np.testing.assert_allclose((np.abs(own) / block.half).max(axis=1), 1.0, atol=1e-5)
