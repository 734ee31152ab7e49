"""A supervised arm that follows its commands exactly, in continuous time."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from system_bench import SystemBench

from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.systems.safety.faults import SafetyConfig, SafetyFault
from poil_drake.systems.safety.supervisor import SafetySupervisor
from poil_drake.systems.statuses import RobotMode

PERIOD = 1 / 256
MODEL = PandaModel()
LIMITS = MODEL.joint_limits


class SupervisorBench(SystemBench):
    """Runs a supervisor tick by tick, with an arm that follows at once.

    The velocities between two ticks are taken to be on a straight line, so that the arm's position
    is the integral of its commands.

    Attributes:
        dut: The supervisor.
        q: (7,) where the arm is [rad].
        inputs: Values of the connected inputs, or functions of the time [s] that return them;
            the arm's posture and speed only where the measurement is to differ from the truth.
        velocities: (K, 7) the commands at each tick [rad/s].
        held_up: By how much the clock of a `timed` supervisor is ahead of the simulation [s].
    """

    held_up = 0.0

    def __init__(
        self,
        start: np.ndarray,
        *,
        config: SafetyConfig | None = None,
        cameras: Sequence[str] = (),
        timed: bool = False,
    ):
        dut = SafetySupervisor(
            model=MODEL,
            period=PERIOD,
            cameras=cameras,
            config=config,
            clock=self.now if timed else None,
        )
        super().__init__(dut)
        self.q = np.array(start, dtype=float)
        self.velocities: list[np.ndarray] = []
        self.inputs: dict[str, Any] = {
            "velocity": np.zeros(7),
            "torque_external": np.zeros(7),
            "status": [float(RobotMode.MOVE), 0.0, 1.0],
        }
        self.inputs |= {f"{camera}.image_time": [np.nan] for camera in cameras}

    def now(self) -> float:
        return self.time + self.held_up

    def tick(self, count: int = 1, **changes: Any) -> None:
        """Runs some updates, with changed inputs from now on."""
        self.inputs |= changes
        for _ in range(count):
            speed = self.velocities[-1] if self.velocities else np.zeros(7)
            measured = {"position_measured": self.q, "velocity_measured": speed}
            for name, value in (measured | self.inputs).items():
                self.fix(name, value(self.time) if callable(value) else value)
            self.simulator.AdvancePendingEvents()
            command = self.read("velocity")
            self.q = self.q + 0.5 * PERIOD * (speed + command)
            self.velocities.append(command)
            self.advance_to(len(self.velocities) * PERIOD)

    def hold_up(self, duration: float) -> None:
        """Advances the clock, and the arm at its last velocity, for a time [s] without updates."""
        self.held_up += duration
        self.q = self.q + duration * self.velocities[-1]

    @property
    def fault(self) -> SafetyFault:
        return SafetyFault(int(self.read("fault")[0]))

    @property
    def scale(self) -> float:
        return float(self.read("scale")[0])

    @property
    def commanded(self) -> np.ndarray:
        return self.dut.commanded_motion(self.context).position
