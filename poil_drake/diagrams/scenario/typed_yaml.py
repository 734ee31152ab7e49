"""Reads YAML into frozen dataclasses and Drake's own schema types, with errors worth reading.

Drake's `yaml_load_typed` does the work for Drake's types. It cannot fill frozen dataclasses or
tuples, and its errors name neither the place nor the valid keys; that is what is added here.
"""

import collections.abc
import dataclasses
import difflib
import types
import typing
from fractions import Fraction
from typing import Any

import numpy as np
from pydrake.common.yaml import yaml_dump, yaml_load_typed

from poil_drake.errors import PoilError, ScenarioError


def merge_yaml(*, node: Any, schema: Any, default: Any, path: str = "") -> Any:
    """Returns `default` with everything that the YAML node says put in its place.

    Dataclasses and mappings are merged key by key; lists and scalars are replaced.

    Args:
        node: What `yaml_load` returned: mappings, lists, scalars.
        schema: The type wanted: a dataclass, one of Drake's types with `__fields__`, a scalar,
            or Optional, Union, list, tuple or Mapping[str, ...] of those.
        default: The value that the node changes, or None where there is none.
        path: Where in the document the node stands, for errors, e.g. "poil.rates".

    Raises:
        ScenarioError: naming the place, the value and the valid choices.
    """
    schema, optional = _strip_optional(schema)
    if node is None and optional:
        return None
    base, arguments = typing.get_origin(schema), typing.get_args(schema)
    if dataclasses.is_dataclass(schema):
        return _merge_dataclass(node, schema, default, path)
    if base is tuple:
        return _merge_tuple(node, arguments, path)
    if base in (dict, collections.abc.Mapping):
        _require(node, collections.abc.Mapping, "a mapping of names to values", path)
        merged = dict(default or {})
        for key, value in node.items():
            merged[str(key)] = merge_yaml(
                node=value, schema=arguments[1], default=merged.get(key), path=f"{path}.{key}"
            )
        return merged
    if base is list:
        _require(node, list, "a list", path)
        return [
            merge_yaml(node=item, schema=arguments[0], default=None, path=f"{path}[{i}]")
            for i, item in enumerate(node)
        ]
    if schema is float and isinstance(node, str) and "/" in node:
        try:
            return float(Fraction(node))
        except (ValueError, ZeroDivisionError) as error:
            raise _wrong(path, node, "a number or a fraction such as 1/8") from error
    return _merge_drake(node, schema, default, path)


def _merge_dataclass(node: Any, schema: Any, default: Any, path: str) -> Any:
    _require(node, collections.abc.Mapping, f"a mapping ({schema.__name__})", path)
    tag = str(node.get("_tag", "")).removeprefix("!")
    if tag not in ("", schema.__name__):
        raise _wrong(path, f"!{tag}", f"!{schema.__name__}, the only kind there is,")
    fields = {f.name: f.type for f in dataclasses.fields(schema) if f.metadata.get("yaml", True)}
    _check_keys(node, fields, path)
    default = schema() if default is None else default
    values = {
        key: merge_yaml(
            node=value,
            schema=fields[key],
            default=getattr(default, key),
            path=f"{path}.{key}" if path else key,
        )
        for key, value in node.items()
        if key != "_tag"
    }
    try:
        return dataclasses.replace(default, **values)
    except ScenarioError:
        raise
    except PoilError as error:
        raise ScenarioError(f"{path}: {error.problem}", remedy=error.remedy) from error


def _merge_tuple(node: Any, arguments: tuple, path: str) -> tuple:
    _require(node, list, "a list", path)
    if arguments[-1] is Ellipsis:
        arguments = (arguments[0],) * len(node)
    if len(node) != len(arguments):
        raise _wrong(path, node, f"a list of {len(arguments)} values")
    return tuple(
        merge_yaml(node=item, schema=argument, default=None, path=f"{path}[{i}]")
        for i, (item, argument) in enumerate(zip(node, arguments, strict=True))
    )


def _merge_drake(node: Any, schema: Any, default: Any, path: str) -> Any:
    """Lets Drake read what is not ours: scalars, arrays, unions, bound C++ types."""
    _check_drake_keys(node, schema, path)
    member = _union_member(schema, node)
    if member is not None and dataclasses.is_dataclass(member):
        default = default if type(default) is member else None
        return _merge_dataclass(node, member, default, path)
    holder = dataclasses.make_dataclass("_Holder", [("value", schema, None)])()
    if default is not None:
        holder.value = default
    elif hasattr(schema, "__fields__") or schema in (bool, int, float, str):
        holder.value = schema()
    try:
        return yaml_load_typed(
            data=yaml_dump({"value": node}), defaults=holder, schema=type(holder)
        ).value
    except _DRAKE_ERRORS as error:
        _find_culprit(node, schema, path)
        raise _misfit(node, schema, path, error) from error


_KINDS = {
    str: "text (in quotes where it looks like a number)",
    float: "a number",
    int: "a whole number",
    bool: "true or false",
    np.ndarray: "a list of numbers",
}

_DRAKE_ERRORS = (RuntimeError, ValueError, TypeError, AttributeError, AssertionError)


