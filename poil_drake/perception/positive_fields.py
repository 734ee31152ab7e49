"""A check of numbers in configurations."""

import math

from poil_drake.errors import InvalidValueError


def check_positive(config: object, *names: str, or_zero: bool = False) -> None:
    """Checks that the named fields of a configuration are positive and finite.

    Args:
        config: The configuration.
        names: Names of its fields.
        or_zero: Whether 0 is allowed, too.

    Raises:
        InvalidValueError: if one is not.
    """
    for name in names:
        value = getattr(config, name)
        if not (0 < value < math.inf or (or_zero and value == 0)):
            raise InvalidValueError(
                f"{type(config).__name__}.{name} is {value}.",
                remedy=f"Set a positive, finite number{' or 0' if or_zero else ''}.",
            )
