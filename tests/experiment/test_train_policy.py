"""Policy training from a task's own starts."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from graphrl_jax.encoder.pooling import PoolingParams
from graphrl_jax.experiment.keys import RunStage, stage_key
from graphrl_jax.experiment.policy_programs import PolicyJob
from graphrl_jax.experiment.run_directory import Run, RunError
from graphrl_jax.experiment.settings import compose
from graphrl_jax.experiment.train_policy import train_policies
from graphrl_jax.progress import Progress
from graphrl_jax.registry import make_task
from graphrl_jax.rl import ppo
from graphrl_jax.storage import load_tree
from tests.helpers.commands import arrays

pytestmark = pytest.mark.usefixtures("outside_package")


def test_starts_are_drawn_from_seed_and_pooling_and_kept_for_a_resumed_run(tmp_path):
    task = make_task("carry")
    given, made = [], []

    def training_starts(key: jax.Array, pooling: PoolingParams) -> dict[str, jax.Array]:
        made.append(pooling.activity)
        return {"places": jax.random.uniform(key, (5, 2)), "tau": jnp.asarray(pooling.tau)}

    def training(starts: dict[str, jax.Array] | None = None):
        given.append(starts["places"].shape)
        return task

    # As the methods of another class of the task would be.
    vars(task).update(training_starts=training_starts, training=training)
    settings = compose(task, "env", "smoke", seed=3, updates=2, pretrain={"tau": 0.25}, ppo={"num_envs": 8})
    run = Run.start(tmp_path / "run", settings)
    job = PolicyJob(run, settings, PoolingParams())
    train_policies([job], task, Progress())
    kept = load_tree(run.path / "starts.npz", {"places": jnp.zeros((5, 2)), "tau": jnp.zeros(())})
    expected = jax.random.uniform(stage_key(3, RunStage.STARTS), (5, 2))
    np.testing.assert_array_equal(kept["places"], expected)
    assert kept["tau"] == 0.25 and set(made) == {"displacement"} and set(given) == {(5, 2)}
    before = arrays(run.path / "starts.npz")
    (run.path / "policy.npz").unlink()
    (run.path / "train_state.npz").unlink()
    # On another machine they would come out otherwise.
    vars(task).update(training_starts=lambda *_: {"places": jnp.ones((5, 2)), "tau": jnp.zeros(())})
    train_policies([job], task, Progress())
    after = arrays(run.path / "starts.npz")
    assert before.keys() == after.keys()
    for name, values in before.items():
        np.testing.assert_array_equal(after[name], values)


def test_a_task_without_starts_of_its_own_keeps_none(tmp_path):
    task = make_task("carry")
    settings = compose(task, "env", "smoke", updates=2, ppo={"num_envs": 8})
    run = Run.start(tmp_path / "run", settings)
    train_policies([PolicyJob(run, settings, PoolingParams())], task, Progress())
    assert not (run.path / "starts.npz").exists() and (run.path / "policy.npz").exists()


@pytest.fixture
def trained(tmp_path):
    """A job that has made two updates, of a training of four."""
    task = make_task("carry")
    settings = compose(task, "env", "smoke", updates=4, ppo={"num_envs": 8})
    settings = replace(settings, updates_per_chunk=2)
    job = PolicyJob(Run.start(tmp_path / "run", settings), settings, PoolingParams())
    first = replace(job, settings=replace(settings, updates=2))
    train_policies([first], task, Progress())
    return task, job


def numbers_of(run: Run) -> list[dict]:
    return [{name: value for name, value in one.items() if name != "steps_per_s"} for one in run.records("ppo")]


def test_a_torn_checkpoint_costs_one_chunk_and_changes_no_number(trained, capsys):
    task, job = trained
    train_policies([job], task, Progress())
    expected, policy = numbers_of(job.run), arrays(job.run.path / "policy.npz")
    path = job.run.path / "train_state.npz"
    path.write_bytes(path.read_bytes()[:1000])
    train_policies([job], task, Progress())
    assert "train_state.npz is damaged" in capsys.readouterr().err
    assert numbers_of(job.run) == expected
    for name, values in arrays(job.run.path / "policy.npz").items():
        np.testing.assert_array_equal(values, policy[name])


@pytest.mark.parametrize(("name", "value"), [("bad_envs", 0.02), ("skipped_steps", 0.5), ("skipped_steps", np.nan)])
def test_a_training_that_diverges_stops_and_keeps_its_last_checkpoint(trained, monkeypatch, name, value):
    task, job = trained
    before = (job.run.path / "train_state.npz").read_bytes(), (job.run.path / "policy.npz").read_bytes()
    average = ppo.average_metrics
    monkeypatch.setattr(ppo, "average_metrics", lambda metrics: {**average(metrics), name: np.asarray(value)})
    with pytest.raises(RunError, match=f"run diverges: {name} is .* up to update 4 .*metrics.jsonl"):
        train_policies([job], task, Progress())
    assert ((job.run.path / "train_state.npz").read_bytes(), (job.run.path / "policy.npz").read_bytes()) == before
    assert [line["update"] for line in job.run.records("ppo")] == [2, 4]


@pytest.fixture
def solving(tmp_path, monkeypatch):
    """The share of its own episodes that a training solves, in a list; the training, of six chunks; and its job."""
    share, average = [0.7], ppo.average_metrics

    def averages(metrics: ppo.Metrics) -> dict[str, np.ndarray]:
        return {**average(metrics), "success": np.asarray(share[0]), "score": np.asarray(share[0])}

    monkeypatch.setattr(ppo, "average_metrics", averages)
    task = make_task("carry")
    settings = replace(compose(task, "env", "smoke", updates=6, stop_at=0.9, ppo={"num_envs": 8}), updates_per_chunk=1)
    return share, task, PolicyJob(Run.start(tmp_path / "run", settings), settings, PoolingParams())


def test_a_training_ends_once_the_policy_solves_enough_twice_in_a_row(solving):
    _, task, job = solving
    found = iter([0.95, 0.5, 0.9, 1.0])
    ((_, metrics),) = train_policies([job], task, Progress(), evaluate=lambda *_: next(found))
    assert [line["success_rate"] for line in job.run.records("evaluation")] == [0.95, 0.5, 0.9, 1.0]
    assert job.run.records("ppo")[-1]["update"] == 4
    assert metrics["env_steps"] == 4 * job.settings.ppo_config.steps_per_update
    # A run that was interrupted afterwards has ended as well.
    ((_, again),) = train_policies([job], task, Progress(), evaluate=lambda *_: pytest.fail("it is over"))
    assert again["env_steps"] == metrics["env_steps"]


@pytest.mark.parametrize(("share", "stop_at"), [(0.4, 0.9), (0.7, 0.0)])
def test_a_training_that_solves_little_or_has_no_end_is_not_evaluated(solving, share, stop_at):
    shares, task, job = solving
    shares[0] = share
    job = replace(job, settings=replace(job.settings, stop_at=stop_at))
    train_policies([job], task, Progress(), evaluate=lambda *_: pytest.fail("nobody asked"))
    assert job.run.records("ppo")[-1]["update"] == 6
