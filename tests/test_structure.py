"""The house: imports run downwards between modules and between rooms, files and functions stay small."""

import ast
import subprocess
import sys
from graphlib import TopologicalSorter

import pytest

import graphrl_jax
from graphrl_jax.cli import COMMANDS
from tests.helpers.outside_package import REPOSITORY

FILES = sorted(path for package in ("graphrl_jax", "tasks") for path in (REPOSITORY / package).rglob("*.py"))
TREES = {".".join(path.relative_to(REPOSITORY).with_suffix("").parts): ast.parse(path.read_text()) for path in FILES}
TREES = {name.removesuffix(".__init__"): tree for name, tree in TREES.items()}
FUNCTIONS = [
    (name, node) for name, tree in TREES.items() for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)
]


def imported(tree: ast.AST) -> set[str]:
    """Modules of ours that a file imports; of `from package import name` the module `package.name` if there is one."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= inner & TREES.keys() or {node.module}
    return found


IMPORTS = {name: imported(tree) for name, tree in TREES.items()}


def room(module: str) -> str:
    """The folder below the package, or the file where there is none."""
    return ".".join(module.split(".")[:2])


def test_the_library_imports_no_task_and_neither_optax_nor_flax():
    for module, imports in IMPORTS.items():
        foreign = {name.split(".")[0] for name in imports}
        assert not foreign & {"optax", "flax"}, module
        assert module.startswith("tasks") or "tasks" not in foreign, module


def test_imports_between_modules_form_no_circle():
    assert len(list(TopologicalSorter(IMPORTS).static_order())) >= len(IMPORTS)


def test_imports_between_rooms_form_no_circle():
    rooms: dict[str, set[str]] = {}
    for module, imports in IMPORTS.items():
        others = {room(name) for name in imports if name in TREES} - {room(module)}
        rooms.setdefault(room(module), set()).update(others)
    order = list(TopologicalSorter(rooms).static_order())
    way = ["graph", "encoder", "pretrain", "reward", "task", "rl", "experiment", "cli"]
    places = [order.index(f"graphrl_jax.{name}") for name in way]
    assert places == sorted(places)


def test_nothing_is_imported_inside_a_function():
    for name, function in FUNCTIONS:
        inside = [node for node in ast.walk(function) if isinstance(node, ast.Import | ast.ImportFrom)]
        assert not inside, f"{name}.{function.name}"


def test_functions_and_files_are_small():
    for name, function in FUNCTIONS:
        assert function.end_lineno - function.lineno < 60, f"{name}.{function.name}"
    for path in FILES:
        assert len(path.read_text().splitlines()) <= 400, path
    assert len(list((REPOSITORY / "graphrl_jax").glob("*.py"))) <= 10


def test_names_are_looked_up_and_not_taken_apart():
    for name, tree in TREES.items():
        calls = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
        assert not calls & {"startswith", "endswith"}, name


def test_no_test_imports_another():
    for path in (REPOSITORY / "tests").rglob("test_*.py"):
        names = {part for module in imported(ast.parse(path.read_text())) for part in module.split(".")}
        assert not {name for name in names if name.startswith("test_")}, path


def test_every_test_file_is_of_a_module():
    """`tests/room/test_module.py` is of `graphrl_jax/room/module.py`, or of a module of tasks, benchmarks or docs."""
    tests = REPOSITORY / "tests"
    for path in tests.rglob("test_*.py"):
        inner = path.relative_to(tests).with_name(path.name.removeprefix("test_"))
        places = [REPOSITORY / "graphrl_jax" / inner, REPOSITORY / inner]
        assert path.parent == tests or any(one.exists() or one.with_suffix("").is_dir() for one in places), path


@pytest.mark.parametrize("name", graphrl_jax.__all__)
def test_a_public_name_exists(name):
    assert getattr(graphrl_jax, name) is not None


def loaded_after(statements: list[str]) -> set[str]:
    """Packages that a fresh process has loaded after some statements."""
    code = "\n".join([*statements, "import sys", "print(*{name.split('.')[0] for name in sys.modules})"])
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(answer.stdout.split())


@pytest.mark.parametrize("command", [[], *([name] for name in COMMANDS)], ids=lambda command: " ".join(command))
def test_help_needs_no_jax(command):
    shown = "with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()): "
    asked = f"main({[*command, '--help']})"
    loaded = loaded_after(["import contextlib, io", "from graphrl_jax.cli import main", shown + asked])
    assert "tyro" in loaded and not loaded & {"jax", "numpy", "brax", "mujoco", "matplotlib"}


@pytest.mark.parametrize("name", ["PPOHyper", "PretrainHyper"])
def test_public_floats_are_pytrees_from_the_start(name):
    made = f"import graphrl_jax, jax; assert len(jax.tree.leaves(graphrl_jax.{name}())) > 5"
    assert "jax" in loaded_after([made])