def _find_culprit(node: Any, schema: Any, path: str) -> None:
    """Raises for the innermost value that is wrong, if it is wrong by itself."""
    schema, _ = _strip_optional(schema)
    schema = _union_member(schema, node) or schema
    if typing.get_origin(schema) is list and isinstance(node, list):
        for i, item in enumerate(node):
            _merge_drake(item, typing.get_args(schema)[0], None, f"{path}[{i}]")
    elif hasattr(schema, "__fields__") and isinstance(node, collections.abc.Mapping):
        fields = {f.name: f.type for f in schema.__fields__}
        for key, value in node.items():
            if key != "_tag":
                _merge_drake(value, fields[key], None, f"{path}.{key}")


def _misfit(node: Any, schema: Any, path: str, error: Exception) -> ScenarioError:
    """Returns the error of a value that Drake could not make anything of."""
    schema, _ = _strip_optional(schema)
    if schema in _KINDS:
        return _wrong(path, node, _KINDS[schema])
    if not _is_union(schema):
        return _wrong(path, node, f"{getattr(schema, '__name__', schema)}{_reason(error)}")
    member = _union_member(schema, node)
    if member is not None and member not in _KINDS:
        return _wrong(path, node, f"!{_tag(member)}{_reason(error)}")
    given = node.get("_tag", node) if isinstance(node, collections.abc.Mapping) else node
    return _wrong(path, given, " or ".join(_choices(schema)))


def _tag(member: type) -> str:
    """Returns the YAML tag of a union's member; Drake's templates are named with parameters."""
    return member.__name__.partition("𝓣")[0]


def _choices(schema: Any) -> list[str]:
    """Returns what the author of a scenario may write for a union."""
    members = [_strip_optional(member)[0] for member in typing.get_args(schema)]
    choices = [_KINDS[member] for member in members if member in _KINDS]
    mappings = [m for m in members if dataclasses.is_dataclass(m) or hasattr(m, "__fields__")]
    # Drake marks with an underscore what is there for its own error messages.
    tags = [f"!{_tag(member)}" for member in mappings if not member.__name__.startswith("_")]
    if len(tags) > 1:
        choices.append(f"a mapping with one of the tags {', '.join(tags)}")
    elif tags:
        choices.append(f"a mapping with the tag {tags[0]}")
    return choices


def _reason(error: Exception) -> str:
    """Returns what Drake says about a value, in parentheses, if it helps a reader."""
    reason = " ".join(str(error).split())
    # The bindings list the C++ signatures that did not fit, and assertions repeat the value.
    if isinstance(error, AssertionError) or "incompatible function arguments" in reason:
        return ""
    return f" ({reason})"


def _check_drake_keys(node: Any, schema: Any, path: str) -> None:
    """Looks for misspelt keys at any depth of Drake's own types."""
    schema, _ = _strip_optional(schema)
    schema = _union_member(schema, node) or schema
    if typing.get_origin(schema) is list and isinstance(node, list):
        for i, item in enumerate(node):
            _check_drake_keys(item, typing.get_args(schema)[0], f"{path}[{i}]")
    if hasattr(schema, "__fields__") and isinstance(node, collections.abc.Mapping):
        fields = {f.name: f.type for f in schema.__fields__}
        _check_keys(node, fields, path)
        for key, value in node.items():
            if key != "_tag":
                _check_drake_keys(value, fields[key], f"{path}.{key}")


def _check_keys(
    node: collections.abc.Mapping, fields: collections.abc.Iterable[str], path: str
) -> None:
    valid = list(fields)
    for key in node:
        if key != "_tag" and key not in valid:
            where = f" in '{path}'" if path else ""
            raise ScenarioError(
                f"The key '{key}'{where} is not known.{_did_you_mean(str(key), valid)}",
                remedy=f"Valid keys: {', '.join(valid)}.",
            )


def _did_you_mean(given: str, valid: collections.abc.Iterable[str]) -> str:
    close = difflib.get_close_matches(given, list(valid), n=1)
    return f" Did you mean '{close[0]}'?" if close else ""


def _is_union(schema: Any) -> bool:
    return typing.get_origin(schema) in (typing.Union, types.UnionType)


def _strip_optional(schema: Any) -> tuple[Any, bool]:
    """Returns T and True for Optional[T], else the schema as it is and False."""
    if _is_union(schema):
        arguments = typing.get_args(schema)
        if len(arguments) == 2 and arguments[1] is type(None):
            return arguments[0], True
    return schema, False


def _union_member(schema: Any, node: Any) -> Any:
    """Returns the member of a union that a mapping's tag chooses (the first without a tag)."""
    if not (_is_union(schema) and isinstance(node, collections.abc.Mapping)):
        return None
    members = typing.get_args(schema)
    tag = str(node.get("_tag", "")).removeprefix("!")
    return next((m for m in members if _tag(m) == tag), None if tag else members[0])


def _require(node: Any, kind: type, wanted: str, path: str) -> None:
    if not isinstance(node, kind):
        raise _wrong(path, node, wanted)


def _wrong(path: str, node: Any, wanted: str) -> ScenarioError:
    return ScenarioError(
        f"'{path or 'the scenario'}' is {node!r}, but {wanted} is needed.",
        remedy="Correct the value in the scenario.",
    )
