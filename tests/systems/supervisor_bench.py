"""A supervised arm that does exactly as it is told, in continuous time."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from poil_drake.control.joint_limits import JointLimits
from poil_drake.grasping.robot_model import PandaModel
from poil_drake.systems.safety_faults import SafetyConfig, SafetyFault
from poil_drake.systems.safety_supervisor import SafetySupervisor
from poil_drake.systems.statuses import RobotMode

PERIOD = 1 / 256
MODEL = PandaModel()
LIMITS = JointLimits(
    lower=MODEL.lower,
    upper=MODEL.upper,
    velocity=MODEL.velocity,
    acceleration=np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]),
)


class SupervisorBench:
    """Runs a supervisor tick by tick, with an arm that follows at once.

    The velocities between two ticks are taken to be on a straight line, so that the arm's position
    is the integral of what it is told.

    Attributes:
        dut: The supervisor.
        q: (7,) where the arm is [rad].
        inputs: What the inputs that are connected show, or functions of the time [s] that say it;
            the arm's posture and speed only where they are not measured as they are.
        velocities: (K, 7) what the supervisor said at each tick [rad/s].
        now: The time by the clock of a supervisor that is `timed` [s].
    """

    def __init__(
        self,
        start: np.ndarray,
        *,
        config: SafetyConfig | None = None,
        cameras: Sequence[str] = (),
        timed: bool = False,
    ):
        self.now = 1000.0
        self.dut = SafetySupervisor(
            model=MODEL,
            limits=LIMITS,
            period=PERIOD,
            cameras=cameras,
            config=config,
            clock=(lambda: self.now) if timed else None,
        )
        self._simulator = Simulator(self.dut)
        self._context = self._simulator.get_mutable_context()
        self.q = np.array(start, dtype=float)
        self.velocities: list[np.ndarray] = []
        self.inputs: dict[str, Any] = {
            "velocity": np.zeros(7),
            "panda.torque_external": np.zeros(7),
            "panda.status": [float(RobotMode.MOVE), 0.0, 1.0],
        }
        self.inputs |= {f"{camera}.image_time": [np.nan] for camera in cameras}

    @property
    def context(self) -> Context:
        """The supervisor's context."""
        return self._context

    @property
    def time(self) -> float:
        return self._context.get_time()

    def tick(self, count: int = 1, **changes: Any) -> None:
        """Runs some updates, with changed inputs from now on."""
        self.inputs |= changes
        for _ in range(count):
            speed = self.velocities[-1] if self.velocities else np.zeros(7)
            measured = {"panda.position_measured": self.q, "panda.velocity_measured": speed}
            for name, value in (measured | self.inputs).items():
                shown = value(self.time) if callable(value) else value
                self.dut.GetInputPort(name).FixValue(self._context, shown)
            self._simulator.AdvancePendingEvents()
            told = np.array(self.output("velocity"))
            self.q = self.q + 0.5 * PERIOD * (speed + told)
            self.velocities.append(told)
            self.now += PERIOD
            self._simulator.AdvanceTo(len(self.velocities) * PERIOD)

    def hold_up(self, duration: float) -> None:
        """Lets the clock, and the arm with its last velocity, go on for a while [s] by itself."""
        self.now += duration
        self.q = self.q + duration * self.velocities[-1]

    def output(self, name: str) -> np.ndarray:
        return self.dut.GetOutputPort(name).Eval(self._context)

    @property
    def fault(self) -> SafetyFault:
        return SafetyFault(int(self.output("fault")[0]))

    @property
    def scale(self) -> float:
        return float(self.output("scale")[0])

    @property
    def commanded(self) -> np.ndarray:
        return self.dut.commanded_motion(self._context).position
