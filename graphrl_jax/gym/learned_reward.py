"""The reward of a reward model in anybody's Gymnasium environment."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import jax
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box
from jax.typing import ArrayLike

from graphrl_jax.graph import ActivityState, ObjectTable, begin_activity, build_graph, update_activity
from graphrl_jax.gym.simulation import RATE_TOLERANCE
from graphrl_jax.perception.detector import Detector
from graphrl_jax.perception.tracking import Tracker
from graphrl_jax.reward.card import Card
from graphrl_jax.reward.model import RewardModel

NamedBoxes = Callable[[Any, dict[str, Any]], Mapping[str, ArrayLike]]
"""Function from an observation and its `info` to the boxes of the objects that are seen, by name."""

_See = Callable[[Any, dict[str, Any]], tuple[np.ndarray, np.ndarray]]
"""Function from an observation and its `info` to boxes (N, 4) float32 and mask (N,) bool of the model's objects."""

# Centres farther out and boxes larger than this, in units of the image, are taken for pixels.
_FARTHEST_OUT = 3.0


class LearnedReward(gymnasium.Wrapper):
    """Pays the reward of a reward model (Eq. 3) after every step; activity is kept from the reset on.

    The reward of the t-th step of an episode is entry t of `RewardModel.rewards` of the episode's boxes, those of the
    reset included. The environment's own reward is in `info["environment_reward"]`.

    A model takes frames at the rate of its card, so the environment must take `model.card.frame_rate` steps per second.

    Boxes are given by name, not as an array in the order of the model's objects. An environment has its own order, and
    an array in the wrong one would be paid for without a complaint, while a wrong name is refused.

    Args:
      env: any environment.
      model: a reward model of graphs with a card, or its folder.
      boxes: where the objects are. One of:
        - a function from (observation, info) to a mapping from names of the model's objects to boxes cx, cy, w, h in
          units of the image, origin top left. A name that is missing was not seen;
        - a detector; it looks at the observation if this is an image (H, W, 3) uint8, else at `env.render()`. An
          object that it misses keeps its box for up to `tracking.LONGEST_BRIDGE` frames;
        - None: `info["boxes"]` (N, 4) and `info["mask"]` (N,) of an environment of this package.
      frame_rate: steps per second of the environment; default: its `metadata["render_fps"]`. Without either, nothing
        is checked.

    Raises:
      ValueError: the model takes images or has no card, the frame rate is another one, or there is no image for the
        detector. `reset` and `step`: a name is unknown, or a box is not one in units of the image.
      StorageError: the folder holds no reward model.
    """

    def __init__(
        self,
        env: gymnasium.Env,
        model: RewardModel | str | Path,
        boxes: NamedBoxes | Detector | None = None,
        frame_rate: float | None = None,
    ):
        super().__init__(env)
        loaded = model if isinstance(model, RewardModel) else RewardModel.load(model)
        card = loaded.card
        if card is None or loaded.image_size is not None:
            raise ValueError("LearnedReward needs a reward model of graphs with a card, as RewardModel.load returns it")
        refuse_other_rate(card, env.metadata.get("render_fps") if frame_rate is None else frame_rate)
        self.objects = card.objects
        # Programs are the same for all cards.
        self._model = replace(loaded, card=None)
        self._begin_sight = _sight(env, boxes, card.objects)
        self._activity: ActivityState | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """As the environment's; what has moved is forgotten."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._see = self._begin_sight()
        self._activity = _begin(*self._see(observation, info))
        return observation, info

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """As the environment's, with the learned reward.

        Raises:
          ResetNeeded: there was no reset yet.
        """
        if self._activity is None:
            raise ResetNeeded("step needs a reset before")
        observation, own, terminated, truncated, info = self.env.step(action)
        boxes, mask = self._see(observation, info)
        self._activity, reward = _reward(self._model, self.objects, self._activity, boxes, mask)
        return observation, float(reward), terminated, truncated, {**info, "environment_reward": own}


_begin = jax.jit(begin_activity)


@partial(jax.jit, static_argnames="objects")
def _reward(
    model: RewardModel, objects: ObjectTable, before: ActivityState, boxes: jax.Array, mask: jax.Array
) -> tuple[ActivityState, jax.Array]:
    """Activity after a frame, and its reward."""
    activity = update_activity(before, boxes, mask, model.pooling.tau, model.pooling.activity)
    return activity, model.apply(build_graph(objects, boxes, mask, activity.active))


def refuse_other_rate(card: Card, rate: float | None) -> None:
    """Checks that an environment takes as many steps per second as a model takes frames; no rate is not checked.

    Raises:
      ValueError: it does not.
    """
    if rate is not None and not math.isclose(rate, card.frame_rate, rel_tol=RATE_TOLERANCE):
        raise ValueError(
            f"the reward model takes {card.frame_rate:g} frames per second, but the environment takes {rate:g} steps "
            f"per second; allowed: {card.frame_rate:g}, in its metadata or as frame_rate"
        )


def _sight(env: gymnasium.Env, boxes: NamedBoxes | Detector | None, objects: ObjectTable) -> Callable[[], _See]:
    """Makes the function that looks for the objects throughout an episode, once for every episode."""
    if boxes is None:
        return lambda: partial(_told, objects.num_slots)
    if not hasattr(boxes, "detect"):
        return lambda: partial(_named, boxes, objects.names)
    image = _image_of(env)
    return lambda: partial(_detected, image, boxes, Tracker(objects))


def _told(slots: int, _: Any, info: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Boxes in the `info` of an environment of this package."""
    boxes, mask = (np.asarray(info.get(name, ())) for name in ("boxes", "mask"))
    if boxes.shape != (slots, 4) or mask.shape != (slots,):
        raise ValueError(
            f"info has boxes {boxes.shape} and mask {mask.shape}; "
            f"needed: ({slots}, 4) and ({slots},), or a function as boxes"
        )
    return boxes.astype(np.float32), mask.astype(bool)


