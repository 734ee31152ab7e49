"""Reads scenarios from YAML and writes them; applies a user's options to them."""

import copy
import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydrake.common.yaml import yaml_dump_typed, yaml_load

from poil_drake.diagrams.scenario.hardware_config import CameraSource
from poil_drake.diagrams.scenario.poil_config import PartRegion
from poil_drake.diagrams.scenario.randomization import ApplyRandomization
from poil_drake.diagrams.scenario.scenario import Scenario, ScenarioSource
from poil_drake.diagrams.scenario.typed_yaml import merge_yaml
from poil_drake.errors import ScenarioError
from poil_drake.perception.faults.injector import Fault

_LARGEST_TEXT, _MOST_VALUES = 1_000_000, 100_000
"""Largest numbers of characters in a YAML text, and of values after aliases are expanded."""

DEFAULT_SCENARIO_NAME = "HangMug"
"""The scenario that is chosen if the caller names none and the file has several."""

# Where a scenario holds paths relative to its file; "*" matches every key and every item.
_URLS = (
    "directives.*.add_model.file",
    "directives.*.add_directives.file",
    "poil.demonstration_object",
    "poil.randomization.models.*",
)
_FILES = (
    "poil.demonstration",
    "poil.calibration",
    "poil.labels.*",
    "poil.packages.*",
    "poil.tracker_config.*.python",
    "poil.tracker_config.*.repository",
    "poil.tracker_config.*.weights",
    "poil.hardware.cameras.*.file",
)


def default_scenario_file() -> Path:
    """Returns the path of the scenario file that comes with the package."""
    return Path(str(files("poil_drake") / "models" / "scenarios" / "hang_mug.yaml"))


def LoadScenario(
    *,
    filename: str | Path | None = None,
    data: str | None = None,
    scenario_name: str | None = None,
    defaults: Scenario | None = None,
    unknown: list[str] | None = None,
) -> Scenario:
    """Reads a scenario from a file, and merges YAML text over it.

    Args:
        filename: A YAML file whose top-level keys are names of scenarios. None uses only
            `defaults` and `data`.
        data: YAML text that changes single values of the scenario, e.g.
            "{poil: {eta: 2.0}, random_seed: 3}". A list, such as `directives`, is replaced whole.
        scenario_name: The scenario's name in the file. It may be omitted if the file has only one
            scenario, or one named "HangMug".
        defaults: The scenario that the file and the text change. None starts from `Scenario()`.
        unknown: A list that receives the paths of the file's unknown keys, e.g. in files of other
            versions; these keys are skipped. If None, an unknown key raises an error.

    Raises:
        ScenarioError: The file cannot be read, or a key or value is wrong. The message states in
            one line what is wrong, where, and what is valid.
    """
    scenario = copy.deepcopy(defaults) if defaults is not None else Scenario()
    if filename is not None:
        path = Path(filename)
        name, node = _named_scenario(_read(path), scenario_name, path)
        node = _with_absolute_paths(node, path.resolve().parent)
        scenario = _with_calibration(merge_yaml(node, Scenario, scenario, unknown=unknown))
        source = ScenarioSource(name=name, file=str(path))
        scenario = dataclasses.replace(scenario, source=source)
    if data is not None:
        node = _with_absolute_paths(_parse(data, "The scenario text"), Path.cwd())
        scenario = _with_calibration(merge_yaml(node, Scenario, scenario))
    return scenario


def _with_calibration(scenario: Scenario) -> Scenario:
    """Merges the file `poil.calibration` into the cameras, and removes the key.

    Logs of runs hold the scenario's text, which must not depend on a file that may change.
    """
    path = scenario.poil.calibration
    if not path:
        return scenario
    node = _read(Path(path)) if Path(path).is_file() else None
    cameras = node.get("cameras") if isinstance(node, dict) and len(node) == 1 else None
    if not isinstance(cameras, dict):
        raise ScenarioError(
            f"poil.calibration is '{path}', which is not a file of camera poses.",
            remedy="Name a file that `poil calibrate cameras` wrote, with the only key 'cameras'; "
            "remove the key poil.calibration while you write the first.",
        )
    if extra := cameras.keys() - scenario.cameras.keys():
        raise ScenarioError(
            f"poil.calibration is '{path}', which has the camera '{min(extra)}', but the scenario "
            "does not.",
            remedy=f"The scenario's cameras are: {', '.join(scenario.cameras)}. Calibrate them, or "
            "remove the camera from the file.",
        )
    scenario = merge_yaml(node, Scenario, scenario)
    return dataclasses.replace(scenario, poil=_changed(scenario.poil, calibration=""))


