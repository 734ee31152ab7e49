"""The callback through which long-running computations report progress."""

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Called with a description of the current activity and the completed fraction of it, in [0, 1]."""
