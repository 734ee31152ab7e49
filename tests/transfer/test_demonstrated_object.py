from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from box_scene import (
    BLOCK,
    BODY,
    CUP,
    HANDLE,
    HUNG,
    RACK,
    Boxes,
    Picture,
    agreement,
    box,
    picture,
    placed,
    pose,
    surface,
)
from scipy.spatial import cKDTree

from poil_drake.errors import DetectionError, TrackingError
from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.perception.trackers.protocol import TrackerOutput
from poil_drake.recording.demonstration.demonstration import Demonstration
from poil_drake.transfer.demonstrated_object import DemonstratedObject, find_demonstrated_object

START = pose(0.0, -0.1)
STILL = {"rack": RACK, "block": placed(BLOCK, pose(0.12, 0.02))}


@dataclass(frozen=True)
class CarryingTracker:
    """Moves the points of the cup from pose to pose; loses whatever else it is to track."""

    poses: Sequence[np.ndarray]

    def start(self, frame, query_points, object_masks) -> TrackerOutput:
        own = transform_points(inverse(self.poses[0]), query_points)
        if cKDTree(surface(CUP).points).query(own)[0].max() > 0.006:
            raise TrackingError("This is no cup.", remedy="Track a cup.")
        return self.step((-1, own), frame)

    def step(self, state, frame, motion_prior=None) -> TrackerOutput:
        k, own = state[0] + 1, state[1]
        points = TrackedPoints(transform_points(self.poses[k], own), np.ones(len(own)), frame.stamp)
        return TrackerOutput((k, own), points, False)


def cup(X: np.ndarray) -> dict[str, Boxes]:
    return {"body": placed(BODY, X), "handle": placed(HANDLE, X)}


def shown(
    poses: Sequence[np.ndarray],
    still: Mapping[str, Boxes] = STILL,
    *,
    first: Mapping[str, Boxes] | None = None,
) -> tuple[Picture, Demonstration]:
    """Returns the first picture, and a demonstration in which the cup goes from pose to pose.

    Args:
        poses: The cup's poses (4, 4).
        still: What stands still.
        first: What only the first frame shows.
    """
    pictures = [
        picture({**cup(X), **still, **((first or {}) if k == 0 else {})}, stamp=0.5 * k)
        for k, X in enumerate(poses)
    ]
    return pictures[0], Demonstration([one.frame for one in pictures], name="hang.mcap")


def find(poses: Sequence[np.ndarray], demonstration: Demonstration) -> DemonstratedObject:
    return find_demonstrated_object(demonstration, table_height=0.0, tracker=CarryingTracker(poses))


POSES = (START, pose(0.0, 0.0, 0.2), HUNG)


@pytest.fixture(scope="module")
def hung() -> tuple[Picture, DemonstratedObject]:
    """The first picture of a demonstration that hangs the cup on the rack, and the findings."""
    before, demonstration = shown(POSES)
    return before, find(POSES, demonstration)


def test_the_object_is_what_left_the_table(hung: tuple[Picture, DemonstratedObject]) -> None:
    before, dut = hung
    whole = tuple(a | b for a, b in zip(before.masks["body"], before.masks["handle"], strict=True))

    precision, recall = agreement(dut.masks.object_masks, whole)

    assert precision == 1.0
    assert recall > 0.9


def test_the_part_is_what_hangs_on_the_fixture(hung: tuple[Picture, DemonstratedObject]) -> None:
    before, dut = hung
    own = transform_points(inverse(START), dut.shape.cloud.points)

    # The handle begins at x = 30 mm, and the region grows in rings of 6 mm.
    assert own[dut.shape.part, 0].min() > 0.024
    # It may end at a corner of the handle, which is wider than its bars.
    assert dut.shape.part[own[:, 0] > 0.036].mean() > 0.6
    precision, recall = agreement(dut.masks.part_masks, before.masks["handle"])
    assert precision > 0.9
    assert recall > 0.6


