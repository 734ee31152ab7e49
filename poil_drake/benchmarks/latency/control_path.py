"""The control path of the closed loop without the robot: propagator, field, inverse kinematics."""

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem

from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.diagrams.loop.wires import LOOP_WIRES
from poil_drake.diagrams.scenario.poil_config import Rates
from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, transform_points
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.robots.joint_trajectory import JointTrajectory
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.systems.control.motion_source import MotionSource
from poil_drake.systems.control.point_set_bcsdm import PointSetBcsdm
from poil_drake.systems.fk_propagator import FkPropagator
from poil_drake.systems.ik.arm_kinematics import MakePandaKinematics
from poil_drake.systems.ik.differential_ik import (
    DifferentialInverseKinematics,
    DifferentialInverseKinematicsConfig,
)
from poil_drake.systems.skill.phases import Phase

_JOINTS = "robot.position_measured"
_START = np.array(DifferentialInverseKinematicsConfig().nominal_posture)


class ControlPath:
    """The systems of the closed loop's control path, in a diagram with fixed inputs.

    The arm follows commands instantly. A tracker reports the points in the hand with noise and a
    delay of an eighth of its period. From time to time the arm restarts near its initial position.

    Args:
        num_points: N, number of points.
        num_samples: T, number of samples of the reference.
    """

    def __init__(self, *, num_points: int, num_samples: int):
        self._rates, self._model = Rates(), PandaModel()
        self._random = np.random.default_rng(0)
        self._in_hand = self._random.uniform([-0.04] * 3, [0.04, 0.04, 0.14], (num_points, 3))
        systems = self._make_systems(num_samples)
        self._diagram = _connect(systems)
        self._velocity = systems["motion"].GetOutputPort("velocity")
        self._simulator = Simulator(self._diagram)
        self._context = self._simulator.get_mutable_context()
        self._motion_context = systems["motion"].GetMyContextFromRoot(self._context)
        self._tick = 0
        self._joints, self._command = _START, np.zeros(_START.size)
        self._capture = self._track()
        self._fix("sequencer.holding", [1.0])
        self._fix("sequencer.phase", [float(Phase.FOLLOW)])
        self._fix("sequencer.phase_start", [0.0])
        self._fix("tracker.tracked_points", self._capture)
        self._fix(_JOINTS, self._joints)
        self._simulator.Initialize()

    def _make_systems(self, num_samples: int) -> dict[str, LeafSystem]:
        period, kinematics = self._rates.control, MakePandaKinematics()
        rest = JointTrajectory(
            np.array([0.0, 1.0]), np.tile(_START, (2, 1)), np.zeros((2, _START.size))
        )
        return {
            "propagator": FkPropagator(
                num_points=len(self._in_hand), kinematics=kinematics, period=period
            ),
            "controller": PointSetBcsdm(reference=self._reference(num_samples), period=period),
            "motion": MotionSource(approach=rest, descent=rest, period=period),
            "inverse_kinematics": DifferentialInverseKinematics(
                kinematics=kinematics, period=period
            ),
        }

    def _reference(self, num_samples: int) -> PointTrajectory:
        """Returns a motion that carries the points 0.3 m in 4 s and rotates them by 60 degrees."""
        times = np.linspace(0.0, 4.0, num_samples)
        s = np.sin(0.5 * np.pi * times / times[-1])[:, None]
        X_WG = self._model.gripper_pose(_START)
        X = make_transform(
            rotation_exp(s * [0.0, 0.0, np.pi / 3.0]) @ X_WG[:3, :3],
            X_WG[:3, 3] + s * [0.05, 0.25, 0.15],
        )
        positions = transform_points(X, self._in_hand)
        velocities = np.gradient(positions, times, axis=0)
        velocities[-1] = 0.0
        return PointTrajectory(times, positions, velocities)

    def _track(self) -> TrackedPoints:
        """Returns the points as tracked now, with 1 mm of noise."""
        points = transform_points(self._model.gripper_pose(self._joints), self._in_hand)
        return TrackedPoints(
            points + self._random.normal(scale=1e-3, size=points.shape),
            np.ones(len(points)),
            self._context.get_time(),
        )

    def _fix(self, name: str, value: object) -> None:
        self._diagram.GetInputPort(name).FixValue(self._context, value)

    def prepare(self) -> None:
        """Moves the arm by the last command, and updates the tracked points when they are due."""
        tracker = round(self._rates.tracker / self._rates.control)
        self._joints = self._joints + self._rates.control * self._command
        if self._tick % (64 * tracker) == 0:
            self._joints = _START + self._random.uniform(-0.2, 0.2, _START.size)
        if self._tick % tracker == 0:
            self._fix("tracker.tracked_points", self._capture)
        if self._tick % tracker == tracker - tracker // 8:
            self._capture = self._track()
        self._fix(_JOINTS, self._joints)
        self._tick += 1

    def step(self) -> np.ndarray:
        """Runs one control period, and returns the joint velocities (7,) [rad/s]."""
        self._simulator.AdvanceTo(self._tick * self._rates.control)
        self._command = self._velocity.Eval(self._motion_context)
        return self._command


def _connect(systems: dict[str, LeafSystem]) -> Diagram:
    """Wires systems as in the closed loop. Outputs of absent systems become diagram inputs."""
    builder = DiagramBuilder()
    for name, system in systems.items():
        builder.AddNamedSystem(name, system)
    exported = set()
    for source, target in LOOP_WIRES:
        (giver, output), (taker, input_) = source.split(".", 1), target.split(".", 1)
        if taker not in systems:
            continue
        port = systems[taker].GetInputPort(input_)
        if giver in systems:
            builder.Connect(systems[giver].GetOutputPort(output), port)
        elif source in exported:
            builder.ConnectInput(source, port)
        else:
            exported.add(source)
            builder.ExportInput(port, source)
    return builder.Build()
