"""Runs the hardware loop against the stand-in robot, in real time."""

import dataclasses
import json
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from short_skill import HOME, rise, short_plan

from poil_drake.benchmarks.stand_in_robot import (
    StandInSetup,
    running_stand_in,
    with_own_networks,
)
from poil_drake.control.joint_trajectory import JointTrajectory
from poil_drake.diagrams.scenario import Scenario
from poil_drake.grasping.execution_plan import ExecutionPlan

SWING = 0.6
HELD_WIDTH = 0.01


def hardware_scenario(scenario: Scenario, *, speed: float = 0.2) -> Scenario:
    """Returns a scenario with networks of its own."""
    hardware = dataclasses.replace(scenario.poil.hardware, speed=speed, ready_timeout=20.0)
    poil = dataclasses.replace(scenario.poil, hardware=hardware)
    return with_own_networks(dataclasses.replace(scenario, poil=poil))


def swinging_plan() -> ExecutionPlan:
    """The arm swings about its first axis for half a second, and only then would reach."""
    times = np.linspace(0.0, 0.5, 33)
    way = 0.5 - 0.5 * np.cos(2.0 * np.pi * times)
    rate = np.pi * np.sin(2.0 * np.pi * times)
    axis = np.eye(7)[0]
    swing = JointTrajectory(times, HOME + SWING * way[:, None] * axis, SWING * rate[:, None] * axis)
    return _plan(swing, swing.positions[-1])


def carrying_plan() -> ExecutionPlan:
    """The arm stays, grasps, lifts, and then carries the points upwards."""
    stay = JointTrajectory([0.0, 0.125], [HOME, HOME], np.zeros((2, 7)))
    return _plan(stay, HOME)


def _plan(approach: JointTrajectory, end: np.ndarray) -> ExecutionPlan:
    return dataclasses.replace(
        short_plan(),
        reference=rise(height=0.15, duration=1.5, samples=9),
        approach=approach,
        descent=JointTrajectory([0.0, 0.125], [end, end], np.zeros((2, 7))),
        lift_height=0.02,
    )


@dataclass
class StandIn:
    """The process of a stand-in robot."""

    process: subprocess.Popen[str]
    listened: Path
    seen: dict | None = None

    def finish(self) -> dict:
        """Ends it and returns what it saw."""
        if self.seen is None:
            said, _ = self.process.communicate(timeout=20)
            self.seen = json.loads(said.splitlines()[-1])
            if self.process.returncode == -signal.SIGKILL:
                self.seen["told"] = self._listened()
        return self.seen

    def _listened(self) -> list:
        """Returns what another process heard when the robot was killed."""
        deadline = time.monotonic() + 20.0
        while time.monotonic() < deadline:
            if self.listened.exists() and (text := self.listened.read_text()):
                return json.loads(text)
            time.sleep(0.05)
        raise AssertionError(f"{self.listened} was not written.")


@contextmanager
def stand_in(
    scenario: Scenario,
    pictures: Path,
    directory: Path,
    *,
    fault: str = "",
    after: float = 0.6,
    position: np.ndarray = HOME,
) -> Iterator[StandIn]:
    """Runs a stand-in robot beside a block; it misbehaves once its arm has moved for a while.

    Args:
        scenario: Its networks and cameras.
        pictures: What the cameras show (npz).
        directory: For its files.
        fault: How it misbehaves.
        after: When [s], counted from the arm's first motion.
        position: Where the arm stands (7,) [rad].
    """
    setup = StandInSetup(
        robot_url=scenario.lcm_buses["robot"].lcm_url,
        image_url=scenario.lcm_buses["images"].lcm_url,
        position=tuple(position.tolist()),
        holds=HELD_WIDTH,
        pictures=str(pictures),
        cameras=tuple(scenario.cameras),
        fault=fault,
        after=after,
    )
    listened = directory / "stand_in.json.told"
    listened.unlink(missing_ok=True)
    program = str(Path(__file__).parent / "faulty_robot.py")
    with running_stand_in(setup, directory, program=[program]) as process:
        robot = StandIn(process, listened)
        yield robot
        robot.finish()
