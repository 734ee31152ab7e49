import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from replay_comparisons import TOLERANCES as SHARED_TOLERANCES

from poil_drake.errors import InvalidValueError
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.recording.comparison.run_comparison import (
    PHASE,
    TRACKS,
    DifferenceStatistics,
    compare_runs,
)
from poil_drake.recording.comparison.tolerances import (
    ANGULAR_VELOCITY,
    CONTROL_TOLERANCES,
    JOINT_VELOCITY,
    LINEAR_VELOCITY,
    PERCEPTION_TOLERANCES,
    TRACKED_POINTS,
)
from poil_drake.recording.run_log.recorded_run import LoggedTrack, PhaseStart, RecordedRun, Series

TOLERANCES = dataclasses.replace(SHARED_TOLERANCES, unmatched_tracks=0.3)
TIMES = [0.0, 0.25, 0.5, 0.75]


def make_run(
    *,
    commands=((0.0, 0.0),) * 4,
    twists=((0.0,) * 6,) * 4,
    phases=((0.0, "wait"), (0.5, "follow")),
    tracks=(),
    times=TIMES,
):
    return RecordedRun(
        Path("run.mcap"),
        ("j1", "j2"),
        joints=Series.of([(time, [0.0] * 6) for time in times], 6),
        commands=Series.of(list(zip(times, commands, strict=True)), 2),
        twist=Series.of(list(zip(times, twists, strict=True)), 6),
        phases=[PhaseStart(time, name, "") for time, name in phases],
        tracks=list(tracks),
    )


def make_track(stamp, positions):
    positions = np.array(positions, dtype=float)
    seen = np.isfinite(positions).all(axis=1).astype(float)
    return LoggedTrack(stamp + 0.1, TrackedPoints(positions, seen, stamp))


def compare(recorded, replayed):
    return compare_runs(recorded, replayed, TOLERANCES)


def test_a_run_is_the_same_as_itself():
    run = make_run(tracks=[make_track(0.125, np.eye(3))])

    dut = compare(run, run)

    assert (dut.same, dut.phases_agree, dut.first) == (True, True, None)
    assert all(dut.statistics(signal).maximum == 0.0 for signal in dut.differences)


def test_the_largest_difference_of_the_joints_counts():
    other = make_run(commands=[(0.0, 0.0), (0.05, -0.2), (0.0, 0.0), (0.0, 0.0)])

    dut = compare(make_run(), other)

    np.testing.assert_allclose(dut.differences[JOINT_VELOCITY].values[:, 0], [0.0, 0.2, 0.0, 0.0])
    assert not dut.same
    assert (dut.first.time, dut.first.what, dut.first.phase) == (0.25, JOINT_VELOCITY, "wait")
    assert dut.first.size == pytest.approx(0.2)


def test_angular_and_linear_velocities_are_compared_by_length():
    twist = [0.03, 0.04, 0.0, 0.0, 0.06, 0.08]

    dut = compare(make_run(), make_run(twists=[twist, [0.0] * 6, [0.0] * 6, [0.0] * 6]))

    assert dut.statistics(ANGULAR_VELOCITY).maximum == pytest.approx(0.05)
    assert dut.statistics(LINEAR_VELOCITY).maximum == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("times", "commands", "count"),
    [([0.1, 0.5], [(9.0, 9.0), (0.0, 0.0)], 1), ([], [], 0)],
)
def test_runs_are_the_same_if_they_agree_at_common_times(times, commands, count):
    other = make_run(commands=commands, twists=[[0.0] * 6] * len(times), times=times)

    dut = compare(make_run(), other)

    assert dut.statistics(JOINT_VELOCITY).count == count
    assert dut.same is (count > 0)


@pytest.mark.parametrize(
    ("ours", "theirs", "size"),
    [(math.nan, math.nan, 0.0), (math.nan, 0.0, math.inf), (0.0, math.nan, math.inf)],
)
def test_a_value_that_only_one_run_knows_is_a_difference(ours, theirs, size):
    runs = [make_run(commands=[(value, 0.0), *[(0.0, 0.0)] * 3]) for value in (ours, theirs)]

    dut = compare(*runs)

    assert dut.differences[JOINT_VELOCITY].values[0, 0] == size
    assert dut.same is (size == 0.0)


def test_tracks_are_paired_by_their_stamps():
    nowhere = [np.nan] * 3
    ours = [
        make_track(0.125, [[0, 0, 0], [1, 0, 0], [0, 1, 0]]),
        make_track(0.25, [[0, 0, 0], [1, 0, 0], nowhere]),
        make_track(0.5, np.eye(3)),
    ]
    others = [
        make_track(0.125, [[0, 0, 0.0005], [1, 0, 0], [0, 1, 0]]),
        make_track(0.25, [[0, 0, 0], nowhere, [0, 1, 0]]),
        make_track(0.625, np.eye(3)),
    ]

    dut = compare(make_run(tracks=ours), make_run(tracks=others))

    distances = dut.differences[TRACKED_POINTS]
    np.testing.assert_allclose(distances.values[:, 0], [0.0005, 0.0])
    np.testing.assert_allclose(distances.times, [0.225, 0.35])
    # Half a millimetre is within the tolerance; from 0.5 s on, points move nothing.
    assert dut.same
    assert (dut.tracks.unmatched, dut.tracks.visibility, dut.tracks.points) == (2, 2, 6)


