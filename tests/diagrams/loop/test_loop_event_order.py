"""What each system sees at one instant, in the real closed loop.

At a time t Drake first publishes the results of the step that ends at t. Then, in the step that
begins at t, come unrestricted updates (the tracker), then discrete updates, all of which read what
was before any of them wrote: so each stage of the loop is one control period behind the one before.
"""

from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, LeafSystem
from short_skill import short_plan, short_scenario
from station_state import GetObjectPose, SetObjectPose

from poil_drake.diagrams.loop.closed_loop import ClosedLoop, MakeClosedLoop
from poil_drake.systems.capture_and_release import CaptureAndRelease
from poil_drake.systems.fk_propagator import FkPropagator
from poil_drake.systems.ik.differential_ik import DifferentialInverseKinematics
from poil_drake.systems.logging.mcap_logger import McapLogger
from poil_drake.systems.panda.velocity_driver import PandaVelocityDriver
from poil_drake.systems.skill.phases import Phase
from poil_drake.systems.skill.sequencer import SkillSequencer
from poil_drake.systems.skill.state_machine import SkillState

CONTROL, TRACKER, LATENCY = 1 / 256, 1 / 8, 3 / 16
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


WATCHED: dict[str, tuple[type, str, tuple[str, ...]]] = {
    # Of the tracker, the only system of the loop that captures.
    "capture": (CaptureAndRelease, "_capture", ()),
    "release": (CaptureAndRelease, "_release", ()),
    "propagate": (FkPropagator, "_update", ("tracked_points",)),
    "ik": (DifferentialInverseKinematics, "_update", ("spatial_velocity",)),
    "sequence": (SkillSequencer, "_update", ("mean_error",)),
    "driver": (PandaVelocityDriver, "_step", ("velocity",)),
    "log": (
        McapLogger,
        "_publish_rest",
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
    recorded: list[Event] = []
    with pytest.MonkeyPatch.context() as patch:
        for name, (system, method, ports) in WATCHED.items():
            patch.setattr(system, method, _record(recorded, name, getattr(system, method), ports))
        loop = MakeClosedLoop(short_scenario(), short_plan(), log=SilentLog())
        _simulate(loop)
    return recorded


def _record(
    recorded: list[Event], name: str, handler: Callable[..., None], ports: tuple[str, ...]
) -> Callable[..., None]:
    def record(self: LeafSystem, context: Context, *state: Any) -> None:
        seen = {}
        for port in ports:
            value = self.GetInputPort(port).Eval(context)
            seen[port] = value.copy() if isinstance(value, np.ndarray) else value
        recorded.append(Event(context.get_time(), name, seen))
        handler(self, context, *state)

    return record


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
    captures = [event.time for event in events if event.name == "capture"]
    releases = [event.time for event in events if event.name == "release"]

    assert captures == [k * TRACKER for k in range(6)]
    assert releases == [k * TRACKER + LATENCY for k in range(5)]


def test_the_propagator_sees_a_track_at_the_instant_of_its_release(events: list[Event]) -> None:
    stamps = {t: track.stamp for t, track in seen_by(events, "propagate", "tracked_points").items()}

    assert stamps[RELEASED - CONTROL] == MOVED - TRACKER
    assert stamps[RELEASED] == MOVED


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
