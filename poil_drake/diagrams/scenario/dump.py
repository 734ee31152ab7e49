"""Writes a scenario as the YAML text that `LoadScenario` reads."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydrake.common.yaml import yaml_dump, yaml_dump_typed, yaml_load

from poil_drake.diagrams.scenario.hardware_config import CameraSource
from poil_drake.diagrams.scenario.scenario import Scenario


def DumpScenario(scenario: Scenario, *, named: bool = True) -> str:
    """Returns a scenario as YAML text.

    The text holds every value, including defaults and randomized values, so that loading it gives
    the same scenario even if defaults change. Of the models, it holds only the files' paths.

    Args:
        scenario: The scenario.
        named: Whether the scenario's name is the text's only top-level key, as in a scenario file.
            Without the name, `LoadScenario` accepts the text as `data`.
    """
    node = _node(scenario)
    return yaml_dump({scenario.source.name or "Scenario": node} if named else node)


def _node(value: Any) -> Any:
    """Converts a scenario's value to mappings, lists and scalars, which `yaml_dump` can write."""
    if dataclasses.is_dataclass(value):
        written = [f for f in dataclasses.fields(value) if f.metadata.get("yaml", True)]
        node = {field.name: _node(getattr(value, field.name)) for field in written}
        if isinstance(value, CameraSource):  # A union needs the member's tag.
            node = {"_tag": f"!{type(value).__name__}", **node}
        return node
    if isinstance(value, Mapping):
        return {str(key): _node(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_node(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if hasattr(value, "__fields__"):
        return yaml_load(data=yaml_dump_typed(value, schema=type(value)))
    return value
