"""Gymnasium interfaces. Importing this package registers every task, such as `graphrl/MatchRegions-v0`.

See docs/gymnasium.md. Needs the package extra `gymnasium`.
"""

from graphrl_jax.gym.optional import require

require("gymnasium", "gymnasium")

from graphrl_jax.gym.environment import TaskEnv  # noqa: E402
from graphrl_jax.gym.learned_reward import LearnedReward  # noqa: E402
from graphrl_jax.gym.registration import register_tasks  # noqa: E402
from graphrl_jax.gym.vector import TaskVectorEnv  # noqa: E402

__all__ = ["LearnedReward", "TaskEnv", "TaskVectorEnv", "register_tasks"]

register_tasks()
