"""What people read is true: links resolve, tables are those of result files and code, examples run."""

import contextlib
import io
import json
import re
import runpy
import shlex
from pathlib import Path

import pytest

from benchmarks import tables
from docs import generate
from graphrl_jax import cli
from graphrl_jax.experiment.methods import METHODS
from graphrl_jax.perception.objects_file import read_objects
from tests.helpers.commands import call
from tests.helpers.outside_package import EXAMPLE, REPOSITORY

README, DOCS = REPOSITORY / "README.md", REPOSITORY / "docs"
PAGES = [README, *sorted(DOCS.glob("*.md")), *sorted((REPOSITORY / "benchmarks").rglob("*.md"))]
RESULTS = sorted((REPOSITORY / "benchmarks").rglob("*.json")) + sorted((REPOSITORY / "checkpoints").rglob("*.json"))


def code_blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", page.read_text(), re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_are_relative_and_resolve(page):
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        target, _, section = link.partition("#")
        if target.partition("://")[1] or link == "":
            continue
        assert not Path(target).is_absolute(), link
        assert (page.parent / target).exists(), link
        if section:
            linked = page if not target else page.parent / target
            assert section in headings(linked), link


def headings(page: Path) -> set[str]:
    """Anchors of a page's headings, as GitHub makes them."""
    found = re.findall(r"^#+ (.+)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading).strip().lower().replace(" ", "-") for heading in found}


def test_the_readme_is_short():
    text = README.read_text()
    assert len(text.splitlines()) <= 180 and len(text.split()) <= 1200


@pytest.mark.parametrize("page", [README, DOCS / "results.md"], ids=lambda page: page.name)
def test_tables_are_those_of_the_result_files(page):
    text = page.read_text()
    assert tables.END in text and tables.with_tables(text) == text


def test_the_configuration_is_that_of_the_code():
    text = generate.PAGE.read_text()
    assert generate.BEGIN in text and generate.with_fields(text) == text


@pytest.mark.parametrize("page", [*PAGES, *RESULTS], ids=lambda page: str(page.relative_to(REPOSITORY)))
def test_no_path_of_a_particular_machine(page):
    assert not re.search(r"(?<![\w.:/-])/(?:work|root|home|tmp|Users|mnt|data)/\w", page.read_text())


def test_the_readmes_example_draws_a_curve(tmp_path, monkeypatch):
    (example,) = code_blocks(README, "python")
    assert len(example.splitlines()) <= 30
    monkeypatch.chdir(tmp_path)
    (tmp_path / "checkpoints").symlink_to(REPOSITORY / "checkpoints")
    exec(compile(example, "README.md", "exec"), {})
    assert [path for path in tmp_path.glob("*.png") if path.stat().st_size > 5000]


def test_the_commands_of_your_own_video_run(tmp_path, monkeypatch):
    """As they stand, but for a shorter pretraining, and in this process; what is installed before is installed."""
    page = DOCS / "your_own_video.md"
    monkeypatch.chdir(tmp_path)
    (tmp_path / "docs").symlink_to(DOCS)
    for line in "".join(code_blocks(page, "bash")).splitlines():
        program, *arguments = shlex.split(line)
        if program in ("make", "source"):
            continue
        if program == "python":
            monkeypatch.setattr("sys.argv", arguments)
            runpy.run_path(arguments[0], run_name="__main__")
        else:
            call(cli.main, *arguments, *(["--steps", "200"] if arguments[0] == "pretrain" else []))
    (example,) = code_blocks(page, "python")
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(compile(example, page.name, "exec"), {})
    start, _, end = map(float, printed.getvalue().strip("[ ]\n").split())
    assert start < end
    ranked = json.loads((tmp_path / "scores" / "scores.json").read_text())["recordings"]
    assert len(ranked) == 6 and Path(ranked[0]["recording"]).name.partition("_")[0] == "both"
    assert Path(ranked[-1]["recording"]).name == "nothing_1.mp4"
    assert (tmp_path / "scores" / "report.html").stat().st_size < 5e6
    template, finished = (tmp_path / "my_objects.toml", DOCS / "examples" / "desk" / "desk.toml")
    assert read_objects(template).objects.names == read_objects(finished).objects.names


def test_a_new_method_is_one_row(tmp_path, outside_package):
    """The block of docs/adding_a_method.md adds the row and trains a policy on it."""
    (block,) = [block for block in code_blocks(DOCS / "adding_a_method.md", "python") if "METHODS[" in block]
    out, before = tmp_path / "run", dict(METHODS)
    try:
        exec(compile(block, "adding_a_method.md", "exec"), {"out": str(out)})
    finally:
        METHODS.clear()
        METHODS.update(before)
    assert (out / "summary.json").exists() and (out / "policy.npz").exists()


def test_the_examples_of_gymnasium_run(monkeypatch):
    monkeypatch.chdir(REPOSITORY)
    names: dict = {}
    # The last one needs a package that the tests do without; tests/gym/test_stable_baselines.py runs it.
    for block in code_blocks(DOCS / "gymnasium.md", "python")[:-1]:
        exec(compile(block, "gymnasium.md", "exec"), names)
    assert names["envs"].num_envs == len(names["rewards"]) == 8
    assert -2 <= names["reward"] < 0 != names["info"]["environment_reward"] != names["reward"]


def test_excerpts_of_the_example_task_are_in_it():
    source = (EXAMPLE / "carry_task.py").read_text()
    blocks = [block for language in ("python", "text") for block in code_blocks(DOCS / "adding_a_task.md", language)]
    assert blocks
    for block in blocks:
        for piece in re.split(r"^\s*\.\.\.\s*$", block, flags=re.MULTILINE):
            assert piece.strip("\n") in source, piece
