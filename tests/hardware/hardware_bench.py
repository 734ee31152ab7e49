"""Runs the hardware loop against the stand-in robot, in real time."""

import dataclasses
import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from poil_drake.benchmarks.stand_in_robot import with_own_networks
from poil_drake.control.joint_trajectory import JointTrajectory
from poil_drake.control.point_trajectory import PointTrajectory
from poil_drake.diagrams.scenario import Scenario
from poil_drake.geometry.rigid_transform import make_transform
from poil_drake.grasping.candidates import GraspCandidate
from poil_drake.grasping.execution_plan import ExecutionPlan

HOME = np.array([0.0, -0.9, 0.0, -2.5, 0.0, 1.6, 0.785398])
POINTS = np.array([[0.50, -0.10, 0.04], [0.51, -0.10, 0.05], [0.50, -0.09, 0.06]])
SWING = 0.6
HELD_WIDTH = 0.01
_HERE = Path(__file__).parent


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
    stay = JointTrajectory([0.0, 0.125], [end, end], np.zeros((2, 7)))
    rise = np.linspace(0.0, 0.15, 9)[:, None, None] * np.array([0.0, 0.0, 1.0])
    velocities = np.zeros((9, 3, 3))
    velocities[:-1, :, 2] = 0.1
    grasp = GraspCandidate(
        make_transform(np.diag([1.0, -1.0, -1.0]), [0.50, -0.10, 0.05]),
        0.004,
        0.028,
        0.7,
        np.array([[0.50, -0.102, 0.05], [0.50, -0.098, 0.05]]),
    )
    return ExecutionPlan(
        object_label="mug",
        part_label="handle",
        target_points=POINTS,
        object_points=POINTS,
        part_points=POINTS,
        reference=PointTrajectory(np.linspace(0.0, 1.5, 9), POINTS + rise, velocities),
        grasp=grasp,
        approach=approach,
        descent=stay,
        lift_height=0.02,
        retreat_distance=0.1,
        nominal_posture=HOME,
        metadata={"seed": 0},
    )


@dataclass
class StandIn:
    """The process of a stand-in robot."""

    process: subprocess.Popen[str]
    seen: dict | None = None

    def finish(self) -> dict:
        """Ends it and returns what it saw."""
        if self.seen is None:
            said, _ = self.process.communicate(timeout=20)
            self.seen = json.loads(said.splitlines()[-1])
        return self.seen


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
    setup = directory / "stand_in.json"
    setup.write_text(
        json.dumps(
            {
                "robot_url": scenario.lcm_buses["robot"].lcm_url,
                "image_url": scenario.lcm_buses["images"].lcm_url,
                "position": position.tolist(),
                "holds": HELD_WIDTH,
                "pictures": str(pictures),
                "cameras": list(scenario.cameras),
                "fault": fault,
                "after": after,
            }
        )
    )
    process = subprocess.Popen(
        [sys.executable, str(_HERE / "faulty_robot.py"), str(setup)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    robot = StandIn(process)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        yield robot
        robot.finish()
    finally:
        if process.poll() is None:
            process.kill()
        process.wait()
