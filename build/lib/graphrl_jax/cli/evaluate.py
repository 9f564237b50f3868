"""`graphrl evaluate`: a policy on unseen episodes; see `requests.Evaluate`."""

from typing import Any

from graphrl_jax import runtime
from graphrl_jax.cli.options import refuse_useless
from graphrl_jax.cli.requests import Evaluate
from graphrl_jax.experiment.checkpoints import load_run
from graphrl_jax.experiment.evaluation import evaluate_policy, show_policy
from graphrl_jax.experiment.run_directory import Run


def run(request: Evaluate) -> dict[str, Any]:
    """Carries the request out."""
    runtime.configure()
    if request.episodes < 1:
        raise ValueError(f"--episodes is {request.episodes}; allowed: 1 or more")
    if not request.video_episodes:
        refuse_useless(request, ["out"], "with --video-episodes 0, which writes no video")
    trained = load_run(request.run, request.engine)
    outcome = evaluate_policy(trained, request.episodes, request.seed)
    if request.video_episodes:
        video = request.out or request.run / f"evaluation_{request.seed}.mp4"
        show_policy(Run(request.run), trained, request.video_episodes, request.seed, video)
    return outcome
