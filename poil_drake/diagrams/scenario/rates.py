"""The `poil.rates` section of a scenario: periods."""

from dataclasses import dataclass
from fractions import Fraction

from poil_drake.diagrams.scenario.value_ranges import require_positive
from poil_drake.errors import ScenarioError
from poil_drake.systems.control_period import CONTROL_PERIOD


@dataclass(frozen=True, kw_only=True)
class Rates:
    """The `poil.rates` section: periods [s].

    A scenario file may give them as fractions, e.g. `tracker: 1/8`. The defaults are exact in
    binary, so that simultaneous events stay simultaneous.

    Attributes:
        plant: Time step of the simulated plant. The default is short enough for a grasped cup.
        control: Period of the propagator, the vector field, the differential inverse kinematics
            and the sequencer. The robot's driver needs 10 ms or less.
        tracker: Period of image captures. The default is about the time that a tracker needs.
        logger: Period of the run log and of Meshcat. The default gives a smooth animation.
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
        """Returns the time of the first log sample or image capture after `time` [s].

        The result is an exact multiple of `logger` or `tracker`, like the times of Drake's events.
        """
        return min(_next_multiple(period, time) for period in (self.logger, self.tracker))


def _next_multiple(period: float, time: float) -> float:
    count = round(time / period)
    return count * period if count * period > time else (count + 1) * period
