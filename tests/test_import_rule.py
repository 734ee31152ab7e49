"""Imports run one way and have no cycles; heavy libraries stay out of the control loop."""

import ast
from collections import Counter
from collections.abc import Callable, Iterable
from graphlib import TopologicalSorter
from pathlib import Path

from python_process import run_python

import poil_drake

PACKAGE = Path(poil_drake.__file__).parent
PURE_FLOORS = [
    "errors",
    "geometry",
    "runtime",
    "robots",
    "planning",
    "control",
    "perception",
    "recording",
    "transfer",
    "grasping",
]
FLOORS = [*PURE_FLOORS, "models", "systems", "reports", "diagrams", "benchmarks", "cli", "__main__"]
ORDER = {name: level for level, name in enumerate(FLOORS)}


def modules(*floors: str) -> list[Path]:
    return sorted(path for floor in floors for path in (PACKAGE / floor).rglob("*.py"))


def module_name(path: Path) -> str:
    parts = ("poil_drake", *path.relative_to(PACKAGE).with_suffix("").parts)
    return ".".join(parts).removesuffix(".__init__")


def imports(path: Path) -> set[str]:
    """Returns the dotted names that a module imports."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def check_no_module_imports(paths: Iterable[Path], refused: Callable[[Path, str], bool]) -> None:
    names = {path.relative_to(PACKAGE): imports(path) for path in paths}
    assert names
    found = [(str(path), name) for path in names for name in names[path] if refused(path, name)]
    assert not found


def test_imports_run_one_way() -> None:
    def is_backward(path: Path, name: str) -> bool:
        parts = name.split(".")
        if parts[0] != "poil_drake" or len(parts) == 1 or parts[1] not in ORDER:
            return False
        return ORDER[parts[1]] > ORDER[path.parts[0].removesuffix(".py")]

    check_no_module_imports(PACKAGE.rglob("*.py"), is_backward)


def test_a_folder_holds_at_most_15_modules() -> None:
    paths = (path for path in PACKAGE.rglob("*.py") if path.name != "__init__.py")

    counts = Counter(str(path.parent.relative_to(PACKAGE)) for path in paths)

    assert {folder: count for folder, count in counts.items() if count > 15} == {}


def test_imports_have_no_cycles() -> None:
    modules = {module_name(path): path for path in PACKAGE.rglob("*.py")}

    def imported(name: str) -> str:
        return name if name in modules else name.rpartition(".")[0]

    graph = {
        module: {imported(name) for name in imports(path)} & modules.keys() - {module}
        for module, path in modules.items()
    }
    TopologicalSorter(graph).prepare()  # Raises a CycleError that names the cycle.


def test_pure_floors_do_not_import_drake() -> None:
    check_no_module_imports(
        modules(*PURE_FLOORS), lambda path, name: name.split(".")[0] == "pydrake"
    )


def test_pure_floors_do_not_load_drake_indirectly() -> None:
    names = [module_name(path) for path in modules(*PURE_FLOORS)]
    code = f"import importlib\nfor name in {names!r}: importlib.import_module(name)"
    assert loaded(code, {"pydrake", "open3d"}) == []


def test_the_control_loop_loads_neither_torch_nor_open3d() -> None:
    """Checks the loaded modules, wherever the imports are."""
    assert loaded("import poil_drake.diagrams.loop.closed_loop", {"torch", "open3d"}) == []


def loaded(code: str, names: set[str]) -> list[str]:
    """Returns which modules some code loads in a new process, and all that this prints."""
    begin, end = "import sys; sys.stderr = sys.stdout", f"print(*({names!r} & sys.modules.keys()))"
    return run_python("-c", f"{begin}\n{code}\n{end}").split()


def test_no_wholesale_drake_imports() -> None:
    check_no_module_imports(
        PACKAGE.rglob("*.py"), lambda path, name: name.startswith("pydrake.all")
    )
