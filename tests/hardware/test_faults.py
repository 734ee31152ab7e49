"""Faults in a laboratory: the arm rests soon, the reason is right, and no output is lost.

Each run is in real time, slowed down as much as this machine requires, against a stand-in robot in
another process, whose fault begins 0.6 s after its arm starts to move. All times are the robot's.
The last test compares the results with the table in the documentation.
"""

import dataclasses
import json
import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from fault_table import DOCUMENT, Row, documented_rows, table
from hardware_bench import (
    RobotRecord,
    carrying_plan,
    execute,
    hardware_scenario,
    swinging_plan,
    track_with,
)
from machine_pace import Pace
from mcap.reader import make_reader
from prior_tracker import PriorTracker
from pydrake.systems.framework import Context, DiscreteValues

from poil_drake.diagrams.loop import control as closed_loop_control
from poil_drake.diagrams.loop.closed_loop import ClosedLoop
from poil_drake.diagrams.run import skill_run
from poil_drake.diagrams.run.real_time_loop import RealTimeLoop
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.reports.run_summary import RunSummary
from poil_drake.systems.ik.differential_ik import DifferentialInverseKinematics
from poil_drake.systems.safety.faults import SafetyFault
from poil_drake.systems.skill.phases import Fault
from poil_drake.systems.skill.state_machine import SkillConfig

pytestmark = [pytest.mark.render, pytest.mark.real_time]

ExecuteWith = Callable[..., tuple[RunSummary, RobotRecord]]

REST = 0.15
"""Longest time from the detection of a fault until the arm rests [s]."""

_ROWS: list[Row] = []


class Case(NamedTuple):
    """A fault, its report, and the longest time until its detection [s]."""

    fault: str
    event: str
    reason: str
    detail: str = ""
    detection: float = 0.15


STATUS = SafetyFault.NO_STATUS.text
CAMERA = SafetyFault.CAMERA_STALE.text
CLOCK = SafetyFault.CLOCK_OFF.text
CASES = [
    Case("driver_killed", "the driver's process is killed", STATUS),
    Case("status_stopped", "statuses stop", STATUS),
    Case("all_late", "every status is 0.3 s late", STATUS, "0.30 s before it arrived"),
    Case("all_repeated", "one status is repeated forever", STATUS, "arrived late or twice"),
    Case("all_malformed", "statuses are garbage", STATUS, "could not be read"),
    Case(
        "all_foreign", "another type of message on the status channel", STATUS, "could not be read"
    ),
    Case("clock_ahead", "the driver's clock jumps 1 s ahead", CLOCK, "1.00 s after it arrived"),
    Case(
        "clock_behind",
        "the driver's clock jumps 1 s back",
        CLOCK,
        "1.00 s before it arrived: are the clocks synchronized?",
    ),
    Case("reflex", "a reflex stops the robot", SafetyFault.ROBOT_MODE.text, detection=0.1),
    Case("pushed", "the arm is pushed with 60 N m", SafetyFault.EXTERNAL_TORQUE.text),
    Case(
        "packets_lost",
        "the robot receives a third of the commands",
        SafetyFault.SUCCESS_RATE.text,
        detection=0.7,
    ),
    Case("camera_frozen", "a camera repeats one image", CAMERA, detection=1.3),
    Case("camera_unplugged", "a camera stops sending images", CAMERA, detection=1.3),
    Case("camera_garbage", "a camera sends garbage", CAMERA, "camera 'left'", detection=1.3),
]


