"""Exports the ports of a station's systems under the names that all stations share."""

from collections.abc import Sequence

from pydrake.systems.framework import DiagramBuilder, System

COMMANDS = ("velocity", "velocity_time")
"""Names of an arm's input ports."""

MEASUREMENTS = ("position_measured", "velocity_measured", "torque_external")
"""Names of an arm's output ports, except `status`."""


def ExportPorts(builder: DiagramBuilder, system: System, names: Sequence[str], model: str) -> None:
    """Exports the named input and output ports of a system as "<model>.<name>"."""
    for name in names:
        if system.HasInputPort(name):
            builder.ExportInput(system.GetInputPort(name), f"{model}.{name}")
        else:
            builder.ExportOutput(system.GetOutputPort(name), f"{model}.{name}")


def ExportOutputs(builder: DiagramBuilder, system: System) -> None:
    """Exports all output ports of a system under their own names."""
    for k in range(system.num_output_ports()):
        port = system.get_output_port(k)
        builder.ExportOutput(port, port.get_name())
