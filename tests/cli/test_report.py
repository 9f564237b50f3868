"""`graphrl report`: a finished run, an interrupted one, an encoder alone, and folders that hold no run."""

import re
import shutil
from dataclasses import replace

import pytest

from graphrl_jax import cli
from graphrl_jax.demonstrations import load
from tests.helpers.commands import call, contents, rejected

pytestmark = pytest.mark.usefixtures("outside_package")


def test_a_finished_run_has_a_page_and_stays_as_it_is(finished, tmp_path):
    before = contents(finished)
    answer = call(cli.main, "report", finished, "--out", tmp_path / "new" / "page.html")
    text = (tmp_path / "new" / "page.html").read_text()
    assert contents(finished) == before and answer["out"] == str(tmp_path / "new" / "page.html")
    for section in ("missed", "curve", "policy", "reward", "demonstrations", "settings"):
        assert f'id="{section}"' in text, section
    assert "graphrl train \\\n  --task carry" in text and text.count("<li>") == len(answer["missed"])
    assert not re.findall(r"(?:src|href)=\"(?!#|data:)", text) and "http" not in text
    assert (tmp_path / "new" / "page.html").stat().st_size < 5e6


def test_an_interrupted_run_has_a_page_that_is_replaced_later(finished, tmp_path):
    run = tmp_path / "run & <b>"
    run.mkdir()
    shutil.copy(finished / "config.json", run)
    call(cli.main, "report", run)
    early = (run / "report.html").read_text()
    assert "The reward is not learned" in early and "not evaluated" in early and "run &amp; &lt;b&gt;" in early
    assert 'id="curve"' not in early
    shutil.copytree(finished, run, dirs_exist_ok=True)
    answer = call(cli.main, "report", run)
    assert answer["out"] == str(run / "report.html")
    assert 'id="curve"' in (run / "report.html").read_text()
    assert not [path for path in run.iterdir() if "tmp" in path.name]


def test_an_encoder_of_a_task_that_is_not_registered_has_a_page(demos_file, tmp_path):
    demos, out = tmp_path / "drawer.npz", tmp_path / "encoder"
    replace(load(demos_file), task="drawer <i>", events=None, event_names=(), kinds=None).save(demos)
    sizes = ["--steps", 4, "--pretrain.batch-size", 2, "--pretrain.num-frames", 8]
    call(cli.main, "pretrain", "--demos", demos, "--out", out, *sizes)
    answer = call(cli.main, "report", out)
    text = (out / "report.html").read_text()
    assert "drawer &lt;i&gt;: graph reward" in text and "known from recordings alone" in text
    assert "graphrl pretrain \\\n" in text and "--pretrain.steps 4" in text
    assert 'id="policy"' not in text and not any("policy" in sentence for sentence in answer["missed"])
    demos.unlink()
    answer = call(cli.main, "report", out)
    assert any("drawer.npz: there is no such file" in sentence for sentence in answer["missed"])


def test_what_cannot_be_reported_is_one_sentence(capsys, finished, tmp_path):
    assert f"{tmp_path} holds no run" in rejected(capsys, ["report", tmp_path], cli.main)
    other = rejected(capsys, ["report", finished, "--out", tmp_path / "page.txt"], cli.main)
    assert "page.txt; allowed: a file whose name ends in .html" in other
    assert not list(tmp_path.iterdir())
