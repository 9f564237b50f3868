"""The page of a run is one file that asks the network for nothing, and says what it is given."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from graphrl_jax.viz import run_page as module
from graphrl_jax.viz.page import FRAMES
from graphrl_jax.viz.run_page import HeldOut, Kind, Number, RunContent, Subtasks, run_page
from graphrl_jax.viz.video import write_video

BARE = RunContent(
    title="task & <b>: reward", about="A run.", numbers=[], missed=[], ppo=[], pretrain=[], success_rate=None, audit=[],
    audit_note="", kinds=[], held_out=None, subtasks=None, subtask_numbers=[], landscape=None, rollouts=None,
    demonstrations=None, video=None, command="graphrl train", command_note="", settings={"run": {"seed": "0"}},
    made_with={"commit": "abc"},
)  # fmt: skip
RECORDS = [
    {"env_steps": 1000 * n, "success": n / 4, "score": n / 4, "learned_reward": -1 + n / 8, "env_reward": -n}
    for n in range(1, 5)
]


def page(folder: Path, content: RunContent) -> str:
    run_page(folder / "report.html", content)
    return (folder / "report.html").read_text()


@pytest.fixture
def video(tmp_path):
    write_video(np.random.default_rng(0).integers(0, 255, (24, 64, 128, 3), dtype=np.uint8), tmp_path / "a.mp4", 8.0)
    return tmp_path / "a.mp4"


def test_a_run_without_anything_has_a_page(tmp_path):
    text = page(tmp_path, BARE)
    assert "Nothing was missed." in text and "<svg" not in text and "task &amp; &lt;b&gt;: reward" in text
    assert "graphrl train" in text and "<span>seed</span><b>0</b>" in text


def test_numbers_and_what_was_missed_are_told_in_order(tmp_path):
    numbers = [Number("99.6 %", "Success rate", "of <256> episodes"), Number("-0.14", "Bumping", "best near 0")]
    kinds = [Kind("success", 0.98, -177.4, None), Kind("shoe_<held>", 0.5, None, 0.625)]
    text = page(tmp_path, replace(BARE, numbers=numbers, kinds=kinds, missed=["No video.", "No <luck>."]))
    assert "Nothing was missed" not in text and "<li>No video.</li>\n<li>No &lt;luck&gt;.</li>" in text
    assert "<b>99.6\u00a0%</b><span>Success rate</span><small>of &lt;256&gt; episodes</small>" in text
    assert "<b>−0.14</b>" in text and "shoe &lt;held&gt;" in text
    row = text[text.index("shoe &lt;held&gt;") :]
    assert "width: 50.0%" in row and "62.5\u00a0%" in row and 'class="weak" style="width: 62.5%"' in row


def test_success_and_each_reward_are_curves_over_the_same_steps(tmp_path):
    text = page(tmp_path, replace(BARE, ppo=RECORDS, success_rate=1.0))
    labels = re.findall(r'aria-label="([^"]+)"', text)
    assert [label.partition(" over ")[0] for label in labels] == [
        "success and score of training episodes", "learned reward", "environmental reward",
    ]  # fmt: skip
    lines = re.findall(r'<polyline class="(\w+)" points="([^"]+)"', text)
    assert [style for style, _ in lines] == ["first", "second", "third", "second"]
    # A quarter, a half, three quarters and all of the axis from 52 to 504, and of the height from 208 to 12.
    assert lines[0][1] == "165.0,159.0 278.0,110.0 391.0,61.0 504.0,12.0"
    places = [[pair.split(",")[0] for pair in points.split()] for _, points in lines]
    assert all(one == places[0] for one in places)
    assert '<circle class="first" cx="504.0" cy="12.0"' in text


def test_values_that_are_not_finite_are_left_out(tmp_path):
    records = [{**RECORDS[0], "success": float("nan"), "score": float("nan")}, *RECORDS[1:]]
    lines = re.findall(r'points="([^"]+)"', page(tmp_path, replace(BARE, ppo=records)))
    assert [len(points.split()) for points in lines] == [3, 3, 4, 4]
    silent = [{"env_steps": 1000, "success": float("nan"), "env_reward": -1.0}]
    assert page(tmp_path, replace(BARE, ppo=silent)).count("<svg") == 1


def test_losses_are_on_a_logarithmic_axis(tmp_path):
    records = [{"step": 10 * n, "loss": 10.0**-n, "tcc": 0.0} for n in range(1, 4)]
    text = page(tmp_path, replace(BARE, pretrain=records))
    (points,) = re.findall(r'points="([^"]+)"', text)
    heights = [float(pair.split(",")[1]) for pair in points.split()]
    assert heights[1] - heights[0] == pytest.approx(heights[2] - heights[1], abs=0.2)


def test_held_out_demonstrations_and_their_subtasks(tmp_path):
    curves = [np.array([0.0, 0.5, 1.0]), np.array([0.0, 0.2]), np.array([0.0, 0.9])]
    held_out = HeldOut(curves, np.array([1, 1, 0], bool), np.array([1, 0, 1], bool), ["good", "bad", "<odd>"], 2.0, 0.8)
    subtasks = Subtasks("held-out successes", "rests", [("good", 4.0, [1.0]), ("bad", 2.0, [])])
    text = page(tmp_path, replace(BARE, held_out=held_out, subtasks=subtasks))
    assert "<h3>2 successes</h3>" in text and "<h3>1 failures</h3>" in text
    assert re.findall(r'<polyline class="(\w+) thin"', text) == ["first", "wrong", "wrong"]
    assert "&lt;odd&gt;: ends at 0.90, like a success" in text
    widths = re.findall(r'<i style="width: ([\d.]+)%" title="([^"]+)"', text)
    assert widths == [
        ("25.0", "subtask 1: 0.0 to 1.0 s"), ("75.0", "subtask 2: 1.0 to 4.0 s"), ("50.0", "subtask 1: 0.0 to 2.0 s"),
    ]  # fmt: skip


def test_of_many_demonstrations_some_are_drawn_and_the_page_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "MOST_CURVES", 2)
    right = np.ones(3, bool)
    held_out = HeldOut(3 * [np.array([0.0, 1.0])], right, right, 3 * ["success"], 2.0, 0.8)
    text = page(tmp_path, replace(BARE, held_out=held_out))
    assert "3 successes, of which the first 2 are drawn" in text and text.count("<polyline") == 2


def test_figures_and_video_are_inside_the_page(tmp_path, video):
    (tmp_path / "a.png").write_bytes(b"image")
    figure = (tmp_path / "a.png", "What <it> shows.")
    text = page(tmp_path, replace(BARE, landscape=figure, video=video, ppo=RECORDS))
    assert not re.findall(r"(?:src|href)=\"(?!#|data:)", text) and "http" not in text and "@import" not in text
    assert "url(" not in text and "<script" not in text
    assert text.count("data:image/png;base64,") == 1 and text.count("data:video/mp4;base64,") == 1
    assert "What &lt;it&gt; shows." in text and "<video controls muted" in text


def test_what_is_too_large_is_named_and_a_video_becomes_frames(tmp_path, video, monkeypatch):
    monkeypatch.setattr(module, "MOST_MEDIA_BYTES", 100)
    (tmp_path / "a.png").write_bytes(bytes(200))
    text = page(tmp_path, replace(BARE, landscape=(tmp_path / "a.png", "Caption."), video=video))
    assert "too large for this page: a.png" in text and "data:image/png" not in text
    assert "<video" not in text and text.count("data:image/jpeg;base64,") == FRAMES
    assert "a.mp4 has" in text and "2.9 s" in text  # the last of 24 frames at 8 per second
