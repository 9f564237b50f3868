"""A reward model pays in an environment that is not ours, whose boxes come by name or by detector."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box
from gymnasium.wrappers import PassiveEnvChecker

from graphrl_jax.gym import LearnedReward, learned_reward
from graphrl_jax.perception.detector import Detection
from graphrl_jax.perception.tracking import LONGEST_BRIDGE
from graphrl_jax.registry import make_task
from tests.helpers.outside_package import REPOSITORY

STEPS = 25


class Replay(gymnasium.Env):
    """Somebody's environment, which plays recordings (boxes (T, N, 4), mask (T, N)) one after the other.

    It pays 3 for the first step, 4 for the next and so on. The observation is an image: the pixel (row 0, column n) has
    the centre of object n in its red and green, and blue if it is seen; every box is 0.1 wide and high.
    """

    def __init__(self, recordings, names=(), fps=8.0):
        self.metadata = {"render_modes": [], "render_fps": fps}
        self.recordings, self.names = recordings, names
        self.observation_space = Box(0, 255, (4, len(names) or 1, 3), np.uint8)
        self.action_space = Box(-1, 1, (1,), np.float32)
        self.episode = -1

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.episode, self.time = (self.episode + 1) % len(self.recordings), 0
        return self.seen()

    def step(self, action):
        self.time += 1
        observation, info = self.seen()
        return observation, 2.0 + self.time, False, self.time == len(self.recordings[self.episode][0]) - 1, info

    def seen(self):
        boxes, mask = (values[self.time] for values in self.recordings[self.episode])
        image = np.zeros(self.observation_space.shape, np.uint8)
        if self.names:
            image[0, mask, :2] = np.round(boxes[mask, :2] * 250)
            image[0, mask, 2] = 255
        return image, {
            "places": {name: box for name, box, found in zip(self.names, boxes, mask, strict=False) if found}
        }


def places(observation, info):
    return info["places"]


@pytest.fixture(scope="module")
def recordings(model):
    """Two random walks. In both, an object is missed now and then, one is never seen, one only from frame 9 on."""
    random, slots = np.random.default_rng(0), model.card.objects.num_slots
    found = []
    for _ in range(2):
        walk = np.cumsum(random.normal(scale=0.03, size=(STEPS, slots, 2)), axis=0)
        boxes = np.concatenate([0.5 + walk, np.full_like(walk, 0.1)], axis=-1).astype(np.float32)
        mask = random.random((STEPS, slots)) > 0.2
        mask[:, 3], mask[:9, 4] = False, False
        boxes[~mask] = np.nan
        found.append((boxes, mask))
    return found


def test_a_replayed_recording_is_paid_as_the_model_scores_it(model, recordings):
    env = LearnedReward(Replay(recordings, model.card.objects.names), model, places)
    for boxes, mask in recordings:
        env.reset()
        steps = [env.step(np.zeros(1)) for _ in range(STEPS - 1)]
        np.testing.assert_allclose([step[1] for step in steps], model.rewards(boxes, mask)[1:], atol=1e-5)
        assert [step[-1]["environment_reward"] for step in steps] == list(range(3, STEPS + 2))
        assert [step[3] for step in steps] == [False] * (STEPS - 2) + [True]


@pytest.mark.parametrize("rule", ["frame_motion", "momentary"])
def test_other_rules_of_activity_are_kept_up_too(model, recordings, rule):
    other = replace(model, pooling=replace(model.pooling, activity=rule))
    env = LearnedReward(Replay(recordings, model.card.objects.names), other, places)
    env.reset()
    boxes, mask = recordings[0]
    paid = [env.step(np.zeros(1))[1] for _ in range(STEPS - 1)]
    np.testing.assert_allclose(paid, other.rewards(boxes, mask)[1:], atol=1e-5)


def test_gymnasium_complains_of_nothing_and_nothing_seen_is_a_reward_too(model):
    """Warnings are errors in tests."""
    nothing = Replay([(np.zeros((9, 0, 4)), np.zeros((9, 0), bool))])
    env = PassiveEnvChecker(LearnedReward(nothing, model, places))
    env.reset(seed=0)
    for _ in range(8):
        _, reward, _, truncated, info = env.step(np.zeros(1, np.float32))
        assert np.isfinite(reward) and type(reward) is float
    assert truncated and info["environment_reward"] == 10.0


def test_in_our_own_environment_it_pays_what_that_would_pay_itself(model):
    inside = gymnasium.make("graphrl/MatchRegions-v0", reward_model=model)
    outside = LearnedReward(gymnasium.make("graphrl/MatchRegions-v0"), REPOSITORY / "checkpoints/match_regions_graph")
    inside.reset(seed=1), outside.reset(seed=1)
    inside.action_space.seed(1)
    for _ in range(10):
        action = inside.action_space.sample()
        _, expected, *_, told = inside.step(action)
        _, reward, *_, info = outside.step(action)
        assert reward == pytest.approx(expected, abs=1e-5)
        assert info["environment_reward"] == pytest.approx(told["environment_reward"], abs=1e-4)


def test_it_is_compiled_once(monkeypatch, model, recordings):
    traces: list[int] = []
    build = learned_reward.build_graph
    monkeypatch.setattr(learned_reward, "build_graph", lambda *parts: traces.append(1) or build(*parts))
    renamed = replace(model.card.objects, names=tuple(f"object_{n}" for n in range(8)))  # compiled for by nobody else
    card = replace(model.card, objects=renamed)
    for kappa in (model.kappa, 2 * model.kappa):
        env = LearnedReward(Replay(recordings, renamed.names), replace(model, kappa=kappa, card=card), places)
        for _ in range(2):
            env.reset()
            for _ in range(3):
                env.step(np.zeros(1))
    assert traces == [1]


class PixelDetector:
    """Reads the image of `Replay`; the class of an object is its column."""

    def __init__(self, classes):
        self.classes = classes

    def detect(self, frame):
        centres = frame[0, :, :2] / np.float32(250)
        seen = np.flatnonzero(frame[0, :, 2])
        return [Detection(self.classes[n], np.append(centres[n], [0.1, 0.1]).astype(np.float32)) for n in seen]


def test_a_detector_finds_the_boxes_in_images_and_bridges_gaps(model):
    """The star is missed for as long as it is held, the square for a frame longer."""
    slots = model.card.objects.num_slots
    centres = np.linspace(0.1, 0.9, slots)[None, :, None] + np.linspace(0, 0.08, STEPS)[:, None, None] * np.ones(2)
    boxes = np.concatenate([np.round(centres * 250) / 250, np.full((STEPS, slots, 2), 0.1)], -1).astype(np.float32)
    mask = np.ones((STEPS, slots), bool)
    mask[:, -1] = False  # of a class that another slot has as well
    mask[3 : 3 + LONGEST_BRIDGE, 2] = mask[3 : 4 + LONGEST_BRIDGE, 3] = False
    names, classes = model.card.objects.names, model.card.objects.class_ids
    env = LearnedReward(Replay([(boxes, mask)] * 2, names), model, PixelDetector(classes))
    held, seen = boxes.copy(), mask.copy()
    held[3 : 3 + LONGEST_BRIDGE, 2:4] = boxes[2, 2:4]
    seen[3 : 3 + LONGEST_BRIDGE, 2:4] = True
    for _ in range(2):
        env.reset()
        paid = [env.step(np.zeros(1))[1] for _ in range(STEPS - 1)]
        np.testing.assert_allclose(paid, model.rewards(held, seen)[1:], atol=1e-5)


def test_a_detector_looks_at_drawings_where_observations_are_no_images(model):
    env = gymnasium.make("graphrl/MatchRegions-v0", render_mode="rgb_array")
    drawn = []

    class Watcher:
        def detect(self, frame):
            drawn.append(frame)
            return [Detection(2, np.array([len(drawn) / 10, 0.5, 0.1, 0.1], np.float32))]

    wrapped = LearnedReward(env, model, Watcher())
    wrapped.reset(seed=2)
    rewards = []
    for _ in range(3):
        rewards.append(wrapped.step(np.array([1.0, 0.3, 1.0], np.float32))[1])
        np.testing.assert_array_equal(drawn[-1], env.render())
    boxes, mask = np.zeros((4, 8, 4), np.float32), np.arange(8)[None].repeat(4, axis=0) == 2  # the star
    boxes[:, 2] = [[place, 0.5, 0.1, 0.1] for place in (0.1, 0.2, 0.3, 0.4)]
    np.testing.assert_allclose(rewards, model.rewards(boxes, mask)[1:], atol=1e-5)


def test_it_is_one_sentence_that_refuses(model, recordings):
    env = Replay(recordings, model.card.objects.names)
    with pytest.raises(ValueError, match="takes 8 frames per second, but the environment takes 30 steps per second"):
        LearnedReward(Replay(recordings, fps=30), model, places)
    with pytest.raises(ValueError, match="takes 10 steps per second; allowed: 8, in its metadata or as frame_rate"):
        LearnedReward(env, model, places, frame_rate=10)
    assert LearnedReward(Replay(recordings, fps=30), model, places, frame_rate=8.02).metadata["render_fps"] == 30
    LearnedReward(Replay(recordings, fps=None), model, places)
    for other in (replace(model, card=None), replace(model, image_size=64)):
        with pytest.raises(ValueError, match="needs a reward model of graphs with a card"):
            LearnedReward(env, other, places)
    with pytest.raises(ValueError, match="boxes is a detector, but the environment shows no images; allowed: "):
        LearnedReward(gymnasium.make("graphrl/MatchRegions-v0"), model, make_task("match_regions").detector())
    with pytest.raises(ResetNeeded, match="step needs a reset before"):
        LearnedReward(env, model, places).step(np.zeros(1))


@pytest.mark.parametrize(
    ("told", "sentence"),
    [
        ({"cup": (0.5, 0.5, 0.1, 0.1)}, "boxes names 'cup'; the reward model's objects are goal_region, robot, star"),
        ({"star": (320, 200, 40, 40)}, r"the box of 'star' is \[320. 200.  40.  40.\]; allowed: cx, cy, w, h in units"),
        ({"star": (0.5, 0.5, np.nan, 0.1)}, "the box of 'star' is"),
        ({"star": (0.5, 0.5, -0.1, 0.1)}, "the box of 'star' is"),
        ({"star": (0.5, 0.5)}, "the box of 'star' is"),
    ],
)
def test_boxes_that_are_none_are_refused(model, recordings, told, sentence):
    env = LearnedReward(Replay(recordings), model, lambda observation, info: told)
    with pytest.raises(ValueError, match=sentence):
        env.reset()


def test_an_info_without_boxes_is_refused(model, recordings):
    with pytest.raises(ValueError, match=r"info has boxes \(0,\) and mask \(0,\); needed: \(8, 4\) and \(8,\), or a"):
        LearnedReward(Replay(recordings), model).reset()
