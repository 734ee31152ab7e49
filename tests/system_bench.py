"""A system under test in a simulator, with ports by name."""

from typing import Any

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import PortDataType, System
from pydrake.systems.sensors import ImageDepth32F, ImageLabel16I, ImageRgba8U

START = 1_790_000_000.0
"""The time of a bench's clock at time zero [s since the epoch]."""


class SystemBench:
    """Simulates a system, alone or in a diagram.

    Attributes:
        dut: The system under test.
        simulator: Simulates the dut, or the diagram that it is in.
        context: The dut's own context.
    """

    def __init__(self, dut: System, diagram: System | None = None, **inputs: Any):
        self.dut = dut
        self.simulator = Simulator(diagram or dut)
        self.context = dut.GetMyMutableContextFromRoot(self.simulator.get_mutable_context())
        self.fix(**inputs)

    @property
    def time(self) -> float:
        return self.context.get_time()

    def now(self) -> float:
        """Returns the time of a clock that runs with the simulation [s since the epoch]."""
        return START + self.time

    def fix(self, port: str | None = None, value: Any = None, /, **values: Any) -> None:
        """Fixes input ports: `fix(width=0.04)`, or `fix("hand.width", 0.04)` for dotted names.

        Vector ports take scalars, lists and arrays of any shape; abstract ports take any value.
        """
        for name, given in (values if port is None else {port: value}).items():
            target = self.dut.GetInputPort(name)
            is_vector = target.get_data_type() == PortDataType.kVectorValued
            target.FixValue(self.context, np.ravel(given) if is_vector else given)

    def read(self, port: str) -> Any:
        """Evaluates an output port; images are copied into arrays."""
        value = self.dut.GetOutputPort(port).Eval(self.context)
        is_image = isinstance(value, ImageRgba8U | ImageDepth32F | ImageLabel16I)
        return np.array(value.data) if is_image else value

    def advance(self, duration: float) -> None:
        self.advance_to(self.time + duration)

    def advance_to(self, time: float) -> None:
        self.simulator.AdvanceTo(time)
