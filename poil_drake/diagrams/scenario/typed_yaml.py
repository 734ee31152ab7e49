"""Merges parsed YAML into frozen dataclasses and Drake's own schema types.

Drake's `yaml_load_typed` supports neither frozen dataclasses nor tuples, and does not say where a
mistake is. Pydantic supports neither YAML tags nor Drake's C++ types, and does not merge values
into defaults.
"""

import copy
import dataclasses
import difflib
import math
import types
import typing
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from poil_drake.errors import PoilError, ScenarioError

_WANTED = {
    str: "text (in quotes if it looks like a number)",
    float: "a finite number or a fraction such as 1/8",
    int: "a whole number",
    bool: "true or false",
    np.ndarray: "a list of finite numbers",
    list: "a list",
    tuple: "a list",
    dict: "a mapping of names to values",
    Mapping: "a mapping of names to values",
}


def merge_yaml(
    node: Any, schema: Any, default: Any, *, path: str = "", unknown: list[str] | None = None
) -> Any:
    """Returns `default`, changed wherever the YAML node gives a value.

    Structures (dataclasses and Drake's types) and mappings are merged key by key; lists and
    scalars are replaced. A tag such as `!Rpy` chooses a member of a union; a node without a tag
    has the type of the first member.

    Args:
        node: The result of Drake's `yaml_load`: mappings, lists, scalars.
        schema: The expected type: a dataclass, one of Drake's types with `__fields__`, a scalar,
            np.ndarray, or an Optional, Union, list, tuple or Mapping[str, ...] of these types.
        default: The value that the node changes. None starts from the schema's defaults.
        path: The node's place in the document, for errors, e.g. "poil.rates".
        unknown: A list that receives the paths of unknown keys, which are then skipped. If None,
            an unknown key raises an error.

    Raises:
        ScenarioError: The node does not fit the schema. The text states the place, the value and
            the valid choices.
    """
    is_union = typing.get_origin(schema) in (typing.Union, types.UnionType)
    members = typing.get_args(schema) if is_union else (schema,)
    if node is None and type(None) in members:
        return None
    members = tuple(member for member in members if member is not type(None))
    tag = str(node.get("_tag", "")) if isinstance(node, Mapping) else ""
    tagged = next((member for member in members if f"!{_tag(member)}" == tag), None)
    schema = tagged if tag else members[0]
    base, arguments = typing.get_origin(schema) or schema, typing.get_args(schema)
    wanted = _wanted(members)
    if isinstance(node, Mapping):
        fields = _fields(schema)
        if fields is not None:
            if type(default) is not schema:
                required = _required(schema)
                if missing := [name for name in required if name not in node]:
                    raise ScenarioError(
                        f"'{path}' has no '{missing[0]}'.",
                        remedy="Add it to the scenario.",
                    )
                default = schema if required else schema()
            return _merge_structure(node, fields, default, path, unknown)
        if base in (dict, Mapping):
            merged = dict(default or {})
            for key, value in node.items():
                merged[key] = merge_yaml(
                    value, arguments[1], merged.get(key), path=f"{path}.{key}", unknown=unknown
                )
            return merged
    elif isinstance(node, list) and base in (list, tuple):
        if base is list or arguments[-1] is Ellipsis:
            arguments = (arguments[0],) * len(node)
        if len(arguments) == len(node):
            return base(
                merge_yaml(item, argument, None, path=f"{path}[{i}]", unknown=unknown)
                for i, (item, argument) in enumerate(zip(node, arguments, strict=True))
            )
        wanted = f"a list of {len(arguments)} values"
    elif base not in (list, tuple, dict, Mapping):
        try:
            value = _scalar_or_array(node, schema)
            if schema is not float or not np.isnan(value):
                return value
        except (ValueError, TypeError, ArithmeticError):
            pass
    raise _wrong(path, tag or node, wanted)


def _scalar_or_array(node: Any, schema: type) -> Any:
    """Returns a node converted to a type; raises an error if the node's meaning would change."""
    given = type(node)
    if schema is np.ndarray and given in (list, int, float):
        if not all(type(value) in (int, float) for value in np.array(node, dtype=object).flat):
            raise TypeError
        return np.asarray_chkfinite(node, dtype=float)
    if schema is float and given is str and "/" in node:
        return float(Fraction(node))
    if given is schema or (schema is float and given in (int, str)):
        return schema(node)
    if schema is int and (given is str or (given is float and node.is_integer())):
        return int(node)
    raise TypeError


