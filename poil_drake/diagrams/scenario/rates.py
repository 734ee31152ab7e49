"""The periods of everything that runs periodically."""

from dataclasses import dataclass
from fractions import Fraction

from poil_drake.diagrams.scenario.value_ranges import require_positive
from poil_drake.errors import ScenarioError
from poil_drake.systems.control_period import CONTROL_PERIOD


@dataclass(frozen=True, kw_only=True)
class Rates:
    """Periods [s]. The defaults are exact in binary, so simultaneous events stay simultaneous.

    A scenario file may give them as fractions, e.g. `tracker: 1/8`.

    Attributes:
        plant: Time step of the simulated plant, short enough to simulate a grasped cup.
        control: Propagator, vector field, differential inverse kinematics and sequencer; much
            faster than the 100 Hz that the robot's driver needs.
        tracker: Capture of images; about as often as a tracker can process them.
        logger: Run log and Meshcat; often enough for a smooth animation.
    """

    plant: float = 1 / 512
    control: float = CONTROL_PERIOD
    tracker: float = 1 / 8
    logger: float = 1 / 32

    def __post_init__(self) -> None:
        for name in ("plant", "control", "tracker", "logger"):
            require_positive(f"poil.rates.{name}", getattr(self, name))
        for slow, fast in (("control", "plant"), ("tracker", "control"), ("logger", "control")):
            a, b = getattr(self, slow), getattr(self, fast)
            if Fraction(a) % Fraction(b) != 0:
                raise ScenarioError(
                    f"poil.rates.{slow} is {a} s, which is not an exact multiple of "
                    f"poil.rates.{fast}, {b} s.",
                    remedy="Use fractions whose denominators are powers of two, e.g. 1/256.",
                )

    def next_report(self, time: float) -> float:
        """Returns the time of the next log or capture after `time` [s].

        The result is a whole multiple of a period, as for Drake's periodic events; summing periods
        that are not exact in binary would drift from the events.
        """
        return min(_next_multiple(period, time) for period in (self.logger, self.tracker))


def _next_multiple(period: float, time: float) -> float:
    count = round(time / period)
    return count * period if count * period > time else (count + 1) * period