def test_the_shape_has_what_only_the_end_shows(hung: tuple[Picture, DemonstratedObject]) -> None:
    own = transform_points(inverse(START), hung[1].shape.cloud.points)

    # The cameras are at the cup's +x side at first. On the rack, they see where it stood; its foot
    # is completed besides.
    nearest = cKDTree(own).query(surface(BODY, step=0.01).points)[0]
    assert np.median(nearest) < 0.004
    assert cKDTree(surface(CUP).points).query(own)[0].max() < 0.006


def test_the_tracks_are_those_of_the_object(hung: tuple[Picture, DemonstratedObject]) -> None:
    tracks = hung[1].tracks

    np.testing.assert_array_equal(tracks.times, [0.0, 0.5, 1.0])
    for positions, X in zip(tracks.positions, POSES, strict=True):
        own = transform_points(X @ inverse(START), tracks.positions[0])
        np.testing.assert_allclose(positions, own, atol=1e-9)


def test_the_fixture_is_where_the_object_ends(hung: tuple[Picture, DemonstratedObject]) -> None:
    fixture = hung[1].fixture

    assert cKDTree(surface(RACK).points).query(fixture)[0].max() < 0.006
    assert np.ptp(fixture, axis=0)[2] > 0.28


def test_a_hand_that_leaves_is_not_the_object() -> None:
    hand = {"hand": (box([-0.12, 0.06, 0.05], [0.03, 0.03, 0.03]),)}
    before, demonstration = shown(POSES, first=hand)

    dut = find(POSES, demonstration)

    assert not any(
        (found & own).any()
        for found, own in zip(dut.masks.object_masks, before.masks["hand"], strict=True)
    )


def test_an_object_that_ends_out_of_sight_has_the_shape_that_is_seen_first() -> None:
    shelf = {"shelf": (box([0.0, 0.1, 0.1], [0.01, 0.15, 0.1]),)}
    poses = (pose(0.1, -0.15), pose(-0.06, 0.1))
    _, demonstration = shown(poses, shelf)

    dut = find(poses, demonstration)

    own = transform_points(inverse(poses[0]), dut.shape.cloud.points)
    assert cKDTree(surface(CUP).points).query(own)[0].max() < 0.006


def test_nothing_that_moves_is_refused() -> None:
    poses = (START, START)

    with pytest.raises(DetectionError, match=r"No objects left .* 'hang\.mcap'; exactly one must"):
        find(poses, shown(poses)[1])


def test_an_object_that_cannot_be_tracked_is_refused() -> None:
    with pytest.raises(TrackingError, match="no cup"):
        find((pose(0.3, 0.3), HUNG), shown((START, HUNG))[1])


@pytest.mark.parametrize(
    ("still", "says"),
    [(STILL, r"ends \d+ cm from anything else"), ({}, "ends without anything else above")],
    ids=["far away", "nothing else"],
)
def test_an_object_that_ends_next_to_nothing_is_refused(
    still: Mapping[str, Boxes], says: str
) -> None:
    poses = (START, pose(0.0, -0.25))

    with pytest.raises(DetectionError, match=says) as info:
        find(poses, shown(poses, still)[1])

    assert "poil.table_height" in info.value.remedy


def test_two_objects_that_move_are_refused() -> None:
    before = picture({"one": placed(CUP, START), "other": placed(CUP, pose(0.0, 0.05)), **STILL})
    after = picture(STILL, stamp=1.0)

    class AnyTracker(CarryingTracker):
        """Tracks whatever it is given."""

        def start(self, frame, query_points, object_masks) -> TrackerOutput:
            return self.step((-1, query_points), frame)

    with pytest.raises(DetectionError, match="2 objects left their places"):
        find_demonstrated_object(
            Demonstration([before.frame, after.frame]),
            table_height=0.0,
            tracker=AnyTracker((np.eye(4), pose(0.0, 0.0, 0.3))),
        )