def seen_track(stamp, *seen):
    """A track of three points, of which some are seen."""
    return make_track(stamp, np.where(np.isin(range(3), seen)[:, None], np.eye(3), np.nan))


@pytest.mark.parametrize(
    ("ours", "theirs", "share"),
    [
        # One of three tracks may be missing; points move the arm during all of them.
        ([(0, 1, 2)] * 3, [(0, 1, 2)] * 2, 0.0),
        ([(0, 1, 2)] * 3, [(0, 1, 2)], 2 / 3),
        ([(0, 1, 2)], [(0, 1, 2)] * 3, 2 / 3),
        ([(0, 1)] * 3, [(1, 2)] * 3, 0.0),
        ([(0, 1)] * 3, [(2,)] * 3, 1.0),
        ([(0, 1)] * 3, [()] * 3, 1.0),
        ([()] * 3, [()] * 3, 0.0),
    ],
)
def test_tracks_that_cannot_be_compared_count(ours, theirs, share):
    runs = [
        make_run(tracks=[seen_track(k / 16, *seen) for k, seen in enumerate(tracks)])
        for tracks in (ours, theirs)
    ]
    tolerances = dataclasses.replace(TOLERANCES, unmatched_tracks=0.4)

    dut = compare_runs(*runs, tolerances)

    assert dut.same is (share == 0.0)
    if share:
        assert (dut.first.what, dut.first.phase) == (TRACKS, "wait")
        assert dut.first.size == pytest.approx(share)


def test_tracks_of_other_points_differ():
    runs = [make_run(tracks=[make_track(0.125, points)]) for points in (np.eye(3), np.eye(4, 3))]

    assert not compare(*runs).same


def test_statistics_by_the_phases_of_the_run():
    commands = [(0.0, 0.0), (0.01, 0.0), (0.02, 0.0), (0.03, 0.0)]

    by_phase = compare(make_run(), make_run(commands=commands)).statistics_by_phase(JOINT_VELOCITY)

    assert {name: found.count for name, found in by_phase.items()} == {"wait": 2, "follow": 2}
    assert by_phase["wait"].maximum == pytest.approx(0.01)
    assert by_phase["follow"].median == pytest.approx(0.03)


@pytest.mark.parametrize(
    ("ours", "theirs", "agree"),
    [
        ([(0.5, "follow")], [(0.505, "follow")], True),
        ([(0.5, "follow")], [(0.52, "follow")], False),
        # The other run may have ended just before.
        ([(0.745, "follow")], [], True),
        ([], [(0.745, "follow")], True),
        ([(0.7, "follow")], [], False),
        ([], [(0.7, "follow")], False),
        ([(0.745, "follow")], [(0.75, "fault")], False),
    ],
)
def test_phases_agree_if_they_begin_at_about_the_same_time(ours, theirs, agree):
    runs = [make_run(phases=[(0.0, "wait"), *phases]) for phases in (ours, theirs)]

    dut = compare(*runs)

    assert (dut.phases_agree, dut.same) == (agree, agree)


def test_a_phase_that_only_one_run_has_is_the_first_difference():
    dut = compare(make_run(), make_run(phases=[(0.0, "wait"), (0.25, "fault")]))

    assert [phase.name for phase in dut.phases] == ["wait", "follow", "fault"]
    assert (dut.first.time, dut.first.what, dut.first.phase) == (0.25, PHASE, "wait")
    assert dut.first.began is dut.phases[2]


@pytest.mark.parametrize(
    ("values", "count", "median", "maximum"),
    [
        # Percentiles are samples.
        ([0.0, 0.0, 1.0, np.inf, np.nan], 4, 1.0, np.inf),
        ([np.nan], 0, np.nan, np.nan),
    ],
)
def test_statistics_leave_out_what_is_unknown(values, count, median, maximum):
    found = DifferenceStatistics.of(np.array(values))

    assert found.count == count
    np.testing.assert_array_equal([found.median, found.maximum], [median, maximum])


@pytest.mark.parametrize(("stamp", "same"), [(0.125, False), (0.5, True)])
def test_points_are_judged_while_they_move_the_arm(stamp, same):
    ours, others = (make_track(stamp, shift + np.eye(3)) for shift in (0.0, 0.01))

    dut = compare(make_run(tracks=[ours]), make_run(tracks=[others]))

    assert dut.same is same
    assert dut.statistics(TRACKED_POINTS).maximum == pytest.approx(0.01 * 3**0.5)


PHASES = ((0.0, "wait"), (0.25, "approach"), (0.5, "follow"))
SPEED = 0.2  # The usual speed on hardware.


