"""The control path of the closed loop without the robot: propagator, field, inverse kinematics."""

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.diagrams.scenario.rates import Rates
from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, transform_points
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.robots.joint_trajectory import JointTrajectory
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.control.motion_source import MotionSource, MotionSourceConfig
from poil_drake.systems.control.point_set_bcsdm import PointSetBcsdm
from poil_drake.systems.ik.arm_plant import MakePandaKinematics
from poil_drake.systems.ik.differential_ik import DifferentialIk, DifferentialIkConfig
from poil_drake.systems.propagation.fk_propagator import FkPropagator
from poil_drake.systems.skill.phases import Phase

_WIRES = [
    ("propagator.points", "controller.points"),
    ("propagator.confidence", "controller.confidence"),
    ("propagator.gripper_pose", "controller.gripper_pose"),
    ("propagator.gripper_pose", "motion.gripper_pose"),
    ("controller.spatial_velocity", "motion.field_velocity"),
    ("motion.spatial_velocity", "inverse_kinematics.spatial_velocity"),
    ("inverse_kinematics.velocity", "motion.ik_velocity"),
]
_JOINTS = "panda.position_measured"


class ControlPath:
    """The systems of the closed loop's control path, in a diagram with fixed inputs.

    The arm follows commands at once. A tracker reports the points in its hand, with noise and an
    eighth of its period late. From time to time the arm restarts near its initial position.
    """

    def __init__(self, *, num_points: int, num_samples: int):
        """Builds the diagram.

        Args:
            num_points: N, number of points.
            num_samples: T, number of samples of the reference.
        """
        self._rates = Rates()
        self._random = np.random.default_rng(0)
        self._kinematics = MakePandaKinematics()
        self._probe = LeafSystem()
        scratch = self._kinematics.declare_scratch(self._probe)
        self._probe_context = self._probe.CreateDefaultContext()
        self._scratch = scratch.Eval(self._probe_context)
        ik = DifferentialIkConfig()
        self._start = np.array(ik.resolution.nominal_posture)
        self._in_hand = self._random.uniform([-0.04] * 3, [0.04, 0.04, 0.14], (num_points, 3))
        builder = DiagramBuilder()
        systems = self._add_systems(builder, ik, num_samples)
        self._diagram = builder.Build()
        self._velocity = systems["motion"].GetOutputPort("velocity")
        self._simulator = Simulator(self._diagram)
        self._context = self._simulator.get_mutable_context()
        self._motion_context = systems["motion"].GetMyContextFromRoot(self._context)
        self._tick = 0
        self._joints = self._start
        self._command = np.zeros(self._start.size)
        self._fix("holding", [1.0])
        self._fix("phase", [float(Phase.FOLLOW)])
        self._fix("phase_start", [0.0])
        self._capture = self._look()
        self._fix("tracked_points", self._capture)
        self._fix(_JOINTS, self._joints)
        self._simulator.Initialize()

    def _add_systems(
        self, builder: DiagramBuilder, ik: DifferentialIkConfig, num_samples: int
    ) -> dict[str, LeafSystem]:
        period, stopwatch = self._rates.control, Stopwatch()
        rest = JointTrajectory(
            np.array([0.0, 1.0]), np.tile(self._start, (2, 1)), np.zeros((2, self._start.size))
        )
        systems: dict[str, LeafSystem] = {
            "propagator": FkPropagator(
                num_points=len(self._in_hand),
                kinematics=self._kinematics,
                period=period,
                stopwatch=stopwatch,
            ),
            "controller": PointSetBcsdm(reference=self._reference(num_samples), period=period),
            "motion": MotionSource(
                approach=rest, descent=rest, config=MotionSourceConfig(), period=period
            ),
            "inverse_kinematics": DifferentialIk(
                kinematics=self._kinematics, period=period, config=ik, stopwatch=stopwatch
            ),
        }
        for name, system in systems.items():
            builder.AddNamedSystem(name, system)
        for source, target in _WIRES:
            (giver, output), (taker, input_) = source.split("."), target.split(".")
            builder.Connect(
                systems[giver].GetOutputPort(output), systems[taker].GetInputPort(input_)
            )
        for name in ("tracked_points", "holding"):
            builder.ExportInput(systems["propagator"].GetInputPort(name), name)
        for name in ("phase", "phase_start"):
            builder.ExportInput(systems["motion"].GetInputPort(name), name)
        builder.ExportInput(systems["propagator"].GetInputPort(_JOINTS), _JOINTS)
        for name in ("motion", "inverse_kinematics"):
            builder.ConnectInput(_JOINTS, systems[name].GetInputPort(_JOINTS))
        return systems

    def _pose(self, joints: np.ndarray) -> np.ndarray:
        return self._kinematics.pose(self._scratch, joints)

    def _reference(self, num_samples: int) -> PointTrajectory:
        """Returns 4 s of carrying the points 0.3 m to the side, with a rotation by 60 degrees."""
        times = np.linspace(0.0, 4.0, num_samples)
        s = np.sin(0.5 * np.pi * times / times[-1])[:, None]
        X_WG = self._pose(self._start)
        X = make_transform(
            rotation_exp(s * [0.0, 0.0, np.pi / 3.0]) @ X_WG[:3, :3],
            X_WG[:3, 3] + s * [0.05, 0.25, 0.15],
        )
        positions = transform_points(X, self._in_hand)
        velocities = np.gradient(positions, times, axis=0)
        velocities[-1] = 0.0
        return PointTrajectory(times, positions, velocities)

    def _look(self) -> TrackedPoints:
        """Returns the tracked points now, with noise of 1 mm."""
        points = transform_points(self._pose(self._joints), self._in_hand)
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
            self._joints = self._start + self._random.uniform(-0.2, 0.2, self._start.size)
        if self._tick % tracker == 0:
            self._fix("tracked_points", self._capture)
        if self._tick % tracker == tracker - tracker // 8:
            self._capture = self._look()
        self._fix(_JOINTS, self._joints)
        self._tick += 1

    def step(self) -> np.ndarray:
        """Runs one control period, and returns the joint velocities (7,) [rad/s]."""
        self._simulator.AdvanceTo(self._tick * self._rates.control)
        self._command = self._velocity.Eval(self._motion_context)
        return self._command
