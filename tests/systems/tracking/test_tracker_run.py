import numpy as np
import pytest
from small_frames import make_frame

from poil_drake.errors import TrackingError
from poil_drake.perception.detectors.protocol import PartMasks
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.perception.trackers.protocol import TrackerOutput
from poil_drake.systems.statuses import TrackerStatus
from poil_drake.systems.tracking.tracker_run import TrackerInputs, TrackerRun, advance

N = 3
QUERY = np.array([[0.5, 0.0, 0.1], [0.6, 0.0, 0.1], [0.5, 0.1, 0.2]])


class ScriptedTracker:
    """Does what its script says at each call, and records its arguments."""

    def __init__(self, *script: str):
        self.script = list(script)
        self.calls: list[tuple] = []

    def _answer(self, state: int, frame: MultiViewFrame, points: np.ndarray) -> TrackerOutput:
        verdict = self.script.pop(0)
        if verdict == "error":
            raise TrackingError("Too little is seen.", remedy="Look from elsewhere.")
        if verdict == "lost":
            return TrackerOutput(state, TrackedPoints.lost(N, frame.stamp), True)
        return TrackerOutput(state, TrackedPoints(points, np.ones(N), frame.stamp), False)

    def start(
        self, frame: MultiViewFrame, query_points: np.ndarray, object_masks: tuple[np.ndarray, ...]
    ) -> TrackerOutput:
        self.calls.append(("start", query_points, object_masks))
        return self._answer(0, frame, query_points)

    def step(
        self, state: int, frame: MultiViewFrame, motion_prior: np.ndarray | None = None
    ) -> TrackerOutput:
        self.calls.append(("step", state, motion_prior))
        return self._answer(state + 1, frame, np.zeros((N, 3)))


def new_masks() -> PartMasks:
    mask = (np.ones((1, 2), dtype=bool),)
    return PartMasks(object_masks=mask, part_masks=mask)


MASKS = new_masks()


def inputs(
    tick: int,
    *,
    masks: PartMasks | None = MASKS,
    query: np.ndarray | None = QUERY,
    motion: np.ndarray | None = None,
) -> TrackerInputs:
    """Returns the inputs of the frame at tick / 8 s."""
    return TrackerInputs(
        frame=make_frame(tick), masks=masks, query_points=query, object_motion=motion
    )


def shifted(x: float) -> np.ndarray:
    X = np.eye(4)
    X[0, 3] = x
    return X


@pytest.fixture
def before() -> TrackerRun:
    return TrackerRun(points=TrackedPoints.lost(N, -np.inf))


@pytest.mark.parametrize(
    "missing", [{"masks": None}, {"query": None}, {"query": np.full((N, 3), np.nan)}]
)
def test_it_waits_for_masks_and_query_points(before: TrackerRun, missing: dict) -> None:
    tracker = ScriptedTracker()

    run = advance(tracker, before, inputs(2, **missing))

    assert run.status is TrackerStatus.WAITING
    assert run.points.stamp == 0.25
    np.testing.assert_array_equal(run.points.confidence, np.zeros(N))
    assert tracker.calls == []


def test_it_starts_at_the_query_points(before: TrackerRun) -> None:
    tracker = ScriptedTracker("ok")

    run = advance(tracker, before, inputs(2, motion=shifted(0.7)))

    assert run.status is TrackerStatus.TRACKING
    np.testing.assert_array_equal(run.points.positions, QUERY)
    ((name, query, masks),) = tracker.calls
    assert name == "start"
    np.testing.assert_array_equal(query, QUERY)
    assert masks is MASKS.object_masks


def test_then_it_steps_with_the_motion_between_frames_as_prior(before: TrackerRun) -> None:
    tracker = ScriptedTracker("ok", "ok", "ok")
    run = advance(tracker, before, inputs(0, motion=shifted(0.5)))

    run = advance(tracker, run, inputs(1, motion=shifted(0.6)))
    run = advance(tracker, run, inputs(2, motion=shifted(0.9)))

    (_, first_state, first_prior), (_, second_state, second_prior) = tracker.calls[1:]
    assert (first_state, second_state) == (0, 1)
    np.testing.assert_allclose(first_prior, shifted(0.1), atol=1e-12)
    np.testing.assert_allclose(second_prior, shifted(0.3), atol=1e-12)


