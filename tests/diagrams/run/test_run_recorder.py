"""Samples of the real closed loop, without images."""

import dataclasses

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context
from short_skill import POINTS, short_plan, short_scenario
from station_state import GetObjectPose, SetObjectPose

from poil_drake.diagrams.loop.closed_loop import ClosedLoop, MakeClosedLoop
from poil_drake.diagrams.run.recorder import CheckedTrack, RunRecorder, Sample, TrackingLosses
from poil_drake.diagrams.run.task_success import SimulatedTruth
from poil_drake.diagrams.station.station import SimulatedStation
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.systems.skill.phases import Fault, Phase
from poil_drake.systems.skill.state_machine import SkillState
from poil_drake.systems.statuses import TrackerStatus

PERIOD = 1 / 32


@pytest.fixture(scope="module")
def loop() -> ClosedLoop:
    return MakeClosedLoop(short_scenario(), short_plan())


@pytest.fixture
def simulator(loop: ClosedLoop) -> Simulator:
    return Simulator(loop.diagram)


@pytest.fixture
def dut(loop: ClosedLoop) -> RunRecorder:
    assert isinstance(loop.station, SimulatedStation)
    return RunRecorder(loop=loop, query_points=POINTS, truth=SimulatedTruth(loop.station))


def run(dut: RunRecorder, simulator: Simulator, *, until: float) -> Context:
    """Samples at the start and after each period, as a run does."""
    root = simulator.get_mutable_context()
    if not dut.times:
        simulator.Initialize()
        dut.sample(root)
    while root.get_time() < until:
        simulator.AdvanceTo(root.get_time() + PERIOD)
        dut.sample(root)
    return root


def test_each_signal_has_a_row_for_each_sample(dut: RunRecorder, simulator: Simulator) -> None:
    run(dut, simulator, until=0.25)

    assert dut.times == [k * PERIOD for k in range(9)]
    assert dut.signal("points").shape == (9, 9)
    assert dut.signal("joint_velocities").shape == (9, 7)
    # Scalars have an entry instead of a row.
    assert dut.signal("phase").shape == (9,)
    # The points are unknown before the first track is released, at 3/16 s.
    assert np.isnan(dut.signal("points")[:7]).all()
    assert np.isfinite(dut.signal("points")[7:]).all()


def test_lost_tracks_are_counted_until_the_release(dut: RunRecorder) -> None:
    lost, tracking = TrackerStatus.LOST, TrackerStatus.TRACKING
    statuses = [TrackerStatus.WAITING, tracking, lost, lost, tracking, lost, tracking, lost]
    phases = [Phase.WAIT, *[Phase.FOLLOW] * 6, Phase.RELEASE]
    for k, (status, phase) in enumerate(zip(statuses, phases, strict=True)):
        values = {"tracker_status": status, "phase": phase, "detect_request": min(k, 2)}
        sampled = {name: np.array([float(value)]) for name, value in values.items()}
        dut.samples.append(Sample(0.25 * k, sampled))

    # Samples 2, 3 and 5; the last is after the release.
    assert dut.tracking_losses() == TrackingLosses(losses=2, duration=0.75, searches=2)


def test_later_motion_does_not_change_samples(dut: RunRecorder, simulator: Simulator) -> None:
    root = run(dut, simulator, until=0.25)
    before = dut.signal("points").copy()
    _move_object(dut, root)

    run(dut, simulator, until=0.5)

    np.testing.assert_array_equal(dut.signal("points")[: len(before)], before)


def test_an_interrupt_during_a_sample_leaves_a_consistent_record(
    dut: RunRecorder, simulator: Simulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = run(dut, simulator, until=0.125)
    evaluated = []

    def stop_at_the_fifth(root: Context, system: str, port: str) -> np.ndarray:
        evaluated.append(port)
        if len(evaluated) == 5:
            raise KeyboardInterrupt
        return np.zeros(1)

    monkeypatch.setattr(dut, "_evaluate", stop_at_the_fifth)
    with pytest.raises(KeyboardInterrupt):
        dut.sample(root)

    lengths = {len(dut.signal(name)) for name in ("points", "tau", "phase")}
    assert lengths == {len(dut.times)} == {5}


def test_each_track_is_compared_once_with_the_truth_at_its_capture(
    dut: RunRecorder, simulator: Simulator
) -> None:
    root = run(dut, simulator, until=0.25)
    _move_object(dut, root)

    run(dut, simulator, until=0.625)

    stamps, errors = dut.tracking_errors()
    assert stamps.tolist() == [0.0, 0.125, 0.25, 0.375]
    assert errors.shape == (4, 3)
    # The object was moved by 50 mm between the sample at 1/4 s and the image at that time.
    assert errors[2] == pytest.approx(0.05, abs=1e-4)
    assert errors[[0, 1, 3]].max() < 1e-9


def test_points_that_were_not_observed_have_no_error(
    dut: RunRecorder, simulator: Simulator
) -> None:
    run(dut, simulator, until=0.25)
    ((track, truth),) = dut.tracks
    half_lost = TrackedPoints(
        np.vstack([track.positions[:2], np.full((1, 3), np.nan)]), np.array([1.0, 1.0, 0.0]), 0.0
    )
    dut = dataclasses.replace(dut, tracks=[CheckedTrack(half_lost, truth)])

    _, errors = dut.tracking_errors()

    assert np.isfinite(errors[0, :2]).all()
    assert np.isnan(errors[0, 2])


def test_before_the_first_track_there_are_no_errors(dut: RunRecorder, simulator: Simulator) -> None:
    run(dut, simulator, until=PERIOD)

    stamps, errors = dut.tracking_errors()

    assert (stamps.shape, errors.shape) == ((0,), (0, 3))


def test_phase_and_fault_are_those_of_the_sequencer(dut: RunRecorder, simulator: Simulator) -> None:
    root = run(dut, simulator, until=PERIOD)
    assert (dut.phase, dut.fault(root)) == (Phase.WAIT, Fault.NONE)

    _put_in_phase(dut, root, phase=Phase.FAULT, fault=Fault.IK_STUCK)
    run(dut, simulator, until=2 * PERIOD)

    assert (dut.phase, dut.fault(root)) == (Phase.FAULT, Fault.IK_STUCK)


def test_the_judge_observes_contacts_from_the_release_on(
    dut: RunRecorder, simulator: Simulator
) -> None:
    root = run(dut, simulator, until=0.25)
    assert dut.judge.last_touched == frozenset()

    _put_in_phase(dut, root, phase=Phase.SETTLE, start=0.25)
    run(dut, simulator, until=0.3125)

    assert dut.judge.touched_links == {"table::table"}


def _move_object(dut: RunRecorder, root: Context) -> None:
    """Moves the object by 50 mm along x, at rest."""
    station = dut.loop.station.GetMyMutableContextFromRoot(root)
    X_WO = GetObjectPose(dut.loop.station, station)
    there = X_WO.translation() + np.array([0.05, 0.0, 0.0])
    SetObjectPose(dut.loop.station, station, RigidTransform(X_WO.rotation(), there))


def _put_in_phase(
    dut: RunRecorder, root: Context, *, phase: Phase, fault: Fault = Fault.NONE, start: float = 0.0
) -> None:
    state = SkillState(phase=phase, phase_start=start, fault=fault, width=0.04)
    sequencer = dut.loop.sequencer.GetMyMutableContextFromRoot(root)
    sequencer.SetDiscreteState(np.array(state))
