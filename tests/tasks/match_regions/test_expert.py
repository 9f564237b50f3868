"""The scripted expert. One task object and batch size throughout: its rollouts are compiled once."""

import jax
import numpy as np
import pytest

from graphrl_jax.experiment.untrained import evaluate_untrained, untrained
from graphrl_jax.registry import make_task
from tasks.match_regions import layouts, raster
from tasks.match_regions.expert import FAILURES
from tests.helpers.match_regions import TASK


def test_expert_demonstrates_successes_and_every_kind_of_failure() -> None:
    demos = TASK.demonstrate(jax.random.key(0), successes=6, failures=7)
    assert list(demos.kinds) == ["success"] * 6 + list(FAILURES)
    assert demos.success.tolist() == [True] * 6 + [False] * 7
    both = demos.events[:, list(demos.event_names).index("both_placed")]
    assert (both[:6] > 0).all() and (both[:6] < demos.lengths[:6]).all() and (both[6:] == -1).all()
    assert (demos.lengths[:6] < 121).sum() >= 3 and demos.lengths[-1] == 121
    star_first = demos.events[:6, 0] < demos.events[:6, 1]
    assert 0 < star_first.sum() < 6


def test_demonstrations_come_with_the_images_of_their_frames():
    demos = TASK.demonstrate(jax.random.key(0), 2, image_size=32)
    frames = demos.images(32)
    assert frames.shape[:2] == demos.boxes.shape[:2]
    # Where a demonstration's star is seen, there is green, up to what its edge mixes in.
    for index, frame in ((0, 0), (1, demos.lengths[1] - 1)):
        column, row = np.floor(32 * demos.boxes[index, frame, 2, :2]).astype(int)
        np.testing.assert_allclose(frames[index, frame, row, column] / 255, raster._BLOCKS[layouts.GREEN], atol=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["layout", "count_plus", "all"])
def test_the_expert_solves_most_layouts_in_time(variant):
    task = make_task(f"match_regions_{variant}")
    assert evaluate_untrained(untrained(task, "expert"), 256, seed=0)["success_rate"] >= 0.8


def test_the_expert_as_a_policy_succeeds_and_chance_does_not():
    found = [evaluate_untrained(untrained(TASK, policy), 16, seed=0) for policy in ("expert", "random")]
    expert, chance = (one["success_rate"] for one in found)
    assert expert >= 15 / 16 and chance == 0.0 and found[0]["mean_return"] > found[1]["mean_return"] + 500
