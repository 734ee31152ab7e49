import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from short_skill import short_plan, short_scenario

from poil_drake.diagrams.run.finished_run import FinishedRun, WriteReport, summarize
from poil_drake.diagrams.run.output_paths import OutputPaths
from poil_drake.diagrams.run.recorder import TrackingLosses
from poil_drake.diagrams.run.task_success import HangingJudge
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.safety.faults import SafetyFault
from poil_drake.systems.skill.phases import Fault, Phase

ROD = "rack::rod::bar"
PICTURED = (Phase.WAIT, Phase.FOLLOW, Phase.FOLLOW)


class Samples:
    """A fake RunRecorder: three samples, the skill's last phases, and a judge."""

    def __init__(self, judge: HangingJudge, *last_phases: Phase):
        phases = [*PICTURED, *last_phases]
        count = len(phases)
        self.losses = TrackingLosses()
        self.judge, self.phase = judge, phases[-1]
        self.times = [0.5 * k for k in range(count)]
        self._signals = {
            "phase": np.array(phases, dtype=float),
            "points": np.zeros((count, 9)),
            "target_points": np.zeros((count, 9)),
            "goal_error": np.linspace(0.010, 0.002, count),
            "potential": np.linspace(1.0, 0.25, count),
            "tau": np.zeros(count),
            "joint_velocities": np.zeros((count, 7)),
        }

    def signal(self, name: str) -> np.ndarray:
        return self._signals[name]

    def tracking_losses(self) -> TrackingLosses:
        return self.losses

    def tracking_errors(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array([0.25, 0.75]), np.array([[0.001, 0.003], [np.nan, 0.002]])


def judge_of(*touched: str, hanging_since: float | None = None) -> HangingJudge:
    """A judge that saw the mug touch geometries, and hang on the rod since then [s]."""
    return HangingJudge(
        fixture="rack",
        holder=frozenset({ROD}),
        hanging_since=hanging_since,
        last_touched=frozenset(touched),
    )


def make_report(
    *last_phases: Phase, judge: HangingJudge | None = None, **changed: object
) -> FinishedRun:
    fields: dict = {
        "plan": short_plan(),
        "scenario": short_scenario(),
        "recorder": Samples(judge or judge_of(ROD, hanging_since=0.0), *last_phases),
        "fault": Fault.NONE,
        "simulated": 5.0,
        "wall": 4.0,
        "stopwatch": Stopwatch(),
        "stopped": None,
        "final_state": np.zeros(3),
    }
    return FinishedRun(**fields | changed)


def verdict(report: FinishedRun) -> tuple[bool, str]:
    summary = summarize(report, OutputPaths())
    return summary.success, summary.reason


NOT_HANGING = "does not hang on the rack: it touches"


@pytest.mark.parametrize(
    ("judge", "reason"),
    [
        (judge_of(ROD, hanging_since=3.0), "hangs on the rack (for 2.0 s so far)"),
        # It hangs for less than two seconds.
        (judge_of(ROD, hanging_since=3.01), f"{NOT_HANGING} rack::rod"),
        (judge_of("table::table::top", ROD), f"{NOT_HANGING} rack::rod, table::table"),
        (judge_of(), f"{NOT_HANGING} nothing"),
    ],
)
def test_an_object_must_hang_for_two_seconds_at_the_end(judge: HangingJudge, reason: str) -> None:
    success = reason.startswith("hangs")

    assert verdict(make_report(Phase.DONE, judge=judge)) == (success, f"the mug {reason}")


def test_a_success_with_lost_tracks_says_so() -> None:
    report = make_report(Phase.DONE)
    report.recorder.losses = TrackingLosses(losses=1, duration=7.5, searches=9)

    dut = summarize(report, OutputPaths())

    assert dut.success
    assert dut.closing_line().startswith(
        "SUCCESS: the mug hangs on the rack (for 5.0 s so far); tracks were lost once, "
        "for 7.5 s in all, and the part was searched for again 9 times; "
    )
    assert dut.figures["tracks_lost_time_s"] == 7.5


@pytest.mark.parametrize(
    ("phases", "changed", "reason"),
    [
        ([Phase.SETTLE], {}, "the time ran out in phase 'settle'"),
        (
            [Phase.RELEASE, Phase.FAULT],
            {
                "fault": Fault.SAFETY,
                "safety_fault": SafetyFault.TABLE,
                "problems": ["slow"],
            },
            "the arm was about to touch the table (in phase 'release'); slow",
        ),
        ([Phase.DONE], {"stopped": ValueError("no\n  camera")}, "ValueError: no camera"),
    ],
    ids=["out of time", "the supervisor's fault and all problems", "an exception"],
)
def test_a_failure_is_reported_even_if_the_object_hangs(
    phases: list[Phase], changed: dict, reason: str
) -> None:
    assert verdict(make_report(*phases, **changed)) == (False, reason)


@pytest.mark.parametrize(
    "fault", [fault for fault in Fault if fault not in (Fault.NONE, Fault.SAFETY)]
)
def test_a_fault_is_reported_with_its_phase(fault: Fault) -> None:
    report = make_report(Phase.RELEASE, Phase.FAULT, Phase.FAULT, fault=fault)

    assert verdict(report) == (False, f"{fault.text} (in phase 'release')")


def test_a_fault_of_the_supervisor_after_the_last_phase_is_reported() -> None:
    report = make_report(Phase.SETTLE, Phase.DONE, safety_fault=SafetyFault.EXTERNAL_TORQUE)

    success, reason = verdict(report)

    assert not success
    assert reason.startswith("something pushed the arm too hard")


def test_the_errors_are_those_of_the_follow_phase() -> None:
    dut = summarize(make_report(Phase.RELEASE, Phase.DONE), OutputPaths())

    # Samples 1 and 2 of 5, evenly from 10 mm to 2 mm, and from 1 to 0.25.
    assert dut.mean_error == pytest.approx(0.006)
    assert dut.initial_potential == pytest.approx(0.8125)
    assert dut.final_potential == pytest.approx(0.625)
    assert dut.tracking_error.count == 3
    assert dut.tracking_error.median == 0.002
    assert dut.tracking_error.missing == 0.25
    # Of the two tracks only the second, of 0.75 s, was captured while the object was carried.
    assert dut.carried_tracking_error.count == 1
    assert dut.carried_tracking_error.missing == 0.5
    assert (dut.scenario, dut.tracker) == ("HangMug", "ground_truth")
    assert dut.scenario_file.endswith("hang_mug.yaml")


def test_the_parts_of_the_time_add_up_to_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    stopwatch = Stopwatch()
    parts = ("capture", "detection", "waiting", "control", "publishing", "reporting")
    names = (*parts, "rendering", "tracking")
    readings = iter([t for k in range(len(names)) for t in (10.0 * k, 10.0 * k + 0.25)])
    monkeypatch.setattr("time.perf_counter", lambda: next(readings))
    for name in names:
        with stopwatch.measure(name):
            pass

    dut = summarize(make_report(Phase.DONE, wall=4.0, stopwatch=stopwatch), OutputPaths()).timing

    # Rendering and tracking are done by other processes, beside the rest.
    assert dut.concurrent == {"rendering": 0.25, "tracking": 0.25}
    assert set(dut.parts) == {*parts, "physics"}
    assert sum(dut.parts.values()) == pytest.approx(4.0)
    assert dut.parts["physics"] == pytest.approx(4.0 - 6 * 0.25)


def test_a_report_writes_picture_and_figures(tmp_path: Path) -> None:
    outputs = OutputPaths(json=tmp_path / "run.json", png=tmp_path / "run.png")
    stages = Stopwatch()
    with stages.measure("planning"):
        pass

    dut = WriteReport(make_report(Phase.DONE), outputs=outputs, stages=stages)

    figures = json.loads(outputs.json.read_text())
    assert figures["success"] is dut.success is True
    assert figures["outputs"] == {"json": str(outputs.json), "png": str(outputs.png)}
    assert figures["timing"]["stages"].keys() == {"planning", "report"}
    assert figures["timing"]["stages"]["report"] > 0.0
    assert figures["final_state_digest"] == hashlib.sha256(np.zeros(3).tobytes()).hexdigest()
    assert outputs.png.stat().st_size > 10_000


def test_figures_are_written_even_if_the_picture_fails(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    outputs = OutputPaths(json=tmp_path / "run.json", png=tmp_path / "file" / "run.png")

    with pytest.raises(OSError, match="file"):
        WriteReport(make_report(Phase.DONE), outputs=outputs, stages=Stopwatch())

    assert json.loads(outputs.json.read_text())["success"] is True
