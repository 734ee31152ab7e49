"""A progress bar for the command line."""

import shutil
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
            self._what, size = what, shutil.get_terminal_size()
            self._bar = tqdm(
                total=1.0,
                desc=what,
                disable=self._disable,
                bar_format="{desc:<28} {percentage:3.0f}% |{bar:30}| {elapsed}",
                # Some terminals say that they have no columns and rows.
                ncols=size.columns,
                nrows=size.lines,
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
