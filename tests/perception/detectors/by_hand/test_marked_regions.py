"""What boxes and clicks mark, against the blocks that each pixel shows."""

from collections.abc import Sequence

import numpy as np
import pytest
from block_scene import HANDLE, OBJECT, POST, TABLE, Scene, make_scene

from poil_drake.perception.detectors.by_hand.detector import hand_label_masks
from poil_drake.perception.detectors.by_hand.hand_labels import (
    BOX,
    EXCLUDE,
    INCLUDE,
    HandLabels,
    Mark,
)

SCENE = make_scene()
WHOLE = ("object", "handle")
VIEWS = ("left", "right")


def box(scene: Scene, view: str, role: str, *blocks: str) -> Mark:
    return Mark(view=view, role=role, kind=BOX, at=scene.box(view, *blocks))


def click(scene: Scene, view: str, role: str, block: str, kind: str = INCLUDE) -> Mark:
    return Mark(view=view, role=role, kind=kind, at=scene.middle(view, block))


def masks(scene: Scene, marks: Sequence[Mark], role: str) -> dict[str, np.ndarray]:
    return hand_label_masks(scene.frame, HandLabels.of(scene.frame).with_marks(marks))[role]


def check(mask: np.ndarray, truth: np.ndarray, *, precision: float, recall: float) -> None:
    """Checks a mask; its border may be off by a pixel, which is 5 to 10 % of these objects."""
    shared = np.count_nonzero(mask & truth)
    assert shared >= precision * np.count_nonzero(mask) > 0
    assert shared >= recall * np.count_nonzero(truth)


@pytest.mark.parametrize("boxed", [VIEWS, VIEWS[:1], VIEWS[1:]])
def test_boxes_mark_an_object_in_all_views(boxed: Sequence[str]) -> None:
    marks = [box(SCENE, view, "object", *WHOLE) for view in boxed]

    found = masks(SCENE, marks, "object")

    for view in VIEWS:
        check(found[view], SCENE.mask(view, *WHOLE), precision=0.97, recall=0.85)


@pytest.mark.parametrize("view", VIEWS)
def test_one_click_marks_an_object_in_all_views(view: str) -> None:
    found = masks(SCENE, [click(SCENE, view, "fixture", "post")], "fixture")

    for other in VIEWS:
        check(found[other], SCENE.mask(other, "post"), precision=0.97, recall=0.85)


def test_what_is_not_marked_has_no_masks() -> None:
    marks = [box(SCENE, "left", "object", *WHOLE)]

    for role in ("part", "fixture"):
        assert not any(mask.any() for mask in masks(SCENE, marks, role).values())


def test_a_box_leaves_out_what_reaches_beyond_it() -> None:
    wall = ((-0.12, -0.3, 0.0), (-0.1, 0.3, 0.3), (90, 200, 90))
    scene = make_scene({"table": TABLE, "object": OBJECT, "handle": HANDLE, "wall": wall})

    found = masks(scene, [box(scene, view, "object", *WHOLE) for view in VIEWS], "object")

    for view in VIEWS:
        check(found[view], scene.mask(view, *WHOLE), precision=0.97, recall=0.85)


def test_a_click_beside_it_cuts_off_a_neighbour_that_touches() -> None:
    neighbour = ((-0.05, -0.15, 0.0), (0.05, -0.05, 0.12), (40, 160, 60))
    scene = make_scene({"table": TABLE, "object": OBJECT, "neighbour": neighbour})
    marks = [
        click(scene, "right", "object", "object"),
        click(scene, "right", "object", "neighbour", EXCLUDE),
    ]

    found = masks(scene, marks, "object")

    for view in VIEWS:
        check(found[view], scene.mask(view, "object"), precision=0.85, recall=0.8)


def test_colour_marks_an_object_where_no_surface_supports_it() -> None:
    scene = make_scene({"object": OBJECT, "post": POST})

    found = masks(scene, [box(scene, view, "object", "object") for view in VIEWS], "object")

    for view in VIEWS:
        check(found[view], scene.mask(view, "object"), precision=0.97, recall=0.85)


def test_a_box_marks_what_it_encloses_of_the_object_as_part() -> None:
    marks = [
        *(box(SCENE, view, "object", *WHOLE) for view in VIEWS),
        box(SCENE, "left", "part", "handle"),
    ]

    found = masks(SCENE, marks, "part")

    left, top, right, bottom = SCENE.box("left", "handle")
    v, u = np.nonzero(found["left"])
    assert np.all((u >= left - 2) & (u <= right + 2))
    assert np.all((v >= top - 2) & (v <= bottom + 2))
    check(found["left"], SCENE.mask("left", "handle"), precision=0.5, recall=0.8)


def test_the_part_is_nearer_to_clicks_on_it_than_to_clicks_on_the_rest() -> None:
    marks = [
        box(SCENE, "left", "object", *WHOLE),
        box(SCENE, "left", "part", "handle"),
        click(SCENE, "left", "part", "handle"),
        click(SCENE, "left", "part", "object", EXCLUDE),
    ]

    found = masks(SCENE, marks, "part")

    check(found["left"], SCENE.mask("left", "handle"), precision=0.75, recall=0.6)
    assert found["right"].any()


def test_a_click_on_a_part_without_a_box_reaches_two_centimetres() -> None:
    marks = [box(SCENE, "left", "object", *WHOLE), click(SCENE, "left", "part", "handle")]

    found = masks(SCENE, marks, "part")

    # At 0.75 m, 180 px of focal length show 2 cm as 5 px.
    v, u = np.nonzero(found["left"])
    distance = np.hypot(*(np.array([u, v]).T - SCENE.middle("left", "handle")).T)
    assert 3.0 < distance.max() < 6.0


def test_a_click_beside_a_part_takes_two_centimetres_from_its_box() -> None:
    marks = [box(SCENE, "left", "object", *WHOLE), box(SCENE, "left", "part", *WHOLE)]
    beside = click(SCENE, "left", "part", "object", EXCLUDE)

    whole, found = (masks(SCENE, these, "part")["left"] for these in (marks, [*marks, beside]))

    # At 0.75 m, 180 px of focal length show 2 cm as 5 px.
    v, u = np.nonzero(whole & ~found)
    distance = np.hypot(*(np.array([u, v]).T - beside.at).T)
    assert 3.0 < distance.max() < 6.0


def test_a_click_in_a_small_hole_of_the_depth_counts() -> None:
    scene = make_scene()
    image = scene.frame.images[0]
    u, v = (int(x) for x in scene.middle("left", "post"))
    depth = image.depth.copy()
    depth[v - 2 : v + 3, u - 2 : u + 3] = 0.0
    frame = type(scene.frame)(
        scene.frame.cameras, (type(image)(image.rgb, depth, 0.0), scene.frame.images[1])
    )

    found = masks(
        Scene(frame, scene.shown, scene.blocks), [click(scene, "left", "object", "post")], "object"
    )

    check(found["right"], scene.mask("right", "post"), precision=0.97, recall=0.85)
