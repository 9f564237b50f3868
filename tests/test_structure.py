"""The package's shape: imports run one way, and the library knows no task."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import graphrl_jax

PACKAGE = Path(graphrl_jax.__file__).parent


def imported_modules(path: Path) -> set[str]:
    """Every absolute module or `module.name` that a file imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {node.module or ""} | {f"{node.module}.{alias.name}" for alias in node.names}
    return found


IMPORTS = {
    ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts): imported_modules(path)
    for path in PACKAGE.rglob("*.py")
}


def test_the_library_imports_no_task_and_neither_optax_nor_flax():
    for module, imports in IMPORTS.items():
        assert not {name.split(".")[0] for name in imports} & {"tasks", "optax", "flax"}, module


def test_imports_form_no_circle():
    within = {module: imports & IMPORTS.keys() for module, imports in IMPORTS.items()}
    order = list(TopologicalSorter(within).static_order())
    way = ["graph", "encoder", "pretrain", "reward", "wrappers", "ppo", "sweep", "training", "sweep_command", "cli"]
    places = [order.index(f"graphrl_jax.{name}") for name in way]
    # Of two modules that do not know each other either may come first; those on the data's way do.
    assert all(f"graphrl_jax.{a}" not in IMPORTS[f"graphrl_jax.{b}"] for i, b in enumerate(way) for a in way[i + 1 :])
    assert places[0] < places[1] < places[3] < places[4] and places[-1] == max(places)


def test_public_names_exist():
    assert all(hasattr(graphrl_jax, name) for name in graphrl_jax.__all__)