def ChooseScenario(
    *,
    filename: Path | None = None,
    scenario_name: str | None = None,
    data: str | None = None,
    seed: int | None = None,
    tracker: str | None = None,
    detector: str | None = None,
    speed: float | None = None,
    time_scale: float | None = None,
) -> Scenario:
    """Reads a scenario and applies a user's options; None keeps the scenario's value.

    Args:
        filename: The scenario file; None stands for the package's.
        scenario_name: The scenario's name in the file.
        data: YAML text merged over the file.
        seed: Seed of a trial, in which object, pose and noise are drawn; see `ApplyRandomization`.
        tracker: Name of the tracker.
        detector: Name of the detector.
        speed: Speed on hardware, see `HardwareConfig`.
        time_scale: Time scale on hardware, see `HardwareConfig`.

    Raises:
        ScenarioError: The scenario cannot be read, or a value is wrong.
    """
    scenario = LoadScenario(
        filename=filename or default_scenario_file(), data=data, scenario_name=scenario_name
    )
    if seed is not None:
        scenario = ApplyRandomization(scenario, seed)
    hardware = _changed(scenario.poil.hardware, speed=speed, time_scale=time_scale)
    poil = _changed(scenario.poil, hardware=hardware, tracker=tracker, detector=detector)
    return dataclasses.replace(scenario, poil=poil)


def _changed(config: Any, **values: Any) -> Any:
    """Returns a copy of a config with the given values, except those that are None."""
    return dataclasses.replace(config, **{k: v for k, v in values.items() if v is not None})


def _read(path: Path) -> Any:
    try:
        with path.open(encoding="utf-8") as file:
            text = file.read(_LARGEST_TEXT + 1)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not text in UTF-8"
        raise ScenarioError(
            f"The scenario file '{path}' cannot be read ({reason}).",
            remedy=f"Use a YAML file in UTF-8, e.g. the package's: {default_scenario_file()}",
        ) from error
    return _parse(text, f"'{path}'")


class _StrictLoader(yaml.SafeLoader):
    """A YAML loader that rejects duplicate keys, and keys that are not text."""

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        node = super().compose_mapping_node(anchor)
        keys = set[str]()
        for key, _ in node.value:
            problem = None
            if not key.tag.endswith((":str", ":merge")):
                problem = "a key that is not text needs quotation marks"
            elif key.value in keys:
                problem = f"the key '{key.value}' occurs twice"
            if problem is not None:
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
            keys.add(key.value)
        return node


def _parse(text: str, source: str) -> Any:
    if not text.strip():
        return {}
    try:
        if len(text) > _LARGEST_TEXT:
            problem = f"{source} has more than {_LARGEST_TEXT} characters."
            raise ScenarioError(problem, remedy="Check that the text is a scenario, or shorten it.")
        if _size(yaml.compose(text, Loader=_StrictLoader), {}) > _MOST_VALUES:
            problem = f"{source} has more than {_MOST_VALUES} values once its aliases are expanded."
            raise ScenarioError(problem, remedy="Use fewer values; no alias may contain itself.")
        node = yaml_load(data=text)
    except yaml.YAMLError as error:
        reason = " ".join(str(error).split()).replace('in "<unicode string>",', "at")
        raise ScenarioError(
            f"{source} is not valid YAML: {reason}.", remedy="Correct the YAML."
        ) from error
    return {} if node is None else node


