"""The floors of the package: no import runs back, and heavy libraries stay out of the loop."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import poil_drake

PACKAGE = Path(poil_drake.__file__).parent
FLOORS = ["geometry", "control", "perception", "recording", "transfer", "grasping", "systems"]
PURE_FLOORS = FLOORS[:-1]
ORDER = {
    name: level for level, name in enumerate([*FLOORS, "diagrams", "benchmarks", "cli", "__main__"])
}
# Data and their generators and the error types: open to every floor.
ORDER |= {"errors": -1, "models": -1}
LAZY = {"torch", "open3d"}


def modules(*floors: str) -> list[Path]:
    return sorted(path for floor in floors for path in (PACKAGE / floor).rglob("*.py"))


def imports(path: Path, *, top_level_only: bool = False) -> set[str]:
    """Returns the dotted names that a module imports."""
    tree = ast.parse(path.read_text())
    nodes = tree.body if top_level_only else ast.walk(tree)
    names: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def floor_of(path: Path) -> str:
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


@pytest.mark.parametrize(
    "path", sorted(PACKAGE.rglob("*.py")), ids=lambda p: str(p.relative_to(PACKAGE))
)
def test_imports_run_one_way(path: Path) -> None:
    own = floor_of(path)
    if own == "__init__":
        return
    for name in imports(path):
        parts = name.split(".")
        if parts[0] == "poil_drake" and len(parts) > 1 and parts[1] in ORDER:
            assert ORDER[parts[1]] <= ORDER[own], f"{own} imports {name}"


@pytest.mark.parametrize("path", modules(*PURE_FLOORS), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_pure_floors_do_not_know_drake(path: Path) -> None:
    assert not {name for name in imports(path) if name.split(".")[0] == "pydrake"}


def test_pure_floors_load_no_drake_by_any_way_round() -> None:
    names = [
        ".".join(("poil_drake", *path.relative_to(PACKAGE).with_suffix("").parts))
        for path in modules(*PURE_FLOORS)
    ]
    code = (
        "import importlib, sys\n"
        f"for name in {names!r}: importlib.import_module(name)\n"
        "print(*({'pydrake', 'open3d'} & sys.modules.keys()))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, "", "")


def test_the_control_loop_loads_neither_torch_nor_open3d() -> None:
    """What counts is what is loaded, wherever the import stands."""
    code = (
        "import sys, poil_drake.diagrams.closed_loop; "
        f"sys.exit(' '.join({LAZY!r} & sys.modules.keys()))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.strip() == ""


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda p: p.name)
def test_no_wholesale_drake_imports(path: Path) -> None:
    assert not {name for name in imports(path) if name.startswith("pydrake.all")}
