import json

import pytest
from replay_comparisons import make_run, make_summary

from poil_drake.recording.run_log.recorded_run import PhaseStart, Series


def test_the_closing_line_sums_up_a_replay_without_differences():
    dut = make_summary(make_run(), make_run(speed=0.52, shift=0.0005), notes=["the log is cut off"])

    assert dut.same
    # 33 of 65 samples are of the faster motion. The shift of 0.5 mm is along all three axes.
    assert dut.closing_line() == (
        "SAME: the same 2 phases; "
        "joint velocities differ by 0.02 rad/s (median), 0.02 rad/s (max); "
        "tracked points differ by 0.87 mm (median), 0.87 mm (max); "
        "0 of 12 tracks and 0 of 36 points occur only in the run or only in the replay; "
        "the log is cut off; "
        "2.0 s replayed in 0.2 s."
    )


@pytest.mark.parametrize(
    ("replay", "reason"),
    [
        (
            {"speed": 0.75},
            "from 1.00 s on, in phase 'follow', joint velocities differ by more than 0.1 rad/s",
        ),
        (
            {"shift": 0.002},
            "from 0.20 s on, in phase 'wait', tracked points differ by more than 1 mm",
        ),
        (
            {"last": "fault"},
            "from 1.00 s on, in phase 'follow', the phases differ: 'follow' began in the run only",
        ),
    ],
)
def test_the_reason_names_the_first_difference(replay, reason):
    dut = make_summary(make_run(), make_run(**replay))

    assert not dut.same
    assert dut.reason == reason


def test_of_phases_that_begin_at_the_same_time_the_one_that_differs_is_named():
    replayed = make_run()
    replayed.phases[1] = replayed.phases[1]._replace(time=1.0)
    replayed.phases.append(PhaseStart(1.0, "fault", ""))

    dut = make_summary(make_run(), replayed)

    assert dut.reason.endswith("the phases differ: 'fault' began in the replay only")


def test_tracks_with_other_visible_points_are_a_difference():
    replayed = make_run()
    replayed.tracks[:6] = []

    dut = make_summary(make_run(), replayed)

    # Of the seven tracks that were logged before 1 s.
    assert dut.reason == (
        "from 0.20 s on, in phase 'wait', 86 % of the tracks have no point that both run and "
        "replay saw"
    )
    assert "; 6 of 12 tracks and 0 of 18 points occur only in the run" in dut.closing_line()


@pytest.mark.parametrize(
    ("recorded", "said"),
    [(True, "have no times in common"), (False, "holds no commands")],
)
def test_a_log_without_comparable_commands_is_not_the_same(recorded, said):
    run = make_run()
    run.commands = Series(run.commands.times + 1e-3, run.commands.values)
    if not recorded:
        run.commands = Series.of([], 7)

    dut = make_summary(run, make_run())

    assert not dut.same
    assert said in dut.reason


def test_the_figures_are_json(tmp_path):
    dut = make_summary(make_run(), make_run(speed=0.75), changed=True)

    figures = json.loads(dut.write_json(tmp_path / "out" / "replay.json").read_text())

    assert figures["same"] is False
    assert figures["changed"] is True
    assert figures["first_difference"] == {
        "time": 1.0,
        "what": "joint_velocity_rad_s",
        "phase": "follow",
        "size": pytest.approx(0.25),
        "tolerance": 0.1,
        "began": None,
    }
    speeds = figures["signals"]["joint_velocity_rad_s"]
    # 32 of 65 samples lie before 1 s.
    assert (speeds["count"], speeds["maximum"], speeds["tolerance"]) == (65, 0.25, 0.1)
    assert speeds["phases"]["wait"]["maximum"] == 0.0
    assert speeds["phases"]["follow"]["count"] == 33
    assert figures["phases"][1] == {"name": "follow", "recorded": 1.0, "replayed": 1.0}
    assert "drake" in figures["versions"]
