"""Counts stop requests, from the browser page and from other sources."""

import threading

from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from poil_drake.systems.control_period import CONTROL_PERIOD

BUTTON = "Stop"
"""The button on the Meshcat page."""

BUTTON_KEY = "Escape"
"""The key that presses the button while the page has the focus."""


class StopSwitch:
    """Counts stop requests from any thread, whether made by a key, a signal or a program."""

    def __init__(self) -> None:
        self._lock, self._requests = threading.Lock(), 0

    def request(self) -> None:
        """Requests a stop."""
        with self._lock:
            self._requests += 1

    @property
    def requests(self) -> int:
        """Number of requests so far."""
        return self._requests


class StopRequests(LeafSystem):
    """Outputs the number of stop requests.

    .. pydrake_system::

        name: StopRequests
        output_ports:
        - stop

    `stop` (1,) is the number of clicks on the Meshcat button plus the requests of the `StopSwitch`:
    discrete state, updated once per period. It is 0 before the first update.
    """

    def __init__(
        self,
        *,
        period: float = CONTROL_PERIOD,
        meshcat: Meshcat | None = None,
        switch: StopSwitch | None = None,
    ):
        """Constructs the system, and adds the button to the page.

        Args:
            period: The control period [s].
            meshcat: The page of the button; None for no button.
            switch: Counts all other requests; None for none.
        """
        super().__init__()
        self._meshcat, self._switch, self._clicks = meshcat, switch, 0
        if meshcat is not None:
            meshcat.AddButton(BUTTON, BUTTON_KEY)
        self.DeclareStateOutputPort("stop", self.DeclareDiscreteState(1))
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def close(self) -> None:
        """Removes the button from the page. Earlier clicks still count; the switch still works."""
        self._count_clicks()
        if self._meshcat is not None:
            self._meshcat.DeleteButton(BUTTON, strict=False)
            self._meshcat = None

    def _count_clicks(self) -> None:
        if self._meshcat is not None:
            self._clicks = self._meshcat.GetButtonClicks(BUTTON)

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        self._count_clicks()
        requests = self._clicks + (self._switch.requests if self._switch is not None else 0)
        discrete_state.set_value([requests])
