"""`graphrl evaluate`: a policy on unseen episodes; see `requests.Evaluate`."""

from pathlib import Path
from typing import Any

from graphrl_jax import runtime
from graphrl_jax.cli.options import refuse_useless
from graphrl_jax.cli.requests import Evaluate
from graphrl_jax.experiment.checkpoints import load_run
from graphrl_jax.experiment.evaluation import evaluate_policy, show_policy
from graphrl_jax.experiment.run_directory import Run
from graphrl_jax.experiment.untrained import evaluate_untrained, show_untrained, untrained
from graphrl_jax.registry import make_task, task_names
from graphrl_jax.reward.model import RewardModel
from graphrl_jax.rl.config import POLICIES


def run(request: Evaluate) -> dict[str, Any]:
    """Carries the request out."""
    runtime.configure()
    if request.episodes < 1:
        raise ValueError(f"--episodes is {request.episodes}; allowed: 1 or more")
    if not request.video_episodes:
        refuse_useless(request, ["out"], "with --video-episodes 0, which writes no video")
    return _run(request) if request.policy is None else _untrained(request, request.policy)


def _run(request: Evaluate) -> dict[str, Any]:
    """Evaluates the policy of a run."""
    refuse_useless(request, ["reward_model"], "without --policy, as a run has a reward of its own")
    if not request.run.exists() and str(request.run) in task_names():
        raise ValueError(f"{request.run} is a task and no run's folder; --policy says what acts: {', '.join(POLICIES)}")
    trained = load_run(request.run, request.engine)
    outcome = evaluate_policy(trained, request.episodes, request.seed)
    if request.video_episodes:
        video = request.out or request.run / f"evaluation_{request.seed}.mp4"
        show_policy(Run(request.run), trained, request.video_episodes, request.seed, video)
    return outcome


def _untrained(request: Evaluate, policy: str) -> dict[str, Any]:
    """Evaluates a policy that has learned nothing."""
    name = str(request.run)
    if name not in task_names():
        known = ", ".join(task_names())
        raise ValueError(f"--policy {policy} needs the name of a task, not {name}; known tasks: {known}")
    model = None if request.reward_model is None else RewardModel.load(request.reward_model)
    acting = untrained(make_task(name, request.engine), policy, model)
    outcome = evaluate_untrained(acting, request.episodes, request.seed)
    if request.video_episodes:
        video = request.out or Path(f"{name}_{policy}_{request.seed}.mp4")
        show_untrained(acting, request.video_episodes, request.seed, video)
    return outcome
