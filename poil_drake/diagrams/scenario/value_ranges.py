"""Checks of single numbers in a scenario."""

import math

from poil_drake.errors import ScenarioError


def require_positive(name: str, value: float, *, largest: float = math.inf) -> None:
    """Checks that a number is positive and at most `largest`.

    Args:
        name: The number's place in the scenario, e.g. "poil.eta".
        value: The number.
        largest: The largest valid number; math.inf allows every finite number.

    Raises:
        ScenarioError: The number is out of range or NaN.
    """
    if not 0.0 < value <= largest or math.isinf(value):
        limit = "finite" if math.isinf(largest) else f"at most {largest:g}"
        problem = f"{name} is {value}, which is out of range."
        raise ScenarioError(problem, remedy=f"It must be positive and {limit}.")


def require_not_negative(name: str, value: float) -> None:
    """Checks that a number is finite and not negative.

    Args:
        name: The number's place in the scenario, e.g. "poil.latency".
        value: The number.

    Raises:
        ScenarioError: The number is out of range or NaN.
    """
    if not 0.0 <= value < math.inf:
        problem = f"{name} is {value}, which is out of range."
        raise ScenarioError(problem, remedy="It must be finite and not negative.")