def _named(
    function: NamedBoxes, names: tuple[str, ...], observation: Any, info: dict[str, Any]
) -> tuple[np.ndarray, np.ndarray]:
    """Boxes that a function gives by name."""
    boxes, mask = np.zeros((len(names), 4), np.float32), np.zeros(len(names), bool)
    for name, box in function(observation, info).items():
        if name not in names:
            raise ValueError(f"boxes names {name!r}; the reward model's objects are {', '.join(names)}")
        slot = names.index(name)
        boxes[slot], mask[slot] = _checked(name, box), True
    return boxes, mask


def _checked(name: str, box: ArrayLike) -> np.ndarray:
    """A box (4,) float32.

    Raises:
      ValueError: it is none in units of the image.
    """
    found = np.asarray(box, np.float32)
    if found.shape != (4,) or not (np.abs(found) <= _FARTHEST_OUT).all() or (found[2:] < 0).any():
        raise ValueError(
            f"the box of {name!r} is {np.array2string(found)}; allowed: cx, cy, w, h in units of the image, 0 to 1"
        )
    return found


def _detected(
    image: Callable[[Any], Any], detector: Detector, tracker: Tracker, observation: Any, _: dict[str, Any]
) -> tuple[np.ndarray, np.ndarray]:
    """Boxes that a detector finds in an image."""
    tracker.see(detector.detect(np.asarray(image(observation))))
    return tracker.held()


def _image_of(env: gymnasium.Env) -> Callable[[Any], Any]:
    """The function from an observation to an image (H, W, 3) uint8.

    Raises:
      ValueError: there are no images.
    """
    space = env.observation_space
    if isinstance(space, Box) and space.dtype == np.uint8 and space.shape[2:] == (3,):
        return lambda observation: observation
    if env.render_mode != "rgb_array":
        raise ValueError(
            "boxes is a detector, but the environment shows no images; allowed: observations (H, W, 3) uint8, or "
            "render_mode 'rgb_array'"
        )
    return lambda _: env.render()
