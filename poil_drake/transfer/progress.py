"""How long computations report their progress."""

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Called with a description of the current activity and its completed fraction, in [0, 1]."""
