"""`graphrl objects`, and the way from videos and a file of objects to a reward model, without a registered task."""

import json
from dataclasses import replace

import jax
import numpy as np
import pytest

from graphrl_jax import cli
from graphrl_jax.demonstrations import load
from graphrl_jax.encoder import encoder
from graphrl_jax.encoder.config import EncoderConfig
from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.perception.objects_file import read_objects
from graphrl_jax.reward.card import Card
from graphrl_jax.reward.model import RewardModel, fit_reward
from graphrl_jax.viz.video import write_video
from tests.helpers.commands import call, rejected

CUPS = """
name = "cups"
frame_rate = 5

[[objects]]
name = "hand"
kind = "robot"
colour = [40, 40, 220]

[[objects]]
name = "cup"
colour = [220, 40, 40]

[[objects]]
name = "shelf"
kind = "fixture"
colour = [40, 160, 40]
"""


def filmed(seed: int, frames: int = 30) -> np.ndarray:
    """A hand (blue) takes a cup (red) to a shelf (green): (T, 96, 128, 3) uint8."""
    draw = np.random.default_rng(seed)
    start, end = draw.uniform((10, 20), (40, 70)), draw.uniform((85, 35), (95, 55))
    images = np.full((frames, 96, 128, 3), 230, np.uint8)
    for number, image in enumerate(images):
        image[25:70, 78:118] = (40, 160, 40)
        x, y = (start + (end - start) * np.clip((number - 5) / 20, 0, 1)).astype(int)
        image[y : y + 12, x : x + 12] = (220, 40, 40)
        image[y - 10 : y - 2, x : x + 12] = (40, 40, 220)
    return images


def test_a_template_is_written_and_not_over_another(capsys, tmp_path):
    out = tmp_path / "drawer.toml"
    call(cli.main, "objects", "--out", out, "--labels", "cup", "hand")
    assert read_objects(out).objects.names == ("cup", "hand")
    assert "exists already" in rejected(capsys, ["objects", "--out", out], main=cli.main)
    assert "must end in .toml" in rejected(capsys, ["objects", "--out", tmp_path / "drawer"], main=cli.main)


def test_the_labels_are_the_classes_of_an_export(capsys, tmp_path):
    export = tmp_path / "export" / "data.yaml"
    export.parent.mkdir()
    export.write_text("nc: 2\nnames: [hand, red cup]\n")
    for number, source in enumerate((export, export.parent)):
        out = tmp_path / f"{number}.toml"
        assert call(cli.main, "objects", "--out", out, "--classes", source) == {"out": str(out), "objects": 2}
        assert read_objects(out).objects.class_names == ("hand", "red cup")
    out = tmp_path / "both.toml"
    both = ["objects", "--out", out, "--classes", export, "--labels", "cup"]
    assert "--labels changes nothing with --classes, which names them" in rejected(capsys, both, cli.main)
    export.write_text("nc: 2\n")
    wrong = rejected(capsys, ["objects", "--out", out, "--classes", export], cli.main)
    assert f"{export} names no classes; allowed: a .yaml file with names" in wrong
    assert "allowed: texts that are not empty" in rejected(capsys, ["objects", "--out", out, "--labels", ""], cli.main)
    assert not out.exists()


@pytest.fixture(scope="module")
def demos_file(tmp_path_factory):
    """Demonstrations from four videos at 10 frames per second and a file of objects."""
    folder = tmp_path_factory.mktemp("cups")
    (folder / "cups.toml").write_text(CUPS)
    for seed in range(4):
        write_video(filmed(seed), folder / "videos" / f"{seed}.mp4", 10.0)
    call(cli.main, "import", folder / "videos", "--objects", folder / "cups.toml", "--out", folder / "demos.npz")
    return folder / "demos.npz"


def test_videos_become_demonstrations_at_the_files_frame_rate(demos_file):
    demos = load(demos_file)
    assert (demos.task, demos.frame_rate, len(demos)) == ("cups", 5.0, 4)
    np.testing.assert_array_equal(demos.lengths, 15)
    assert demos.mask.all() and demos.objects.is_fixture == (False, False, True)
    cup, shelf = demos.boxes[:, :, 1], demos.boxes[:, :, 2]
    assert (np.abs(cup[:, -1, :2] - shelf[:, -1, :2]) < 0.2).all() and (cup[:, -1, 0] - cup[:, 0, 0] > 0.2).all()


def test_a_reward_is_learned_audited_and_divided_without_a_task(demos_file, tmp_path):
    out = tmp_path / "cups"
    call(cli.main, "pretrain", "--demos", demos_file, "--out", out, "--steps", 20)
    summary = json.loads((out / "summary.json").read_text())
    assert 0 <= summary["pair_accuracy"] <= 1 and "maxima_inside" not in summary
    model = RewardModel.load(out)
    assert (model.card.task, model.card.frame_rate) == ("cups", 5.0)
    assert not (out / "figures" / "landscape.png").exists()
    call(cli.main, "stages", out, "--demos", demos_file)
    assert len(json.loads((out / "subtasks.json").read_text())["subtasks"]) == 4


def test_a_task_and_objects_are_not_asked_for_at_once(capsys, demos_file, tmp_path):
    objects = demos_file.with_name("cups.toml")
    arguments = ["import", demos_file.with_name("videos"), "--objects", objects, "--out", tmp_path / "demos.npz"]
    message = rejected(capsys, [*arguments, "--task", "shoes_in_box"], main=cli.main)
    assert "--task changes nothing with --objects" in message
    objects.with_name("other.toml").write_text(CUPS.replace("5", "0"))
    arguments[3] = objects.with_name("other.toml")
    assert "other.toml: frame_rate is 0; allowed: a number above 0" in rejected(capsys, arguments, main=cli.main)
    assert not list(tmp_path.iterdir())


def test_images_without_colours_are_refused_with_the_way_out(capsys, demos_file, tmp_path):
    videos, plain, model = demos_file.with_name("videos"), tmp_path / "plain.toml", tmp_path / "cups"
    plain.write_text("".join(line for line in CUPS.splitlines(True) if "colour" not in line))
    says = f"{plain} gives its objects no colours, so nothing finds them in images; allowed: a colour for every object,"
    coloured = ["--objects", plain, "--out", tmp_path / "refused"]
    assert f"{says} or --weights MODEL\n" in rejected(capsys, ["import", videos, *coloured], cli.main)

    demos = load(demos_file)
    params = encoder.init(jax.random.key(0), EncoderConfig(), demos.objects)
    card = Card(demos.objects, 5.0, EncoderConfig(), "displacement", "cups", "made up", 4, -0.1)
    replace(fit_reward(params, demos, PoolingParams(2.0, 0.02)), card=card).save(model)
    assert says in rejected(capsys, ["score", model, videos, *coloured], cli.main)
    message = rejected(capsys, ["score", model, videos, *coloured[2:]], cli.main)
    assert f"{model} does not say how its objects look" in message
    assert "allowed: --objects FILE with their colours, or --weights MODEL" in message
    assert not (tmp_path / "refused").exists()


def test_policies_need_a_simulator(capsys, demos_file, tmp_path):
    message = rejected(capsys, ["train", "--task", "cups", "--demos", demos_file, "--out", tmp_path / "run"], cli.main)
    assert "unknown task 'cups'" in message
