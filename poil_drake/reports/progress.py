"""Progress bars for the command line."""

import os
import sys
from types import TracebackType
from typing import Any, Self

from tqdm import tqdm


class OneLineTqdm(tqdm):
    """A tqdm bar that, where standard error is no terminal, writes one line: once it is closed."""

    def __init__(self, *args: Any, **kwargs: Any):
        """Takes what tqdm takes."""
        self._drawn = sys.stderr.isatty()
        super().__init__(*args, **kwargs)

    def display(self, *args: Any, **kwargs: Any) -> None:
        """Draws the bar, on a terminal."""
        if self._drawn:
            super().display(*args, **kwargs)

    def clear(self, *args: Any, **kwargs: Any) -> None:
        """Wipes the bar, on a terminal."""
        if self._drawn:
            super().clear(*args, **kwargs)

    def close(self) -> None:
        """Draws the bar for the last time."""
        self._drawn = True
        super().close()


class ProgressBar:
    """Shows what is being done and how far it is; a `with` block.

    Calling it with (what, fraction in [0, 1]) moves the bar; a new `what` begins a new bar.
    """

    def __init__(self, *, disable: bool = False):
        """Prepares; the first call draws.

        Args:
            disable: Draws nothing.
        """
        self._disable = disable
        self._bar: OneLineTqdm | None = None
        self._what = ""

    def __call__(self, what: str, fraction: float) -> None:
        """Shows that the fraction (in [0, 1]) of `what` is done."""
        if what != self._what or self._bar is None:
            self._finish()
            self._what = what
            columns, lines = _unknown_size()
            self._bar = OneLineTqdm(
                total=1.0,
                desc=what,
                disable=self._disable,
                bar_format="{desc:<28} {percentage:3.0f}% |{bar:30}| {elapsed}",
                ncols=columns,
                nrows=lines,
                mininterval=0.2,
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