@pytest.fixture
def execute_with(
    scenario: Scenario,
    run_that_keeps_up: Callable,
    pictures: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> ExecuteWith:
    """Executes a plan on the hardware path: `execute_with(plan, fault=, tracker=, speed=)`.

    By default a lost track becomes a fault only after a minute (`lost_fault` [s]), because a slow
    machine takes long to restart the tracker's process.
    """

    def execute_with(
        plan: ExecutionPlan,
        *,
        fault: str = "",
        tracker: PriorTracker | None = None,
        speed: float = 0.2,
        lost_fault: float = 60.0,
    ) -> tuple[RunSummary, RobotRecord]:
        tracker = tracker or PriorTracker()

        def attempt(time_scale: float) -> tuple[tuple[RunSummary, RobotRecord], Pace]:
            if tracker.kill_marker:
                Path(tracker.kill_marker).unlink(missing_ok=True)  # Left by the last attempt.
            track_with(dataclasses.replace(tracker, stall=tracker.stall / time_scale), monkeypatch)
            chosen = hardware_scenario(scenario, speed=speed, time_scale=time_scale)
            summary, record = execute(plan, chosen, pictures, tmp_path, fault=fault)
            return (summary, record), record.pace(summary.to_dict(), chosen)

        # No test needs the time after the release.
        skill = partial(SkillConfig, release_time=0.1, settle_time=0.1, lost_fault=lost_fault)
        monkeypatch.setattr(closed_loop_control, "SkillConfig", skill)
        return run_that_keeps_up(attempt)

    return execute_with


def detected_at(summary: RunSummary) -> float:
    """Returns when the run detected its fault [s since the epoch]."""
    return summary.figures["epoch_s"] + summary.figures["fault_time_s"]


def check_fault(
    summary: RunSummary,
    record: RobotRecord,
    folder: Path,
    *,
    event: str,
    reason: str,
    detection: float = math.nan,
) -> None:
    """Checks that the run ended with this reason, at rest and with all outputs; adds its row."""
    assert not summary.success
    assert summary.reason.startswith(reason)
    rest = record.rest_after(detected_at(summary))
    assert rest <= REST
    assert json.loads((folder / "run.json").read_text())["reason"] == summary.reason
    with (folder / "run.mcap").open("rb") as stream:
        reader = make_reader(stream)
        phases = [json.loads(m.data) for _, _, m in reader.iter_messages(topics=["/phase"])]
        assert reader.get_summary() is not None  # The file was closed properly.
    assert phases[-1]["phase"] == "fault"
    _ROWS.append(Row(event, summary.reason, 1e3 * detection, 1e3 * rest))


@pytest.mark.parametrize("case", CASES, ids=[case.fault for case in CASES])
def test_the_arm_rests_and_the_reason_is_reported(
    execute_with: ExecuteWith, case: Case, tmp_path: Path
) -> None:
    summary, record = execute_with(swinging_plan(), fault=case.fault)

    detection = detected_at(summary) - record.fault_at
    assert detection <= case.detection
    assert case.detail in summary.reason
    # Rest was commanded; the commands did not merely stop.
    assert max(t for t, v in record.told if v == 0.0) > detected_at(summary) + 0.1
    reason = f"{case.reason} (in phase 'approach')"
    check_fault(summary, record, tmp_path, event=case.event, reason=reason, detection=detection)


def test_a_fault_stays_after_its_cause_is_gone(
    execute_with: ExecuteWith, monkeypatch: pytest.MonkeyPatch
) -> None:
    def go_on(loop: ClosedLoop, root: Context, pace: RealTimeLoop) -> None:
        pace.AdvanceTo(root.get_time() + 0.5)

    monkeypatch.setattr(skill_run, "Brake", go_on)

    summary, record = execute_with(swinging_plan(), fault="pushed_briefly")

    # The fault is read at the end, 0.4 s after the push.
    assert summary.reason.startswith(SafetyFault.EXTERNAL_TORQUE.text)
    assert record.rest_after(detected_at(summary)) <= REST


def test_bad_messages_among_good_ones_change_nothing(execute_with: ExecuteWith) -> None:
    summary, record = execute_with(swinging_plan(), fault="some_bad")

    # The arm was still approaching when a reflex stopped it.
    reflex = SafetyFault.ROBOT_MODE.text
    assert summary.reason.startswith(f"{reflex} (in phase 'approach')")
    assert "messages on PANDA_STATUS arrived late or twice" in summary.reason
    assert "messages on PANDA_STATUS could not be read" in summary.reason
    assert record.rest_after(record.fault_at) > 1.0


def test_a_tracker_that_stalls_for_a_moment_changes_nothing(execute_with: ExecuteWith) -> None:
    summary, record = execute_with(carrying_plan(), tracker=PriorTracker(stall=0.3), speed=1.0)

    assert went_on(summary), summary.reason
    assert longest_rest(record, summary) < 0.25


def test_the_arm_rests_while_a_tracker_stalls_for_long(execute_with: ExecuteWith) -> None:
    summary, record = execute_with(carrying_plan(), tracker=PriorTracker(stall=3.0), speed=1.0)

    assert went_on(summary), summary.reason
    # Points are propagated for 0.69 s; for two of the 3 s nothing moves.
    assert longest_rest(record, summary) > 1.5
    _ROWS.append(Row("the tracker stalls for 3 s", "no fault: the arm waits, then continues"))


def went_on(summary: RunSummary) -> bool:
    """Returns whether the run continued until it released the object."""
    names = [span.name for span in summary.phases]
    return "release" in names and "fault" not in names


def longest_rest(record: RobotRecord, summary: RunSummary) -> float:
    """Returns the longest time without motion of the arm in the phase `follow` [s]."""
    follow = next(span for span in summary.phases if span.name == "follow")
    start, end = (summary.figures["epoch_s"] + time for time in (follow.start, follow.end))
    moving = [t for t, speed in record.speeds if speed > 0.002 and start <= t <= end]
    return float(np.diff([start, *moving, end]).max())


def test_a_killed_tracker_is_restarted(execute_with: ExecuteWith, tmp_path: Path) -> None:
    tracker = PriorTracker(kill_marker=str(tmp_path / "kill_marker"))

    summary, _ = execute_with(carrying_plan(), tracker=tracker, speed=1.0)

    assert went_on(summary), summary.reason
    assert (tmp_path / "kill_marker").exists()
    _ROWS.append(
        Row(
            "the tracker's process is killed once",
            "no fault: the arm waits for a new process, then continues",
        )
    )


def test_a_tracker_that_is_killed_at_every_start_is_a_fault(
    execute_with: ExecuteWith, tmp_path: Path
) -> None:
    tracker = PriorTracker(kill_marker=str(tmp_path / "kill_marker"), restarts=False)

    summary, record = execute_with(carrying_plan(), tracker=tracker, speed=1.0, lost_fault=1.5)

    event = "the tracker's process is killed at every start"
    check_fault(summary, record, tmp_path, event=event, reason=Fault.TRACKING_LOST.text)


MOVING = 0.05
"""Commanded joint speed from which the inverse kinematics fails [rad/s]."""

_RESOLVE = DifferentialInverseKinematics._resolve
_UPDATE = DifferentialInverseKinematics._update


def resolve_to_nan(
    self: DifferentialInverseKinematics, context: Context, previous: np.ndarray
) -> tuple:
    velocity, *rest = _RESOLVE(self, context, previous)
    return (np.full_like(velocity, np.nan) if np.abs(velocity).max() > MOVING else velocity), *rest


def freeze(self: DifferentialInverseKinematics, context: Context, state: DiscreteValues) -> None:
    if np.abs(state.value(self._state["velocity"])).max() <= MOVING:
        _UPDATE(self, context, state)


@pytest.mark.parametrize(
    ("method", "broken", "fault", "event"),
    [
        (
            "_resolve",
            resolve_to_nan,
            SafetyFault.COMMAND_NOT_FINITE,
            "the inverse kinematics returns NaN",
        ),
        (
            "_update",
            freeze,
            SafetyFault.COMMAND_STALE,
            "the inverse kinematics repeats its last result forever",
        ),
    ],
)
def test_failing_inverse_kinematics_are_a_fault(
    execute_with: ExecuteWith,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    method: str,
    broken: Callable,
    fault: SafetyFault,
    event: str,
) -> None:
    monkeypatch.setattr(DifferentialInverseKinematics, method, broken)

    summary, record = execute_with(carrying_plan(), speed=1.0)

    check_fault(summary, record, tmp_path, event=event, reason=fault.text)


def test_the_documented_table_matches_the_results(request: pytest.FixtureRequest) -> None:
    results = {row.event: row.short_reason for row in _ROWS}
    if request.config.getoption("--write-fault-table"):
        DOCUMENT.write_text(table(_ROWS))

    documented = documented_rows()

    # Only the selected tests have results.
    assert results.items() <= documented.items()
    assert {case.event for case in CASES} <= documented.keys()
