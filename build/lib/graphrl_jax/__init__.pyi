from .demonstrations import DemonstrationError as DemonstrationError
from .demonstrations import Demonstrations as Demonstrations
from .demonstrations import load as load
from .encoder.config import EncoderConfig as EncoderConfig
from .encoder.encoder import encode as encode
from .encoder.pooling import PoolingParams as PoolingParams
from .experiment.checkpoints import load_run as load_run
from .experiment.methods import METHODS as METHODS
from .experiment.methods import Method as Method
from .experiment.settings import Settings as Settings
from .experiment.settings import compose as compose
from .graph import Graph as Graph
from .graph import ObjectTable as ObjectTable
from .graph import build_graph as build_graph
from .perception.colour_detector import ColourDetector as ColourDetector
from .perception.colour_detector import Look as Look
from .perception.detector import Detection as Detection
from .perception.detector import Detector as Detector
from .perception.model_detector import ModelDetector as ModelDetector
from .perception.tracking import track as track
from .pretrain.config import PretrainConfig as PretrainConfig
from .pretrain.trainer import PretrainHyper as PretrainHyper
from .registry import make_task as make_task
from .registry import task_names as task_names
from .reward.landscape import Landscape as Landscape
from .reward.landscape import audit as audit
from .reward.landscape import trajectory_scores as trajectory_scores
from .reward.model import RewardModel as RewardModel
from .reward.model import fit_reward as fit_reward
from .rl.config import PPOConfig as PPOConfig
from .rl.ppo import PPOHyper as PPOHyper
from .rl.rollout import evaluate as evaluate
from .rl.wrappers import EnvironmentReward as EnvironmentReward
from .rl.wrappers import GraphReward as GraphReward
from .task import Task as Task

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
    "METHODS",
    "Method",
    "ModelDetector",
    "ObjectTable",
    "PPOConfig",
    "PPOHyper",
    "PoolingParams",
    "PretrainConfig",
    "PretrainHyper",
    "RewardModel",
    "Settings",
    "Task",
    "audit",
    "build_graph",
    "compose",
    "encode",
    "evaluate",
    "fit_reward",
    "load",
    "load_run",
    "make_task",
    "task_names",
    "track",
    "trajectory_scores",
]
