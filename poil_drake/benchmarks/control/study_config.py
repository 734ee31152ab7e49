"""What the control study tries."""

from dataclasses import dataclass

from poil_drake.benchmarks.control.arena.tasks import TASKS
from poil_drake.benchmarks.control.policies.policies import ROWS
from poil_drake.errors import InvalidValueError


@dataclass(frozen=True, kw_only=True)
class ControlStudyConfig:
    """What is tried.

    Attributes:
        tasks: Names of tasks.
        policies: Names of policies.
        trials: Of each policy in each region of each task.
        hard: Whether hard mode is tried, too: any orientation, a tracker of 8 Hz that is 0.1 s late
            and has 3 mm of noise, and a slip of 3 cm and 20 degrees on the way.
        seed: Of starts, slips and noise; policies are trained on the same demonstrations always.
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