def test_without_forward_kinematics_there_is_no_prior(before: TrackerRun) -> None:
    tracker = ScriptedTracker("ok", "ok")
    run = advance(tracker, before, inputs(0))

    advance(tracker, run, inputs(1, motion=shifted(0.6)))

    assert tracker.calls[1] == ("step", 0, None)


def test_a_loss_passes_through_and_the_tracker_continues(before: TrackerRun) -> None:
    tracker = ScriptedTracker("ok", "lost", "ok")
    run = advance(tracker, before, inputs(0))

    lost = advance(tracker, run, inputs(1))
    found = advance(tracker, lost, inputs(2))

    assert lost.status is TrackerStatus.LOST
    np.testing.assert_array_equal(lost.points.confidence, np.zeros(N))
    assert lost.points.stamp == 0.125
    assert found.status is TrackerStatus.TRACKING
    assert [call[0] for call in tracker.calls] == ["start", "step", "step"]


def test_an_error_keeps_the_last_good_state_and_its_motion(before: TrackerRun) -> None:
    tracker = ScriptedTracker("ok", "error", "ok")
    run = advance(tracker, before, inputs(0, motion=shifted(0.0)))

    lost = advance(tracker, run, inputs(1, motion=shifted(0.2)))
    advance(tracker, lost, inputs(2, motion=shifted(0.3)))

    assert lost.status is TrackerStatus.LOST
    name, state, prior = tracker.calls[2]
    assert (name, state) == ("step", 0)
    np.testing.assert_allclose(prior, shifted(0.3), atol=1e-12)


def test_a_start_that_fails_waits_for_another_detection(before: TrackerRun) -> None:
    tracker = ScriptedTracker("error", "ok")

    failed = advance(tracker, before, inputs(0))
    same = advance(tracker, failed, inputs(1))
    other = advance(tracker, same, inputs(2, masks=new_masks()))

    assert failed.status is TrackerStatus.LOST
    assert same.status is TrackerStatus.LOST
    assert same.points.stamp == 0.125
    assert other.status is TrackerStatus.TRACKING
    assert len(tracker.calls) == 2


def test_a_new_detection_restarts_a_lost_tracker_where_the_hand_took_the_query(
    before: TrackerRun,
) -> None:
    tracker = ScriptedTracker("ok", "lost", "ok")
    run = advance(tracker, before, inputs(0, motion=shifted(0.5)))
    run = advance(tracker, run, inputs(1, motion=shifted(0.6)))

    advance(tracker, run, inputs(2, masks=new_masks(), motion=shifted(0.8)))

    name, query, _ = tracker.calls[2]
    assert name == "start"
    np.testing.assert_allclose(query, QUERY + np.array([0.3, 0.0, 0.0]), atol=1e-12)


def test_a_new_query_is_used_unchanged(before: TrackerRun) -> None:
    tracker = ScriptedTracker("ok", "lost", "ok")
    run = advance(tracker, before, inputs(0, motion=shifted(0.5)))
    run = advance(tracker, run, inputs(1, motion=shifted(0.6)))
    moved = QUERY + 0.01

    advance(tracker, run, inputs(2, masks=new_masks(), query=moved, motion=shifted(0.8)))

    np.testing.assert_allclose(tracker.calls[2][1], moved, atol=1e-12)


def test_a_new_detection_does_not_disturb_a_tracker_that_tracks(before: TrackerRun) -> None:
    tracker = ScriptedTracker("ok", "ok")
    run = advance(tracker, before, inputs(0))

    advance(tracker, run, inputs(1, masks=new_masks()))

    assert [call[0] for call in tracker.calls] == ["start", "step"]
