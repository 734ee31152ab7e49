"""What error messages tell users to set exists."""

import ast
import re
import typing
from collections.abc import Iterator
from pathlib import Path

import poil_drake
from poil_drake.diagrams.scenario.poil_config import PoilConfig
from poil_drake.diagrams.scenario.typed_yaml import _fields

MODULES = [ast.parse(file.read_text()) for file in Path(poil_drake.__file__).parent.rglob("*.py")]


def texts(tree: ast.AST) -> Iterator[str]:
    """Returns the string literals of a module; placeholders of f-strings become braces."""
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            parts = [part.value if isinstance(part, ast.Constant) else "{}" for part in node.values]
            yield "".join(map(str, parts))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def remedies(tree: ast.AST) -> Iterator[str]:
    """Returns the string literals within arguments named `remedy`, and of remedies by name."""
    for node in ast.walk(tree):
        named = isinstance(node, ast.keyword) and node.arg == "remedy"
        listed = isinstance(node, ast.Assign) and "REMED" in ast.unparse(node.targets[0])
        if named or listed:
            yield from texts(node.value)


def is_key(path: str) -> bool:
    """Returns whether "poil.a.b" is a key of scenarios; below a mapping or a union, any key is."""
    schema: typing.Any = PoilConfig
    for name in path.split(".")[1:]:
        if typing.get_origin(schema) is not None:
            return True
        fields = _fields(schema)
        if not fields or name not in fields:
            return False
        schema = fields[name]
    return True


def test_messages_name_keys_that_exist() -> None:
    # Schemas of messages are whole texts, e.g. "poil.phase".
    sentences = [text for tree in MODULES for text in texts(tree) if " " in text]

    named = {key for text in sentences for key in re.findall(r"\bpoil(?:\.[a-z_]+)+", text)}

    assert "poil.clearance.robot_margin" in named
    assert {key for key in named if not is_key(key)} == set()


def test_remedies_name_no_classes_of_the_package() -> None:
    found = [text for tree in MODULES for text in remedies(tree)]

    assert len(found) > 200
    assert [text for text in found if re.search(r"(?<!Drake's )\b\w+Config\b", text)] == []
