"""Dense rewards from action-free demonstrations through graphs of objects, and policies trained on them, in JAX.

The names below are the way through: demonstrations -> encoder -> reward -> environment -> policy. Everything else is
found in the module that its idea is named after.
"""

from graphrl_jax import _quiet as _quiet
from graphrl_jax.demonstrations import DemonstrationError, Demonstrations, load
from graphrl_jax.detection import ColourDetector, Detection, Detector, Look, ModelDetector
from graphrl_jax.encoder import EncoderConfig, encode
from graphrl_jax.evaluation import evaluate
from graphrl_jax.graph import Graph, ObjectTable, build_graph
from graphrl_jax.landscape import Landscape, audit, trajectory_scores
from graphrl_jax.ppo_config import PPOConfig, PPOHyper
from graphrl_jax.pretrain import PretrainConfig, PretrainHyper
from graphrl_jax.reward import RewardModel, fit_reward
from graphrl_jax.settings import Settings
from graphrl_jax.task import Task, make_task, task_names
from graphrl_jax.tracking import track
from graphrl_jax.wrappers import EnvironmentReward, GraphReward

__all__ = [
    "ColourDetector",
    "DemonstrationError",
    "Demonstrations",
    "Detection",
    "Detector",
    "EncoderConfig",
    "EnvironmentReward",
    "Graph",
    "GraphReward",
    "Landscape",
    "Look",
    "ModelDetector",
    "ObjectTable",
    "PPOConfig",
    "PPOHyper",
    "PretrainConfig",
    "PretrainHyper",
    "RewardModel",
    "Settings",
    "Task",
    "audit",
    "build_graph",
    "encode",
    "evaluate",
    "fit_reward",
    "load",
    "make_task",
    "task_names",
    "track",
    "trajectory_scores",
]
