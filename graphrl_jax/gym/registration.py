"""Gymnasium's identifiers of the tasks."""

import gymnasium

from graphrl_jax.gym.environment import TaskEnv
from graphrl_jax.gym.vector import TaskVectorEnv
from graphrl_jax.registry import task_names


def identifier_of(task: str) -> str:
    """Gymnasium's identifier of a task: `match_regions` is `graphrl/MatchRegions-v0`."""
    return f"graphrl/{''.join(part.capitalize() for part in task.split('_'))}-v0"


def register_tasks() -> None:
    """Registers all tasks that Gymnasium does not know yet, such as those installed after this package was imported."""
    for name in task_names():
        if identifier_of(name) not in gymnasium.registry:
            gymnasium.register(
                identifier_of(name),
                entry_point=f"{TaskEnv.__module__}:{TaskEnv.__name__}",
                vector_entry_point=f"{TaskVectorEnv.__module__}:{TaskVectorEnv.__name__}",
                kwargs={"task": name},
            )
