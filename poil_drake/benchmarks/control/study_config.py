"""The settings of the control study."""

from dataclasses import dataclass, field

import numpy as np

from poil_drake.benchmarks.control.arena.delayed_tracking import TrackingConfig
from poil_drake.benchmarks.control.arena.tasks import TASKS
from poil_drake.benchmarks.control.policies.policies import OURS, ROWS
from poil_drake.benchmarks.control.trial import TrialConfig
from poil_drake.errors import InvalidValueError

HARD_POLICIES = ("open_loop", "se3_bcsdm", "field", OURS)
"""The policies that run in hard mode. Even there, `se3_bcsdm` knows the exact pose.

The learned policies are left out because only the yaw varies in their demonstrations.
"""


@dataclass(frozen=True, kw_only=True)
class HardMode:
    """The difficulties of hard mode, in addition to a start in any orientation.

    Attributes:
        slip_start: Earliest and latest time at which a slip of the object in the hand begins [s].
        slip_duration: Duration of the slip [s].
        slip_distance: Distance by which the object shifts in the hand [m].
        slip_angle: Angle by which the object rotates in the hand [rad].
        tracking: Delay and noise of the points.
        trial: When a trial ends: later than usual, because noise can make the object rest briefly.
    """

    slip_start: tuple[float, float] = (1.0, 3.0)
    slip_duration: float = 0.25
    slip_distance: float = 0.03
    slip_angle: float = np.radians(20.0)
    tracking: TrackingConfig = field(default_factory=TrackingConfig)
    trial: TrialConfig = field(
        default_factory=lambda: TrialConfig(settled_time=5.0, settled_motion=(0.4, 0.01))
    )


HARD = HardMode()


@dataclass(frozen=True, kw_only=True)
class ControlStudyConfig:
    """The trials of the study.

    Attributes:
        tasks: Names of tasks.
        policies: Names of policies.
        trials: Number of trials of each policy in each region of each task.
        hard: Whether to add hard mode: a start in any orientation, an 8 Hz tracker with 0.1 s of
            latency and 3 mm of noise, and a slip of 3 cm and 20 degrees on the way.
        seed: Seed of starts, slips and noise. Policies are always trained on the same
            demonstrations.
    """

    tasks: tuple[str, ...] = TASKS
    policies: tuple[str, ...] = tuple(row.name for row in ROWS)
    trials: int = 100
    hard: bool = True
    seed: int = 0

    def __post_init__(self) -> None:
        for kind, wanted, known in (
            ("task", self.tasks, TASKS),
            ("policy", self.policies, tuple(row.name for row in ROWS)),
        ):
            for name in wanted:
                if name not in known:
                    raise InvalidValueError(
                        f"There is no {kind} '{name}'.", remedy=f"Choose from: {', '.join(known)}."
                    )
            if len(set(wanted)) < len(wanted):
                raise InvalidValueError(
                    f"A {kind} is named twice in '{','.join(wanted)}'.", remedy="Name each once."
                )
