"""Finds and reads scenarios from YAML files and text."""

import copy
import dataclasses
import math
from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml
from pydrake.common.yaml import yaml_load

from poil_drake.diagrams.scenario.scenario import Scenario, ScenarioSource
from poil_drake.diagrams.scenario.typed_yaml import merge_yaml
from poil_drake.errors import ScenarioError

_LARGEST_TEXT = 1_000_000
"""More than any scenario needs [characters]."""

_MOST_VALUES = 100_000
"""More than any scenario holds."""

DEFAULT_SCENARIO_NAME = "HangMug"
"""The scenario of the default file that runs when none is named."""


def default_scenario_file() -> Path:
    """Returns the path of the scenario file that comes with the package."""
    return Path(str(files("poil_drake") / "models" / "scenarios" / "hang_mug.yaml"))


def LoadScenario(
    *,
    filename: str | Path | None = None,
    data: str | None = None,
    scenario_name: str | None = None,
    defaults: Scenario | None = None,
) -> Scenario:
    """Reads a scenario from a file and then, over it, from text.

    Args:
        filename: A YAML file whose top-level keys are names of scenarios. None: no file, only
            `defaults` and `data`.
        data: YAML text that changes single values of the scenario, e.g.
            "{poil: {eta: 2.0}, random_seed: 3}". Directives are replaced, not added to.
        scenario_name: Which scenario of the file; may be left out where the file has just one,
            or one named "HangMug".
        defaults: What the file and the text change.

    Raises:
        ScenarioError: in one line, what is wrong, where, and what would be right.
    """
    scenario = copy.deepcopy(defaults) if defaults is not None else Scenario()
    if filename is not None:
        path = Path(filename)
        name, node = _named_scenario(_read(path), scenario_name, path)
        scenario = merge_yaml(
            node=_anchored(node, path.resolve().parent), schema=Scenario, default=scenario
        )
        source = ScenarioSource(name=name, file=str(path))
        scenario = dataclasses.replace(scenario, source=source)
    if data is not None:
        node = _parse(data, "the scenario text")
        scenario = merge_yaml(node=_anchored(node, Path.cwd()), schema=Scenario, default=scenario)
    return scenario


def _read(path: Path) -> Any:
    try:
        with path.open(encoding="utf-8") as stream:
            text = stream.read(_LARGEST_TEXT + 1)
    except OSError as error:
        raise ScenarioError(
            f"The scenario file '{path}' cannot be read ({error.strerror}).",
            remedy=f"Give an existing file, e.g. the package's own: {default_scenario_file()}",
        ) from error
    except UnicodeDecodeError as error:
        raise ScenarioError(
            f"The scenario file '{path}' is not text in UTF-8 (byte {error.start}).",
            remedy="Give a YAML file, and save it in UTF-8.",
        ) from error
    return _parse(text, f"'{path}'")


def _parse(text: str, source: str) -> Any:
    if not text.strip():
        return {}
    if len(text) > _LARGEST_TEXT:
        raise ScenarioError(
            f"{source} has more than {_LARGEST_TEXT} characters.",
            remedy="No scenario has; give the file of one.",
        )
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
        if _unfolded_size(root, {}) > _MOST_VALUES:
            raise ScenarioError(
                f"{source} unfolds to more than {_MOST_VALUES} values: its anchors stand for "
                "others again and again.",
                remedy="Write out what is meant.",
            )
        _refuse_repeated_keys(root, source, set())
        node = yaml_load(data=text)
    except yaml.YAMLError as error:
        reason = " ".join(str(error).split())
        raise ScenarioError(
            f"{source} is not valid YAML: {reason}.", remedy="Correct the YAML."
        ) from error
    return {} if node is None else node


