"""The ports of a system and the connections of a diagram, by name."""

from pydrake.systems.framework import Diagram, System


def ports(system: System) -> tuple[dict[str, int], dict[str, int]]:
    """Returns the sizes of a system's input ports and of its output ports."""
    inputs = [system.get_input_port(k) for k in range(system.num_input_ports())]
    outputs = [system.get_output_port(k) for k in range(system.num_output_ports())]
    return {p.get_name(): p.size() for p in inputs}, {p.get_name(): p.size() for p in outputs}


def wires(diagram: Diagram) -> set[tuple[str, str]]:
    """Returns the connected pairs of an output port and an input port."""
    return {
        (
            f"{source.get_name()}.{source.get_output_port(output).get_name()}",
            f"{sink.get_name()}.{sink.get_input_port(input_).get_name()}",
        )
        for (sink, input_), (source, output) in diagram.connection_map().items()
    }
