"""A progress bar for the command line."""

import os
import sys
from types import TracebackType
from typing import Self

from tqdm import tqdm


class ProgressBar:
    """Shows what is being done and how far it is; a `with` block.

    Calling it with (what, fraction in [0, 1]) moves the bar; a new `what` begins a new bar.
    Where standard error is no terminal, each finished bar is one line.
    """

    def __init__(self, *, disable: bool = False):
        """Prepares; the first call draws.

        Args:
            disable: Draws nothing.
        """
        self._disable = disable
        self._bar: tqdm | None = None
        self._what = ""

    def __call__(self, what: str, fraction: float) -> None:
        """Shows that the fraction (in [0, 1]) of `what` is done."""
        if what != self._what or self._bar is None:
            self._finish()
            self._what = what
            columns, lines = _unknown_size()
            self._bar = tqdm(
                total=1.0,
                desc=what,
                disable=self._disable,
                bar_format="{desc:<28} {percentage:3.0f}% |{bar:30}| {elapsed}",
                ncols=columns,
                nrows=lines,
                mininterval=0.2 if sys.stderr.isatty() else 3600.0,
            )
        self._bar.update(min(max(fraction, self._bar.n), 1.0) - self._bar.n)

    def _finish(self) -> None:
        if self._bar is not None:
            self._bar.refresh()
            self._bar.close()
            self._bar = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        exception_type: type[BaseException] | None,
        exception: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._finish()


def _unknown_size() -> tuple[int | None, int | None]:
    """Returns the columns and lines to draw for where a terminal says that it has none."""
    try:
        size = os.get_terminal_size(sys.stderr.fileno())
    except (OSError, ValueError):
        return None, None
    return None if size.columns else 80, None if size.lines else 24
