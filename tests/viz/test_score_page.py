"""The page of scores is one file that asks the network for nothing, and says what it is given."""

import re

import numpy as np

from graphrl_jax.viz.page import FRAMES, spread
from graphrl_jax.viz.score_page import Scored, scores_page

SUMMARY = {
    "frames": 41, "seconds": 41 / 8, "final_progress": 0.951, "value_order_correlation": 0.5, "episode_index": 0,
    "looks_like_success": True, "stalls": [(0.5, 3.0)], "subtasks": [10], "coverage": {"hand": 1.0, "cup": 0.256},
    "unseen_at_end": [],
}  # fmt: skip


def page(tmp_path, *recordings: Scored) -> str:
    scores_page(tmp_path / "report.html", recordings, "Progress of <videos>", 12, "people", -0.126)
    return (tmp_path / "report.html").read_text()


def test_a_page_is_one_file_without_links_to_the_network(tmp_path):
    frames = np.random.default_rng(0).integers(0, 255, (41, 300, 400, 3), dtype=np.uint8)
    one = Scored("take & 1.mp4", SUMMARY, np.linspace(0, 1, 41), 8.0, spread(frames))
    text = page(tmp_path, one)
    assert not re.findall(r"(?:src|href)=\"(?!#|data:)", text) and "http" not in text and "@import" not in text
    assert text.count("data:image/jpeg;base64,") == FRAMES
    assert (tmp_path / "report.html").stat().st_size < 5e5
    assert "Progress of &lt;videos&gt;" in text and "take &amp; 1.mp4" in text


def test_a_page_says_what_it_is_given(tmp_path):
    text = page(tmp_path, Scored("a", SUMMARY, np.array([0.0, 0.5, 1.0]), 8.0), Scored("b", SUMMARY, np.zeros(1), 8.0))
    words = " ".join(text.split())
    assert "12 demonstrations (people)" in words and "ends with a progress of at least 0.87" in words
    assert "from −1 to 1; at 1, the reward rises all the time" in words
    assert "5.1 s. Share of frames in which each object was seen: hand 100 %, cup 26 %." in words
    assert '<td class="number">0.95</td>' in text and "<td>yes</td>" in text and ">0.5-3.0\u00a0s</td>" in text
    assert 'points="52.0,208.0 498.0,110.0 944.0,12.0"' in text and "data:image" not in text
    assert "doubtful" not in text and "dashed: the learned reward comes to rest, and another subtask begins" in text
    assert "dashed" not in page(tmp_path, Scored("a", SUMMARY | {"subtasks": []}, np.zeros(3), 8.0))
    assert text.index('id="recording-0"') > text.index("<tbody>")


def test_a_page_warns_of_objects_that_are_gone_at_the_end(tmp_path):
    text = page(tmp_path, Scored("a", SUMMARY | {"unseen_at_end": ["cup", "<lid>"]}, np.zeros(3), 8.0))
    assert "Not seen at the end: cup, &lt;lid&gt;." in text and "<td>yes, doubtful</td>" in text