def _size(node: yaml.Node | None, known: dict[int, float]) -> float:
    """Counts the values in a node, with aliases expanded; inf if the node contains itself."""
    if not isinstance(node, yaml.CollectionNode):
        return 1.0
    if id(node) not in known:
        known[id(node)] = math.inf  # For a node that contains itself.
        pairs = isinstance(node, yaml.MappingNode)
        parts = [part for pair in node.value for part in pair] if pairs else node.value
        known[id(node)] = 1.0 + sum(_size(part, known) for part in parts)
    return known[id(node)]


def _named_scenario(document: Any, name: str | None, path: Path) -> tuple[str, Any]:
    """Returns the name and the node of the scenario that is chosen from a file's document."""
    if not isinstance(document, dict) or not document:
        raise ScenarioError(
            f"'{path}' holds no scenarios.",
            remedy="Its top-level keys must be names of scenarios, e.g. 'HangMug:'.",
        )
    if "directives" in document:
        raise ScenarioError(
            f"'{path}' begins with the keys of a scenario, not with its name.",
            remedy="Name the scenario on the first line, e.g. 'HangMug:', and indent the others.",
        )
    if name is None:
        name = next(iter(document)) if len(document) == 1 else DEFAULT_SCENARIO_NAME
    if name not in document:
        raise ScenarioError(
            f"'{path}' holds no scenario named '{name}'.",
            remedy=f"Choose one of: {', '.join(document)} (option --scenario_name).",
        )
    return name, document[name] if document[name] is not None else {}


def _with_absolute_paths(node: Any, directory: Path) -> Any:
    """Returns a scenario's node with its relative file paths resolved against a directory."""

    def file(path: str) -> str:
        return str(directory / Path(path).expanduser())

    def url(path: str) -> str:
        return path if "://" in path else f"file://{Path(file(path)).resolve()}"

    for places, change in ((_URLS, url), (_FILES, file)):
        for place in places:
            node = _replaced(node, place.split("."), change)
    return node


def _replaced(node: Any, place: Sequence[str], change: Callable[[str], str]) -> Any:
    """Returns a node with `change` applied to the texts under the keys `place`; "*" is any key."""
    if not place:
        return change(node) if node and isinstance(node, str) else node
    head, *rest = place
    if isinstance(node, dict):
        return {k: _replaced(v, rest, change) if head in ("*", k) else v for k, v in node.items()}
    if isinstance(node, list) and head == "*":
        return [_replaced(item, rest, change) for item in node]
    return node


def DumpScenario(scenario: Scenario, *, named: bool = True) -> str:
    """Returns a scenario as YAML text.

    The text holds every value, including defaults and randomized values, so that loading it gives
    the same scenario even if defaults change. Of the models, it holds only the files' paths. The
    order of all keys is kept, e.g. that of the cameras.

    Args:
        scenario: The scenario.
        named: Whether the scenario's name is the text's only top-level key, as in a scenario file.
            Without the name, `LoadScenario` accepts the text as `data`.
    """
    node = _node(scenario)
    node = {scenario.source.name or "Scenario": node} if named else node
    return yaml.dump(node, Dumper=_TaggedDumper, sort_keys=False)


class _TaggedDumper(yaml.SafeDumper):
    """Writes a mapping's key `_tag` as its tag, like Drake's `yaml_dump`, which sorts keys."""


def _represent_mapping(dumper: yaml.SafeDumper, data: Mapping[str, Any]) -> yaml.MappingNode:
    values = {key: value for key, value in data.items() if key != "_tag"}
    return dumper.represent_mapping(data.get("_tag", "tag:yaml.org,2002:map"), values)


_TaggedDumper.add_representer(dict, _represent_mapping)


def _node(value: Any) -> Any:
    """Converts a scenario's value to what `_TaggedDumper` writes: mappings, lists and scalars."""
    if dataclasses.is_dataclass(value):
        written = [f for f in dataclasses.fields(value) if f.metadata.get("yaml", True)]
        node = {field.name: _node(getattr(value, field.name)) for field in written}
        if isinstance(value, CameraSource | PartRegion | Fault):  # A union needs the member's tag.
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