def _merge_structure(
    node: Mapping, fields: Mapping[str, Any], default: Any, path: str, unknown: list[str] | None
) -> Any:
    """Returns a copy of `default`, a dataclass or one of Drake's types, with the node's values.

    If `default` is a dataclass itself, not an instance, it is constructed with the node's values.
    """
    values = {}
    for key, value in node.items():
        place = f"{path}.{key}" if path else key
        if key == "_tag":
            continue
        if key not in fields:
            if unknown is None:
                where = f" in '{path}'" if path else ""
                close = difflib.get_close_matches(key, fields, n=1)
                guess = f" Did you mean '{close[0]}'?" if close else ""
                raise ScenarioError(
                    f"The key '{key}'{where} is not known.{guess}",
                    remedy=f"Valid keys: {', '.join(fields)}.",
                )
            unknown.append(place)
            continue
        values[key] = merge_yaml(
            value, fields[key], getattr(default, key, None), path=place, unknown=unknown
        )
        # Only what is infinite by default may be: durations, sides of regions.
        usual = getattr(default if isinstance(default, type) else type(default), key, None)
        if _is_infinite(values[key]) and not _is_infinite(usual):
            raise _wrong(place, value, _WANTED[float])
    if dataclasses.is_dataclass(default):
        try:
            if isinstance(default, type):
                return default(**values)
            return dataclasses.replace(default, **values)
        except ScenarioError:
            raise
        except PoilError as error:
            # Users know the key, not the class.
            own, key = f"{type(default).__name__}.", f"{path}."
            problem = error.problem.replace(own, key)
            problem = problem if key in problem else f"{path}: {problem}"
            raise ScenarioError(problem, remedy=error.remedy.replace(own, key)) from error
    merged = copy.deepcopy(default)
    for key, value in values.items():
        try:
            setattr(merged, key, value)
        except (RuntimeError, ValueError, TypeError) as error:
            size = np.size(getattr(default, key))
            if isinstance(value, np.ndarray) and value.shape != (size,):
                raise _wrong(f"{path}.{key}", node[key], f"a list of {size} numbers") from error
            reason = " ".join(str(error).split())
            # This text only lists the C++ signatures that did not match.
            reason = "" if "incompatible function arguments" in reason else f" ({reason})"
            wanted = f"a value that {_tag(type(default))} accepts{reason}"
            raise _wrong(f"{path}.{key}", node[key], wanted) from error
    return merged


def _is_infinite(value: Any) -> bool:
    """Returns whether a number, or one in a tuple, is infinite."""
    values = value if isinstance(value, tuple) else (value,)
    return any(one in (math.inf, -math.inf) for one in values if isinstance(one, float))


def _fields(schema: Any) -> dict[str, Any] | None:
    """Returns key -> type of a dataclass or one of Drake's types; None for any other schema."""
    if dataclasses.is_dataclass(schema):
        return {f.name: f.type for f in dataclasses.fields(schema) if f.metadata.get("yaml", True)}
    fields = getattr(schema, "__fields__", None)
    return None if fields is None else {f.name: f.type for f in fields}


def _required(schema: Any) -> list[str]:
    """Returns the names of a dataclass's fields that have no default."""
    if not dataclasses.is_dataclass(schema):
        return []
    missing = dataclasses.MISSING
    return [
        f.name
        for f in dataclasses.fields(schema)
        if f.default is missing and f.default_factory is missing
    ]


def _tag(member: type) -> str:
    """Returns a type's YAML tag: its name, without the parameters of a C++ template."""
    return member.__name__.partition("𝓣")[0]


def _wanted(members: Sequence[Any]) -> str:
    """Returns a phrase for the values that the types accept, e.g. "true or false"."""
    bases = [typing.get_origin(member) or member for member in members]
    choices = [_WANTED[base] for base in bases if base in _WANTED]
    # Drake marks members that exist only for its own error messages with an underscore.
    names = [_tag(base) for base in bases if base not in _WANTED and base.__name__[0] != "_"]
    if len(members) == 1 and names:
        choices.append(f"a mapping ({names[0]})")
    elif names:
        choices.append(f"a mapping with one of the tags {', '.join(f'!{name}' for name in names)}")
    return " or ".join(choices)


def _wrong(path: str, node: Any, wanted: str) -> ScenarioError:
    return ScenarioError(
        f"'{path or 'the scenario'}' is {node!r}, but {wanted} is needed.",
        remedy="Correct the value in the scenario.",
    )
