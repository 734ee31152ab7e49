"""Progress bars for the command line."""

import os
import sys
from contextlib import AbstractContextManager
from typing import Any

from tqdm import tqdm


class OneLineTqdm(tqdm):
    """A tqdm bar that writes only its last state if standard error is not a terminal."""

    def __init__(self, *args: Any, **kwargs: Any):
        """Takes the arguments of tqdm."""
        self._drawn = sys.stderr.isatty()
        super().__init__(*args, **kwargs)

    def display(self, *args: Any, **kwargs: Any) -> None:
        """Draws the bar if standard error is a terminal."""
        if self._drawn:
            super().display(*args, **kwargs)

    def clear(self, *args: Any, **kwargs: Any) -> None:
        """Wipes the bar if standard error is a terminal."""
        if self._drawn:
            super().clear(*args, **kwargs)

    def close(self) -> None:
        """Draws the bar for the last time."""
        self._drawn = True
        super().close()


class ProgressBar(AbstractContextManager["ProgressBar"]):
    """A progress bar for successive steps; use it in a `with` block.

    Call it with the name of the step and the fraction done. A new name begins a new bar.
    """

    def __init__(self, *, disable: bool = False):
        """Prepares the bar; the first call draws it.

        Args:
            disable: Whether to draw nothing.
        """
        self._disable = disable
        self._bar: OneLineTqdm | None = None
        self._step = ""

    def __call__(self, step: str, fraction: float) -> None:
        """Moves the bar forward to a fraction, in [0, 1], of the step."""
        if step != self._step or self._bar is None:
            self._finish()
            self._step = step
            columns, lines = _default_size()
            self._bar = OneLineTqdm(
                total=1.0,
                desc=step,
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

    def __exit__(self, *exception: object) -> None:
        self._finish()


class StatusLine(AbstractContextManager["StatusLine"]):
    """One line on the terminal that changes; drawn only if standard error is a terminal.

    Use it in a `with` block, and call it with the text of the line.
    """

    def __init__(self) -> None:
        columns, lines = _default_size()
        self._bar = OneLineTqdm(
            total=0, bar_format="{desc}", ncols=columns, nrows=lines, leave=False
        )

    def __call__(self, text: str) -> None:
        """Shows a text in place of the last one."""
        self._bar.set_description_str(text)

    def say(self, text: str) -> None:
        """Prints a line above the changing one."""
        self._bar.clear()
        print(text, flush=True)
        self._bar.refresh()

    def __exit__(self, *exception: object) -> None:
        self._bar.clear()
        tqdm.close(self._bar)


def _default_size() -> tuple[int | None, int | None]:
    """Returns tqdm's `ncols` and `nrows`: 80 and 24 if the terminal reports 0, otherwise None."""
    try:
        size = os.get_terminal_size(sys.stderr.fileno())
    except (OSError, ValueError):
        return None, None
    return None if size.columns else 80, None if size.lines else 24