def _unfolded_size(node: yaml.Node | None, known: dict[int, float]) -> float:
    """Returns how many values a node holds when all aliases are written out; inf if endless."""
    if node is None or isinstance(node, yaml.ScalarNode):
        return 1.0
    if id(node) not in known:
        known[id(node)] = math.inf  # What is met again within itself never ends.
        pairs = isinstance(node, yaml.MappingNode)
        parts = [part for pair in node.value for part in pair] if pairs else node.value
        known[id(node)] = 1.0 + sum(_unfolded_size(part, known) for part in parts)
    return known[id(node)]


def _refuse_repeated_keys(node: yaml.Node | None, source: str, seen: set[int]) -> None:
    """Checks that keys are words, each written once: YAML would quietly keep the last."""
    if node is None or id(node) in seen:
        return
    seen.add(id(node))
    if isinstance(node, yaml.SequenceNode):
        for item in node.value:
            _refuse_repeated_keys(item, source, seen)
    if not isinstance(node, yaml.MappingNode):
        return
    keys = set()
    for key, value in node.value:
        line = key.start_mark.line + 1
        if not key.tag.endswith((":str", ":merge")):
            raise ScenarioError(
                f"{source} has a key that is no text, in line {line}.",
                remedy="Use words as keys, in quotation marks where YAML takes them for others.",
            )
        if key.value in keys:
            raise ScenarioError(
                f"{source} has the key '{key.value}' twice in one place, again in line {line}.",
                remedy="Join the two.",
            )
        keys.add(key.value)
        _refuse_repeated_keys(value, source, seen)


def _named_scenario(document: Any, name: str | None, path: Path) -> tuple[str, Any]:
    """Returns a scenario of a file with its name."""
    if not isinstance(document, dict) or not document:
        raise ScenarioError(
            f"'{path}' holds no scenarios.",
            remedy="Its top-level keys must be names of scenarios, e.g. 'HangMug:'.",
        )
    names = ", ".join(document)
    if "directives" in document:
        raise ScenarioError(
            f"'{path}' begins with the keys of a scenario, not with its name.",
            remedy="Put a line with a name, e.g. 'HangMug:', above, and indent the rest.",
        )
    if name is None:
        name = next(iter(document)) if len(document) == 1 else DEFAULT_SCENARIO_NAME
    if name not in document:
        raise ScenarioError(
            f"'{path}' holds no scenario named '{name}'.",
            remedy=f"Choose one of: {names} (option --scenario_name).",
        )
    return name, document[name] if document[name] is not None else {}


def _anchored(node: Any, directory: Path) -> Any:
    """Makes relative paths of models and demonstrations absolute."""
    if not isinstance(node, dict):
        return node
    node = copy.deepcopy(node)
    directives = node.get("directives")
    for directive in directives if isinstance(directives, list) else ():
        for key in ("add_model", "add_directives"):
            entry = directive.get(key) if isinstance(directive, dict) else None
            if isinstance(entry, dict) and isinstance(entry.get("file"), str):
                entry["file"] = _url(entry["file"], directory)
    poil = node.get("poil")
    if isinstance(poil, dict):
        if isinstance(poil.get("demonstration"), str):
            poil["demonstration"] = str(directory / Path(poil["demonstration"]).expanduser())
        if isinstance(poil.get("demonstration_object"), str):
            poil["demonstration_object"] = _url(poil["demonstration_object"], directory)
        hardware = poil.get("hardware")
        cameras = hardware.get("cameras") if isinstance(hardware, dict) else None
        for camera in cameras.values() if isinstance(cameras, dict) else ():
            if isinstance(camera, dict) and camera.get("file"):
                camera["file"] = str(directory / Path(str(camera["file"])).expanduser())
        randomization = poil.get("randomization")
        if isinstance(randomization, dict) and isinstance(randomization.get("models"), list):
            randomization["models"] = [
                _url(m, directory) if isinstance(m, str) else m for m in randomization["models"]
            ]
    return node


def _url(path: str, directory: Path) -> str:
    return path if "://" in path else f"file://{(directory / Path(path).expanduser()).resolve()}"
