"""What is read off a state: boxes against recorded truth, the score by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tasks.match_regions.state import boxes, score
from tests.helpers.match_regions import DEMO, RECORDED, demo_qpos, placed

TRUTH = RECORDED / "truth.npz"


@pytest.mark.skipif(not TRUTH.exists(), reason="recorded demonstrations are not on this machine")
def test_boxes_match_the_recorded_ones() -> None:
    truth = np.load(TRUTH)
    states = truth["states"][:, ::10].reshape(-1, 24).astype(np.float32)
    fingers = truth["rel_finger_angles"][:, ::10].reshape(-1, 2).astype(np.float32)
    recorded = truth["boxes"][:, ::10].reshape(-1, 7, 4)
    qpos = np.concatenate([states[:, :3], fingers, states[:, 9:]], axis=1)
    found = np.asarray(jax.jit(jax.vmap(lambda qpos: boxes(qpos, DEMO)[0]))(qpos))
    corners = np.concatenate([found[..., :2] - found[..., 2:] / 2, found[..., :2] + found[..., 2:] / 2], -1)
    ours = corners[:, [2, 3, 4, 5, 6, 0, 1]]
    low = np.maximum(ours[..., :2], recorded[..., :2])
    high = np.minimum(ours[..., 2:], recorded[..., 2:])
    overlap = np.prod(np.maximum(high - low, 0), -1)
    area = np.prod(ours[..., 2:] - ours[..., :2], -1) + np.prod(recorded[..., 2:] - recorded[..., :2], -1)
    iou = (overlap / (area - overlap)).mean(0)
    assert np.all(iou[:6] > 0.99), iou
    assert iou[6] > 0.95, iou


@pytest.mark.parametrize(
    ("inside", "expected"),
    [((), 0.0), ((0,), 0.5), ((0, 1), 1.0), ((0, 1, 2), 2 / 3), ((2,), 0.0), ((0, 2, 3), 0.5 / 3)],
)
def test_score_is_magicals(inside: tuple[int, ...], expected: float) -> None:
    qpos = demo_qpos()
    for i, block in enumerate(inside):
        qpos = placed(qpos, block, 0.2 + 0.15 * i, 0.3)
    assert float(score(jnp.asarray(qpos), DEMO)) == pytest.approx(expected)
