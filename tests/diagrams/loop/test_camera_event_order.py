"""What each system sees at one instant between cameras and propagator, on rendered images.

Images appear at their delay; the propagator then reports the object's motion at their capture;
one control period later the tracker takes them, with that motion; its points come at the latency.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, LeafSystem
from short_skill import short_plan

from poil_drake.diagrams.loop.closed_loop import MakeClosedLoop
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.systems.cameras.delayed_cameras import DelayedCameras
from poil_drake.systems.capture_and_release import CaptureAndRelease
from poil_drake.systems.detection.part_detector import PartDetector
from poil_drake.systems.fk_propagator import FkPropagator
from poil_drake.systems.tracking.point_tracker import PointTracker

pytestmark = pytest.mark.render

CONTROL, TRACKER, DELAY, LATENCY = 1 / 256, 1 / 8, 3 / 32, 3 / 16
LOOK = DELAY + CONTROL


class Event(NamedTuple):
    """An event handler was called; the image time, or the stamp, that it saw at a port."""

    time: float
    name: str
    seen: float


# System, handler, and the input port whose value is recorded.
WATCHED = {
    (DelayedCameras, "_capture"): ("expose", ""),
    (DelayedCameras, "_release"): ("show", ""),
    (PartDetector, "_capture"): ("detect", "left.image_time"),
    (PointTracker, "_capture"): ("look", "left.image_time"),
    (PointTracker, "_release"): ("release", ""),
    (FkPropagator, "_update"): ("propagate", "tracked_points"),
}


@pytest.fixture(scope="module")
def events() -> list[Event]:
    """What happened in the first half second of a loop."""
    recorded: list[Event] = []
    with pytest.MonkeyPatch.context() as patch:
        for owner, method in (
            (CaptureAndRelease, "_capture"),
            (CaptureAndRelease, "_release"),
            (FkPropagator, "_update"),
        ):
            patch.setattr(owner, method, _record(recorded, owner, method))
        loop = MakeClosedLoop(ChooseScenario(), short_plan())
        Simulator(loop.diagram).AdvanceTo(0.5)
        loop.Close()
    return recorded


def _record(recorded: list[Event], owner: type, method: str) -> Callable[..., None]:
    handler = getattr(owner, method)

    def seen_at(system: LeafSystem, port: str, context: Context) -> float:
        value = system.GetInputPort(port).Eval(context) if port else np.array([np.nan])
        return float(value[0] if isinstance(value, np.ndarray) else value.stamp)

    def record(self: Any, context: Context, state: Any) -> None:
        system = self._system if owner is CaptureAndRelease else self
        name, port = WATCHED[type(system), method]
        recorded.append(Event(context.get_time(), name, seen_at(system, port, context)))
        if name == "propagate":
            recorded.append(Event(context.get_time(), "move", seen_at(self, "image_time", context)))
        handler(self, context, state)

    return record


def times(events: list[Event], name: str) -> list[float]:
    return [event.time for event in events if event.name == name]


def seen_by(events: list[Event], name: str) -> dict[float, float]:
    return {event.time: event.seen for event in events if event.name == name}


def test_images_and_tracks_are_released_at_their_times(events: list[Event]) -> None:
    assert times(events, "expose") == [k * TRACKER for k in range(4)]
    assert times(events, "show") == [k * TRACKER + DELAY for k in range(4)]
    assert times(events, "release") == [k * TRACKER + LATENCY for k in range(3)]


def test_tracker_and_detector_read_images_one_period_after_their_release(
    events: list[Event],
) -> None:
    for name in ("look", "detect"):
        assert seen_by(events, name) == {k * TRACKER + LOOK: k * TRACKER for k in range(4)}


def test_the_propagator_knows_of_the_images_before_the_tracker(events: list[Event]) -> None:
    image_times = seen_by(events, "move")

    np.testing.assert_equal(image_times[DELAY - CONTROL], np.nan)
    assert image_times[DELAY] == 0.0
    assert image_times[TRACKER + DELAY - CONTROL] == 0.0
    assert image_times[TRACKER + DELAY] == TRACKER


def test_the_propagator_sees_a_track_at_the_instant_of_its_release(events: list[Event]) -> None:
    stamps = seen_by(events, "propagate")

    assert stamps[LATENCY - CONTROL] == -np.inf
    assert stamps[LATENCY] == 0.0
    assert stamps[TRACKER + LATENCY - CONTROL] == 0.0
    assert stamps[TRACKER + LATENCY] == TRACKER
