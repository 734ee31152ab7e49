"""The one table of periods of everything that runs periodically."""

import math
from dataclasses import dataclass
from fractions import Fraction

from poil_drake.errors import ScenarioError
from poil_drake.systems.control_period import CONTROL_PERIOD


@dataclass(frozen=True, kw_only=True)
class Rates:
    """Periods [s]. The defaults are exact in binary, so simultaneous events stay simultaneous.

    In a scenario file they may be written as fractions, e.g. `tracker: 1/8`.

    Attributes:
        plant: The simulated plant's time step: short enough for a cup in a grip.
        control: Propagator, vector field, differential inverse kinematics and sequencer: well
            above the 100 Hz that the robot's driver needs.
        tracker: From one capture of images to the next: about what a tracker manages.
        logger: Run log and Meshcat: smooth to look at.
    """

    plant: float = 1 / 512
    control: float = CONTROL_PERIOD
    tracker: float = 1 / 8
    logger: float = 1 / 32

    def __post_init__(self) -> None:
        for name in ("plant", "control", "tracker", "logger"):
            if not 0 < getattr(self, name) < math.inf:
                raise ScenarioError(
                    f"rates: the period '{name}' is {getattr(self, name)} s.",
                    remedy="It must be positive and finite, e.g. 1/256.",
                )
        for slow, fast in (("control", "plant"), ("tracker", "control"), ("logger", "control")):
            a, b = getattr(self, slow), getattr(self, fast)
            if Fraction(a) % Fraction(b) != 0:
                raise ScenarioError(
                    f"rates: the period '{slow}' = {a} s is not a whole multiple of '{fast}' "
                    f"= {b} s, exactly.",
                    remedy="Use fractions whose denominators are powers of two, e.g. 1/256.",
                )

    def next_report(self, time: float) -> float:
        """Returns when a run is looked at next, after `time` [s]: with each log and each capture.

        Whole multiples of the periods are what Drake's periodic events use, too; adding periods up
        would drift away from them where they are not exact in binary.
        """
        return min(_next_multiple(period, time) for period in (self.logger, self.tracker))


def _next_multiple(period: float, time: float) -> float:
    count = round(time / period)
    return count * period if count * period > time else (count + 1) * period
