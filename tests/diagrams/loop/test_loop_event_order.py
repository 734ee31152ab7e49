"""What each system sees at one instant, in the real closed loop.

At a time t Drake first publishes the results of the step that ends at t. Then, in the step that
begins at t, come unrestricted updates (the tracker), then discrete updates, all of which read what
was before any of them wrote: so each stage of the loop is one control period behind the one before.

Rendered images appear at their delay; the propagator then reports the object's motion at their
capture; one control period later the tracker takes them, with that motion; its points come at the
latency.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context
from short_skill import short_plan, short_scenario
from station_state import GetObjectPose, SetObjectPose

from poil_drake.diagrams.loop.closed_loop import ClosedLoop, MakeClosedLoop
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.systems.cameras.delayed_cameras import DelayedCameras
from poil_drake.systems.capture_and_release import CaptureAndRelease
from poil_drake.systems.detection.part_detector import PartDetector
from poil_drake.systems.fk_propagator import FkPropagator
from poil_drake.systems.ik.differential_ik import DifferentialInverseKinematics
from poil_drake.systems.logging.mcap_logger import McapLogger
from poil_drake.systems.panda.velocity_driver import PandaVelocityDriver
from poil_drake.systems.skill.phases import Phase
from poil_drake.systems.skill.sequencer import SkillSequencer
from poil_drake.systems.skill.state_machine import SkillState
from poil_drake.systems.tracking.ground_truth_tracker import GroundTruthTracker
from poil_drake.systems.tracking.point_tracker import PointTracker

CONTROL, TRACKER, DELAY, LATENCY = 1 / 256, 1 / 8, 7 / 64, 3 / 16
MOVED = 0.5
"""When the object is moved [s], right before a capture: by `JUMP` [m], away from the reference."""
JUMP = np.array([0.0, 0.02, 0.0])
RELEASED = MOVED + LATENCY
"""When the track that shows the jump is released [s]."""
BEFORE = RELEASED - 8 * CONTROL
"""Since the release before that one, all has settled [s]."""


class Event(NamedTuple):
    """An event handler was called; what it saw at its ports."""

    time: float
    name: str
    seen: dict[str, Any]


# System, handler: name of the event, and the input ports whose values are recorded.
WATCHED: dict[tuple[type, str], tuple[str, tuple[str, ...]]] = {
    (DelayedCameras, "_capture"): ("expose", ()),
    (DelayedCameras, "_release"): ("show", ()),
    (PartDetector, "_capture"): ("detect", ("left.image_time",)),
    (PointTracker, "_capture"): ("capture", ("left.image_time",)),
    (PointTracker, "_release"): ("release", ()),
    (GroundTruthTracker, "_capture"): ("capture", ()),
    (GroundTruthTracker, "_release"): ("release", ()),
    (FkPropagator, "_update"): ("propagate", ("tracked_points", "image_time")),
    (DifferentialInverseKinematics, "_update"): ("ik", ("spatial_velocity",)),
    (SkillSequencer, "_update"): ("sequence", ("mean_error",)),
    (PandaVelocityDriver, "_step"): ("driver", ("velocity",)),
    (McapLogger, "_publish_rest"): (
        "log",
        ("tracked_points", "points", "spatial_velocity", "panda.velocity"),
    ),
}


class SilentLog:
    """A fake RunLogWriter that discards everything."""

    def __getattr__(self, name: str) -> Callable[..., None]:
        return lambda *args, **kwargs: None


@pytest.fixture(scope="module")
def events() -> list[Event]:
    """What happened in a loop that follows its field, whose object jumps at `MOVED`."""
    with recording() as recorded:
        _simulate(MakeClosedLoop(short_scenario(), short_plan(), log=SilentLog()))
    return recorded


@pytest.fixture(scope="module")
def rendered_events() -> list[Event]:
    """What happened in the first half second of a loop with cameras."""
    with recording() as recorded, MakeClosedLoop(ChooseScenario(), short_plan()) as loop:
        Simulator(loop.diagram).AdvanceTo(0.5)
    return recorded


@contextmanager
def recording() -> Iterator[list[Event]]:
    """Yields a list to which the events of `WATCHED` are appended."""
    recorded: list[Event] = []

    def watch(owner: type, method: str) -> None:
        handler = getattr(owner, method)

        def record(self: Any, context: Context, *state: Any) -> None:
            system = self._system if owner is CaptureAndRelease else self
            name, ports = WATCHED[type(system), method]
            seen = {}
            for port in map(system.GetInputPort, ports):
                if port.HasValue(context):
                    value = port.Eval(context)
                    seen[port.get_name()] = value.copy() if isinstance(value, np.ndarray) else value
            recorded.append(Event(context.get_time(), name, seen))
            handler(self, context, *state)

        patch.setattr(owner, method, record)

    with pytest.MonkeyPatch.context() as patch:
        captures = ("_capture", "_release")
        for owner, method in {
            (CaptureAndRelease if method in captures else system, method)
            for system, method in WATCHED
        }:
            watch(owner, method)
        yield recorded


def _simulate(loop: ClosedLoop) -> None:
    simulator = Simulator(loop.diagram)
    root = simulator.get_mutable_context()
    # The field leads at once, though nothing is held, so that every stage of the loop takes part.
    sequencer = loop.sequencer.GetMyMutableContextFromRoot(root)
    sequencer.SetDiscreteState(np.array(SkillState(phase=Phase.FOLLOW, width=0.0)))
    simulator.AdvanceTo(MOVED)
    station = loop.station.GetMyMutableContextFromRoot(root)
    X_WO = GetObjectPose(loop.station, station)
    moved = RigidTransform(X_WO.rotation(), X_WO.translation() + JUMP)
    SetObjectPose(loop.station, station, moved)
    simulator.AdvanceTo(RELEASED + 8 * CONTROL)


def at(events: list[Event], time: float) -> list[Event]:
    return [event for event in events if event.time == time]


def times_of(events: list[Event], name: str) -> list[float]:
    return [event.time for event in events if event.name == name]


def seen_by(events: list[Event], name: str, port: str) -> dict[float, Any]:
    """Returns what a system saw at a port, by time."""
    return {event.time: event.seen[port] for event in events if event.name == name}


def first_jump(values: dict[float, np.ndarray], *, after: float) -> float:
    """Returns when a signal first changed much more than it did in the ticks before."""
    times = sorted(t for t in values if t >= after)
    steps = [np.abs(values[b] - values[a]).max() for a, b in pairwise(times)]
    usual = max(steps[: len(steps) // 4])
    return next(t for t, step in zip(times[1:], steps, strict=True) if step > 3.0 * usual + 1e-6)


def changes(values: dict[float, np.ndarray]) -> dict[float, np.ndarray]:
    """Returns how much a signal has changed since the tick before, by time."""
    times = sorted(values)
    return {b: values[b] - values[a] for a, b in pairwise(times)}


def test_an_instant_is_published_then_tracked_then_controlled(events: list[Event]) -> None:
    # Both a capture's and a release's instant; the logger's, too.
    for time, tracking in ((TRACKER, "capture"), (TRACKER + LATENCY, "release")):
        order = [event.name for event in at(events, time)]
        assert order[:2] == ["log", tracking]
        assert set(order[2:]) == {"propagate", "ik", "sequence", "driver"}


def test_captures_and_releases_take_turns_at_their_times(events: list[Event]) -> None:
    assert times_of(events, "capture") == [k * TRACKER for k in range(6)]
    assert times_of(events, "release") == [k * TRACKER + LATENCY for k in range(5)]


@pytest.mark.render
def test_images_and_their_tracks_are_released_at_their_times(rendered_events: list[Event]) -> None:
    assert times_of(rendered_events, "expose") == [k * TRACKER for k in range(4)]
    assert times_of(rendered_events, "show") == [k * TRACKER + DELAY for k in range(4)]
    assert times_of(rendered_events, "release") == [k * TRACKER + LATENCY for k in range(3)]


@pytest.mark.render
@pytest.mark.parametrize("name", ["capture", "detect"])
def test_tracker_and_detector_read_images_one_period_after_their_release(
    rendered_events: list[Event], name: str
) -> None:
    assert seen_by(rendered_events, name, "left.image_time") == {
        k * TRACKER + DELAY + CONTROL: k * TRACKER for k in range(4)
    }


@pytest.mark.render
def test_the_propagator_knows_of_the_images_before_the_tracker(
    rendered_events: list[Event],
) -> None:
    image_times = seen_by(rendered_events, "propagate", "image_time")

    np.testing.assert_equal(image_times[DELAY - CONTROL], [np.nan])
    assert image_times[DELAY] == 0.0
    assert image_times[TRACKER + DELAY - CONTROL] == 0.0
    assert image_times[TRACKER + DELAY] == TRACKER


@pytest.mark.parametrize(
    "loop", ["events", pytest.param("rendered_events", marks=pytest.mark.render)]
)
def test_the_propagator_sees_a_track_at_the_instant_of_its_release(
    loop: str, request: pytest.FixtureRequest
) -> None:
    tracks = seen_by(request.getfixturevalue(loop), "propagate", "tracked_points")

    stamps = {time: track.stamp for time, track in tracks.items()}
    assert stamps[LATENCY - CONTROL] == -np.inf
    assert stamps[LATENCY] == stamps[TRACKER + LATENCY - CONTROL] == 0.0
    assert stamps[TRACKER + LATENCY] == TRACKER


def test_the_capture_sees_the_object_as_it_is_at_that_instant(events: list[Event]) -> None:
    tracks = seen_by(events, "propagate", "tracked_points")

    rise = tracks[RELEASED].positions - tracks[RELEASED - CONTROL].positions
    np.testing.assert_allclose(rise, np.tile(JUMP, (3, 1)), atol=1e-4)


def test_the_log_shows_what_was_before_the_updates_at_its_time(events: list[Event]) -> None:
    stamps = {t: track.stamp for t, track in seen_by(events, "log", "tracked_points").items()}
    points = seen_by(events, "log", "points")

    # The logger comes every 1/32 s: at the release it shows the track before.
    assert stamps[RELEASED] == MOVED - TRACKER
    assert stamps[RELEASED + 1 / 32] == MOVED
    assert np.abs(points[RELEASED] - points[RELEASED - 1 / 32]).max() < 0.5 * JUMP[1]
    assert np.abs(points[RELEASED + 1 / 32] - points[RELEASED]).max() > 0.5 * JUMP[1]


def test_the_field_reaches_the_arm_three_control_periods_after_the_release(
    events: list[Event],
) -> None:
    twists = seen_by(events, "ik", "spatial_velocity")
    commands = seen_by(events, "driver", "velocity")

    # The propagator writes at the release; the inverse kinematics reads that one period later,
    # what it then writes the supervisor reads another period later, and the driver a third. As the
    # arm's acceleration is limited, its commands do not jump, but their changes do.
    assert first_jump(twists, after=BEFORE) == RELEASED + CONTROL
    assert first_jump(changes(commands), after=BEFORE) == RELEASED + 3 * CONTROL


def test_the_sequencer_sees_the_error_when_the_inverse_kinematics_sees_the_twist(
    events: list[Event],
) -> None:
    errors = seen_by(events, "sequence", "mean_error")

    assert first_jump(errors, after=BEFORE) == RELEASED + CONTROL
