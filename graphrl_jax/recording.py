"""Recording a policy's episodes frame by frame, for pictures and videos."""

from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from brax.envs.wrappers.training import VmapWrapper

from graphrl_jax import pipeline
from graphrl_jax.compilation import jit_physics
from graphrl_jax.demonstrations import reached_for_good
from graphrl_jax.policy import make_inference
from graphrl_jax.settings import Settings
from graphrl_jax.task import Task
from graphrl_jax.video import write_video


class Recording(NamedTuple):
    """Episodes side by side.

    | field   | shape        | meaning                                                        |
    |---------|--------------|----------------------------------------------------------------|
    | states  | leaves (B, T, ...) | the task's physics states                                |
    | boxes   | (B, T, N, 4) | what the graph saw                                             |
    | mask    | (B, T, N)    | bool                                                           |
    | active  | (B, T, N)    | bool                                                           |
    | rewards | (B, T)       | the reward the policy was trained on                           |
    | events  | (B, E)       | int32, first frame from which each event held to the end, or -1 |
    """

    states: Any
    boxes: np.ndarray
    mask: np.ndarray
    active: np.ndarray
    rewards: np.ndarray
    events: np.ndarray


def record(task: Task, settings: Settings, reward_params: Any, policy: Any, key: jax.Array, episodes: int) -> Recording:
    """Runs `episodes` episodes of the deterministic policy and keeps every frame."""
    config, _ = pipeline.ppo_settings(task, settings)
    make_env = pipeline.environment_of(task, settings.reward)

    @partial(jit_physics, static_argnums=3)
    def run(reward_params: Any, policy: Any, key: jax.Array, episodes: int) -> Any:
        env = VmapWrapper(make_env(reward_params))
        state = env.reset(jax.random.split(key, episodes))
        act = make_inference(config, state.obs.shape[-1], env.action_size, deterministic=True)

        def step(state: Any, key: jax.Array) -> Any:
            state = env.step(state, act(policy, state.obs, key))
            info = state.info
            frame = (state.pipeline_state, info["boxes"], info["mask"], info["active"], state.reward)
            return state, (*frame, jax.vmap(task.events)(state))

        _, frames = jax.lax.scan(step, state, jax.random.split(key, task.episode_length))
        return jax.tree.map(lambda leaf: leaf.swapaxes(0, 1), frames)

    *frames, events = jax.tree.map(np.asarray, run(reward_params, policy, key, episodes))
    return Recording(*frames, events=reached_for_good(events))


def write_rollout_video(task: Task, recording: Recording, path: Path) -> None:
    """The recorded episodes one after the other as an mp4; the task draws the scene."""
    frames = [
        task.draw_episode(
            jax.tree.map(lambda leaf, i=i: leaf[i], recording.states),
            recording.boxes[i],
            recording.mask[i],
            recording.active[i],
            recording.rewards[i],
            f"episode {i + 1}",
        )
        for i in range(len(recording.rewards))
    ]
    write_video(np.concatenate(frames), path, task.frame_rate)
