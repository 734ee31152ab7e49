"""What a command of the command line leaves behind."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Outcome:
    """Exit status and output of a command."""

    status: int
    out: str
    err: str

    @property
    def error(self) -> str:
        """The line that ends a failed command, after any progress bars."""
        (line,) = [line for line in self.err.splitlines() if line.startswith("poil: ")]
        assert self.err.rstrip().endswith(line)
        assert "Traceback" not in self.err
        return line


Command = Callable[..., Outcome]
