import numpy as np
import pytest
from box_scene import (
    BLOCK,
    BODY,
    CAMERAS,
    CUP,
    HANDLE,
    RACK,
    Box,
    Boxes,
    Picture,
    agreement,
    known_shape,
    picture,
    placed,
    pose,
    surface,
)

from poil_drake.errors import DetectionError
from poil_drake.perception.detectors.known_shape.detector import KnownShapeDetector
from poil_drake.perception.detectors.known_shape.shape_fit import KnownShape
from poil_drake.perception.detectors.protocol import PartMasks

SHAPE = known_shape(BODY, HANDLE)
LABELS = {"object_label": "cup", "part_label": "handle"}
HERE = pose(0.0, -0.05, yaw=20.0)


def cup(X: np.ndarray, *, size: float = 1.0) -> dict[str, Boxes]:
    """Returns a cup's body and handle."""
    return {"body": placed(BODY, X, size=size), "handle": placed(HANDLE, X, size=size)}


def detect(seen: Picture, *, is_same: bool = False, shape: KnownShape = SHAPE) -> PartMasks:
    dut = KnownShapeDetector(
        shape, table_height=0.0, background=surface(RACK).points, is_same=is_same
    )
    return dut.detect(seen.frame, **LABELS)


def check(found: PartMasks, seen: Picture) -> None:
    """Checks the masks of the cup and its handle."""
    whole = tuple(a | b for a, b in zip(seen.masks["body"], seen.masks["handle"], strict=True))
    precision, recall = agreement(found.object_masks, whole)
    assert precision > 0.99
    assert recall > 0.9
    precision, recall = agreement(found.part_masks, seen.masks["handle"])
    # The region may reach onto the body by a ring of 6 mm, and the handle is 3 pixels wide.
    assert precision > 0.6
    assert recall > 0.75


def test_it_is_found_among_others_wherever_it_stands() -> None:
    lying = Box(pose(0.1, 0.12), np.array([0.02, 0.06, 0.015]))
    seen = picture({**cup(HERE), "rack": RACK, "brick": (lying,)})

    check(detect(seen), seen)


def test_a_larger_one_is_found() -> None:
    seen = picture(cup(HERE, size=1.25))

    check(detect(seen), seen)


def test_one_that_lies_on_its_side_is_found() -> None:
    # Turned about x by 90 degrees: the body's side of 3 cm is below, the handle still shows.
    side = HERE.copy()
    side[:3, :3] = HERE[:3, :3] @ np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    side[2, 3] = 0.03
    seen = picture(cup(side))

    check(detect(seen), seen)


def test_the_very_object_is_found_where_it_was_and_where_it_went() -> None:
    for X in (np.eye(4), pose(0.05, 0.1, yaw=60.0)):
        seen = picture(cup(X))
        check(detect(seen, is_same=True), seen)


def test_the_very_object_has_not_grown() -> None:
    with pytest.raises(DetectionError):
        detect(picture(cup(HERE, size=1.6)), is_same=True)


@pytest.mark.parametrize(
    ("things", "says"),
    [
        ({"rack": RACK}, "None of the 0 objects on the table looks like 'cup', "),
        (
            {"slab": (Box(pose(0.0, 0.0, 0.1), np.array([0.01, 0.1, 0.1])),)},
            "None of the 1 objects .* 'cup'|views show only .* of where the part 'handle'",
        ),
    ],
    ids=["nothing", "only another thing"],
)
def test_what_is_not_there_is_not_found(things: dict[str, Boxes], says: str) -> None:
    with pytest.raises(DetectionError, match=says) as info:
        detect(picture(things))

    assert "object" in info.value.remedy


def test_of_two_alike_neither_is_chosen() -> None:
    both = {"one": placed(CUP, HERE), "other": placed(CUP, pose(0.0, 0.1, yaw=20.0))}

    with pytest.raises(DetectionError, match=r"Two objects .* at \(0\.0\d, -0\.0\d, 0\.0\d\) m"):
        detect(picture(both))


def test_a_part_that_no_view_shows_is_not_guessed() -> None:
    # The handle is behind the body as seen by either camera.
    with pytest.raises(DetectionError, match="the part 'handle' of 'cup'") as info:
        detect(picture(cup(pose(0.0, 0.0, yaw=180.0))))

    assert "Turn the object" in info.value.remedy


def test_a_part_may_be_the_whole_object() -> None:
    whole = known_shape((), BLOCK)
    seen = picture({"block": placed(BLOCK, HERE)})

    found = detect(seen, shape=whole)

    assert agreement(found.part_masks, found.object_masks) == (1.0, 1.0)


def test_one_view_is_enough() -> None:
    seen = picture(cup(HERE), cameras=CAMERAS[:1])

    check(detect(seen), seen)
