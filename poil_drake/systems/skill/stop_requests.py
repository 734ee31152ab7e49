"""Counts how often somebody asked for a stop: at the browser page, or by a switch."""

import threading

from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

BUTTON = "Stop"
"""The button on the Meshcat page."""

BUTTON_KEY = "Escape"
"""The key that presses it while the page has the focus."""


class StopSwitch:
    """Something that anybody may press, from any thread: a key, a signal, a program."""

    def __init__(self) -> None:
        self._lock, self._requests = threading.Lock(), 0

    def request(self) -> None:
        """Asks for a stop."""
        with self._lock:
            self._requests += 1

    @property
    def requests(self) -> int:
        """How often a stop was asked for."""
        return self._requests


class StopRequests(LeafSystem):
    """Shows how often a stop was asked for.

    .. pydrake_system::

        name: StopRequests
        output_ports:
        - stop

    `stop` (1,) is the number of requests so far, discrete state that looks at the button and the
    switch every period. Before the first update it is 0; what was asked for earlier counts then.
    """

    def __init__(
        self, *, period: float, meshcat: Meshcat | None = None, switch: StopSwitch | None = None
    ):
        """Constructs the system, and puts the button on the page.

        Args:
            period: The control period [s].
            meshcat: Whose page gets the button; None for no button.
            switch: What else stops; None for nothing else.
        """
        super().__init__()
        self._meshcat, self._switch, self._clicks_before_close = meshcat, switch, 0
        if meshcat is not None:
            meshcat.AddButton(BUTTON, BUTTON_KEY)
        self.DeclareStateOutputPort("stop", self.DeclareDiscreteState(1))
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._look)

    def close(self) -> None:
        """Takes the button off the page; its clicks still count, and the switch goes on."""
        if self._meshcat is not None:
            self._clicks_before_close = self._clicks()
            self._meshcat.DeleteButton(BUTTON, strict=False)
            self._meshcat = None

    def _look(self, context: Context, discrete_state: DiscreteValues) -> None:
        requests = self._clicks() + (self._switch.requests if self._switch is not None else 0)
        discrete_state.get_mutable_vector().SetAtIndex(0, requests)

    def _clicks(self) -> int:
        if self._meshcat is None:
            return self._clicks_before_close
        return self._meshcat.GetButtonClicks(BUTTON)