def moving(*, speed=0.04, **options):
    """A run at a fifth of the usual speed, whose joints and gripper move from 0.25 s on."""
    moves = [0.0, 1.0, 1.0, 1.0]
    return make_run(
        commands=[(speed * move, 0.0) for move in moves],
        twists=[[0.0] * 3 + [speed * move, 0.0, 0.0] for move in moves],
        phases=PHASES,
        **options,
    )


@pytest.mark.parametrize("tolerances", [PERCEPTION_TOLERANCES, CONTROL_TOLERANCES])
def test_a_replay_that_commands_nothing_differs_from_a_slow_run(tolerances):
    dut = compare_runs(moving(), moving(speed=0.0), tolerances.at_speed(SPEED))

    assert not dut.same
    # The joints of an approach must move as they did at any speed.
    assert (dut.first.time, dut.first.phase) == (0.25, "approach")


def test_a_replay_that_commands_nothing_while_points_move_the_arm_differs_from_a_slow_run():
    still = moving()
    still.twist.values[2:] = 0.0

    dut = compare_runs(moving(), still, PERCEPTION_TOLERANCES.at_speed(SPEED))

    # 4 cm/s would be less than the 5 cm/s of the usual speed.
    assert (dut.first.time, dut.first.what) == (0.5, LINEAR_VELOCITY)
    assert dut.first.tolerance == pytest.approx(0.01)


def jumping(at, *, count, phases):
    """A run with a sample every 30 ms, whose first joint moves from sample `at` on."""
    return make_run(
        times=(0.03 * np.arange(count)).tolist(),
        commands=[(0.3 * (k >= at), 0.0) for k in range(count)],
        twists=[(0.0,) * 6] * count,
        phases=phases,
    )


@pytest.mark.parametrize(
    ("phase", "late", "same"), [("follow", 1, True), ("follow", 2, False), ("approach", 1, False)]
)
def test_velocities_may_come_later_only_while_points_move_the_arm(phase, late, same):
    tolerances = PERCEPTION_TOLERANCES.at_speed(SPEED)  # 0.05 s
    runs = [jumping(3 + by, count=8, phases=[(0.0, phase)]) for by in (0, late)]

    dut = compare_runs(*runs, tolerances)

    assert dut.same is same
    # The statistics are of the differences without a shift.
    assert dut.statistics(JOINT_VELOCITY).maximum == pytest.approx(0.3)
    assert dut.judged[JOINT_VELOCITY].values.max() == pytest.approx(0.0 if same else 0.3)
    if phase == "follow":
        assert dut.judged_maximum(JOINT_VELOCITY) == pytest.approx(0.0 if same else 0.3)


@pytest.mark.parametrize(("until", "same"), [(0.3, True), (0.05, False)])
def test_velocities_may_come_later_for_a_while_after_points_moved_the_arm(until, same):
    # At 0.45 s, the points let go 0.15 s or 0.4 s ago; for 0.25 s their effect fades.
    tolerances = dataclasses.replace(PERCEPTION_TOLERANCES.at_speed(SPEED), elsewhere=TOLERANCES)
    phases = [(0.0, "follow"), (until, "retreat")]
    runs = [jumping(at, count=20, phases=phases) for at in (15, 16)]

    assert compare_runs(*runs, tolerances).same is same


@pytest.mark.parametrize("shift", [-0.01, math.nan, math.inf])
def test_a_shift_must_be_a_time(shift):
    with pytest.raises(InvalidValueError, match="shift is"):
        dataclasses.replace(PERCEPTION_TOLERANCES, shift=shift)


def test_a_peak_that_only_one_has_is_not_late():
    still, peak = (jumping(9, count=4, phases=[(0.0, "follow")]) for _ in range(2))
    peak.commands.values[1, 1] = -0.06

    for pair in ((still, peak), (peak, still)):
        dut = compare_runs(*pair, PERCEPTION_TOLERANCES.at_speed(SPEED))
        assert (dut.first.time, dut.first.size) == (0.03, pytest.approx(0.06))


@pytest.mark.parametrize(("speed", "shift"), [(1.0, 0.01), (0.2, 0.05), (0.01, 0.25)])
def test_the_shift_is_larger_in_a_slow_run(speed, shift):
    assert PERCEPTION_TOLERANCES.at_speed(speed).shift == pytest.approx(shift)


def test_velocities_may_differ_where_a_phase_began_a_little_later():
    later = moving()
    later.commands.values[1] = 0.0
    later.phases[1] = later.phases[1]._replace(time=0.255)

    assert compare_runs(moving(), later, PERCEPTION_TOLERANCES.at_speed(SPEED)).same


def test_the_effect_of_points_fades_after_they_moved_the_arm():
    phases = [(0.0, "follow"), (0.25, "release")]
    commands = [(0.0, 0.0), (0.2, 0.0), (0.0, 0.0), (0.2, 0.0)]
    other = make_run(phases=phases, commands=commands)

    dut = compare_runs(make_run(phases=phases), other, PERCEPTION_TOLERANCES)

    # The tolerance is 0.25 rad/s for a quarter of a second after the points let go.
    assert (dut.first.time, dut.first.phase) == (0.75, "release")
