import numpy as np
from box_scene import BLOCK, CUP, RACK, Boxes, agreement, box, picture, placed, pose, surface

from poil_drake.perception.detectors.known_shape.object_clusters import object_clusters

CUP_HERE, BLOCK_THERE = placed(CUP, pose(0.0, -0.1)), placed(BLOCK, pose(0.1, 0.08))


def found(things: dict[str, Boxes], *, background: np.ndarray | None = None) -> list[str | None]:
    """Returns the thing of each cluster; None for one that mixes things."""
    seen = picture(things)
    names: list[str | None] = []
    for masks in object_clusters(
        seen.frame,
        table_height=0.0,
        background=np.zeros((0, 3)) if background is None else background,
    ):
        names += [name for name, own in seen.masks.items() if agreement(masks, own)[0] == 1.0] or [
            None
        ]
    return names


def test_things_apart_are_clusters() -> None:
    dut = found({"cup": CUP_HERE, "block": BLOCK_THERE, "rack": RACK})

    assert sorted(map(str, dut)) == ["block", "cup", "rack"]


def test_a_cluster_is_all_that_is_seen_of_a_thing_but_its_foot() -> None:
    seen = picture({"cup": CUP_HERE})

    (masks,) = object_clusters(seen.frame, table_height=0.0, background=np.zeros((0, 3)))

    # The lowest 5 mm of 80 mm count as the table.
    assert agreement(masks, seen.masks["cup"])[1] > 0.92


def test_things_that_touch_are_one_cluster() -> None:
    touching = placed(BLOCK, pose(0.0, -0.155))

    assert found({"cup": CUP_HERE, "block": touching}) == [None]


def test_the_background_is_left_out() -> None:
    dut = found({"cup": CUP_HERE, "rack": RACK}, background=surface(RACK).points)

    assert dut == ["cup"]


def test_walls_and_crumbs_are_no_objects() -> None:
    wall = (box([-0.3, 0.0, 0.2], [0.01, 0.5, 0.2]),)
    crumb = (box([0.0, 0.0, 0.005], [0.005, 0.005, 0.005]),)

    assert found({"wall": wall, "crumb": crumb}) == []


def test_an_empty_table_has_no_clusters() -> None:
    assert found({}) == []
