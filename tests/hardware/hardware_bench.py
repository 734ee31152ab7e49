"""Runs the hardware loop against the stand-in robot, in real time."""

import dataclasses
import json
import signal
import subprocess
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from machine_pace import Pace
from prior_tracker import PriorTracker
from short_skill import HOME, rise, short_plan

from poil_drake.benchmarks.hardware.stand_in_robot import (
    PERIOD,
    StandInSetup,
    running_stand_in,
    with_own_networks,
)
from poil_drake.diagrams.loop import perception as closed_loop_perception
from poil_drake.diagrams.run.output_paths import OutputPaths
from poil_drake.diagrams.run.skill_run import ExecutePlan
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.perception.detectors.registry import LABEL_IMAGE
from poil_drake.reports.run_summary import RunSummary
from poil_drake.robots.joint_trajectory import JointTrajectory

SWING = 0.6
HELD_WIDTH = 0.01
RESTING = 0.01  # [rad/s]: the highest speed of an arm at rest.
PATIENCE = 3600.0  # [s]: reached only by a failing test.


def hardware_scenario(
    scenario: Scenario,
    *,
    time_scale: float = 1.0,
    speed: float = 0.2,
    ready_timeout: float = PATIENCE,
) -> Scenario:
    """Returns the scenario on networks that no other test uses.

    The detector reads labels, because the plans are for an object that is not in the pictures.
    """
    hardware = dataclasses.replace(
        scenario.poil.hardware, speed=speed, time_scale=time_scale, ready_timeout=ready_timeout
    )
    poil = dataclasses.replace(scenario.poil, hardware=hardware, detector=LABEL_IMAGE)
    return with_own_networks(dataclasses.replace(scenario, poil=poil))


def swinging_plan() -> ExecutionPlan:
    """Returns a plan whose approach first swings the arm about its first axis for half a second."""
    times = np.linspace(0.0, 0.5, 33)
    way = 0.5 - 0.5 * np.cos(2.0 * np.pi * times)
    rate = np.pi * np.sin(2.0 * np.pi * times)
    axis = np.eye(7)[0]
    swing = JointTrajectory(times, HOME + SWING * way[:, None] * axis, SWING * rate[:, None] * axis)
    return _plan(swing, swing.positions[-1])


def carrying_plan() -> ExecutionPlan:
    """Returns a plan in which the arm stays, grasps, lifts, and then moves the points up."""
    stay = JointTrajectory([0.0, 0.125], [HOME, HOME], np.zeros((2, 7)))
    return _plan(stay, HOME)


def _plan(approach: JointTrajectory, end: np.ndarray) -> ExecutionPlan:
    return dataclasses.replace(
        short_plan(),
        reference=rise(height=0.1, duration=1.0, samples=9),
        approach=approach,
        descent=JointTrajectory([0.0, 0.125], [end, end], np.zeros((2, 7))),
        lift_height=0.02,
        retreat_distance=0.01,
    )


def track_with(tracker: PriorTracker, monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes closed loops use this tracker."""
    monkeypatch.setattr(closed_loop_perception, "MakeScenarioTracker", lambda poil: tracker)


def execute(
    plan: ExecutionPlan,
    scenario: Scenario,
    pictures: Path,
    folder: Path,
    *,
    fault: str = "",
) -> tuple[RunSummary, "RobotRecord"]:
    """Executes a plan on the hardware path; returns its summary and the stand-in's record."""
    with stand_in(scenario, pictures, folder, fault=fault, wait=False) as robot:
        summary = ExecutePlan(
            plan,
            scenario,
            outputs=OutputPaths(json=folder / "run.json", mcap=folder / "run.mcap"),
            hardware=True,
            show=False,
            show_progress=False,
            check=False,
        )
        return summary, RobotRecord(**robot.finish())


class RobotRecord(NamedTuple):
    """The record of the stand-in robot; times are [s since the epoch] by its clock.

    Attributes:
        speeds: Times and the largest joint speed then [rad/s].
        commanded: Stamps of the received commands.
        told: Times and the largest joint speed commanded then [rad/s].
        hand_told: Times and the finger opening commanded then [m].
        fault_at: Start of the fault; None if there was none.
        moved_at: Start of the arm's motion; None if it did not move.
    """

    speeds: list[tuple[float, float]]
    commanded: list[float]
    told: list[tuple[float, float]]
    hand_told: list[tuple[float, float]]
    fault_at: float | None
    moved_at: float | None

    def pace(self, summary: Mapping[str, Any] | None, scenario: Scenario) -> Pace:
        """Returns how well the stand-in kept up, and the run, if it left a summary."""
        times = np.array([time for time, _ in self.speeds])
        behind = float((times - times[0] - PERIOD * np.arange(len(times))).max())
        if summary is None:
            return Pace(behind)
        figures, per_ms = summary["figures"], 1e-3 * scenario.poil.hardware.time_scale
        return Pace(
            max(behind, per_ms * figures["tick_lateness_max_ms"]),
            per_ms * figures["tick_duration_p50_ms"] / scenario.poil.rates.control,
            summary["phases"][0]["end"],
        )

    def rest_after(self, time: float, *, commands: bool = True) -> float:
        """Returns how long after a time [s] the arm moved or was commanded to move.

        Args:
            time: The time by the robot's clock.
            commands: Whether commands count, too, and not only the arm's motion.
        """
        moving = [t for t, v in (*self.speeds, *(self.told if commands else ())) if v > RESTING]
        return max([0.0, *(t - time for t in moving)])


@dataclass
class StandIn:
    """The process of a stand-in robot."""

    process: subprocess.Popen[str]
    listener_file: Path
    record: dict | None = None

    def finish(self) -> dict:
        """Ends the process and returns the robot's record."""
        if self.record is None:
            output, _ = self.process.communicate()
            self.record = json.loads(output.splitlines()[-1])
            if self.process.returncode == -signal.SIGKILL:
                self.record["told"] = self._listener_record()
        return self.record

    def _listener_record(self) -> list:
        """Returns the commands that the listener recorded, also after the robot was killed."""
        while not self.listener_file.exists():
            time.sleep(0.05)
        return json.loads(self.listener_file.read_text())


@contextmanager
def stand_in(
    scenario: Scenario,
    pictures: Path,
    directory: Path,
    *,
    fault: str = "",
    after: float = 0.6,
    position: np.ndarray = HOME,
    wait: bool = True,
) -> Iterator[StandIn]:
    """Runs a stand-in robot during a block; its fault begins some time after its arm moves.

    Args:
        scenario: Scenario with its networks and cameras.
        pictures: Images of the cameras (npz).
        directory: Directory for its files.
        fault: Name of the fault; empty for none.
        after: Start of the fault after the arm's first motion [s of the robot's time].
        position: Joint positions of the arm (7,) [rad].
        wait: Whether to wait until the robot is ready. The station waits for it in any case.
    """
    setup = StandInSetup(
        robot_url=scenario.lcm_buses["robot"].lcm_url,
        image_url=scenario.lcm_buses["images"].lcm_url,
        position=tuple(position.tolist()),
        holds=HELD_WIDTH,
        pictures=str(pictures),
        cameras=tuple(scenario.cameras),
        time_scale=scenario.poil.hardware.time_scale,
        fault=fault,
        after=after,
    )
    listener_file = directory / "stand_in.json.told"
    listener_file.unlink(missing_ok=True)
    program = str(Path(__file__).parent / "faulty_robot.py")
    with running_stand_in(setup, directory, program=[program], wait=wait) as process:
        robot = StandIn(process, listener_file)
        yield robot
        robot.finish()
