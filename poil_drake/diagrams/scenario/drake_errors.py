"""Explains errors of Drake in terms of the scenario."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType

from poil_drake.errors import ScenarioError

_DRAKE_ERRORS = (RuntimeError, ValueError, TypeError, SystemExit)
"""What Drake raises for invalid values. A failed C++ assertion arrives in Python as SystemExit."""


@contextmanager
def DrakeErrorsExplained(
    problem: str, *, remedy: str, remedies: Mapping[str, str] = MappingProxyType({})
) -> Iterator[None]:
    """Replaces an error that Drake raises in a `with` block by a ScenarioError.

    Args:
        problem: What is wrong, e.g. "plant_config cannot be used". Drake's reason is appended.
        remedy: What the user can do.
        remedies: Words in Drake's reason -> what the user can do in this case.
    """
    try:
        yield
    except _DRAKE_ERRORS as error:
        reason = " ".join(str(error).split())
        remedy = next((text for words, text in remedies.items() if words in reason), remedy)
        # An assertion: "Failure at <file>:<line> in <function>: condition '<C++>' failed."
        if reason.startswith("Failure at ") and ": condition " in reason:
            condition = reason.split(": condition ", 1)[1].removesuffix(" failed.")
            reason = f"Drake requires {condition}"
        raise ScenarioError(f"{problem}: {reason.rstrip('.')}.", remedy=remedy) from error
