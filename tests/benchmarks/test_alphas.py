"""A sweep over alpha: what is asked for, and what is collected."""

from benchmarks import alphas
from graphrl_jax.storage import write_json


def test_a_sweep_over_alpha_is_collected_with_what_is_done(tmp_path):
    for alpha, seed, rate in ((16.0, 40, None), (2.0, 41, None), (2.0, 40, 0.5)):
        folder = tmp_path / f"alpha={alpha:g},seed={seed}"
        write_json(folder / "config.json", {"pretrain": {"alpha": alpha, "temperature": 1.0}, "seed": seed})
        write_json(folder / "encoder.json", {"pair_accuracy": 0.9})
        if rate is not None:
            write_json(folder / "summary.json", {"success_rate": rate})
            (folder / "metrics.jsonl").write_text('{"stage": "ppo", "env_steps": 9, "success": 0.3, "score": 1}\n')
    rows = alphas.members_of(tmp_path)
    assert [(row["swept"]["pretrain.alpha"], row["seed"]) for row in rows] == [(2.0, 40), (2.0, 41), (16.0, 40)]
    assert [row.get("success_rate") for row in rows] == [0.5, None, None]
    assert [row.get("training") for row in rows] == [{"env_steps": 9, "success": 0.3}, None, None]


def test_the_sweep_is_what_the_options_say(tmp_path):
    usual = alphas.Options()
    assert usual.folder.name == "alphas_match_regions_layout" and usual.request.alphas == "1,2,4,8,16"
    assert (usual.request.seeds, usual.request.first_seed, usual.request.sweep) == (5, 40, ())
    asked = {"temperatures": "0.01,1", "encoder_steps": 1500, "encoders_only": True}
    request = alphas.Options(task="shoes_in_box", alphas="1,2", sweep=tmp_path, **asked).request
    assert request.sweep == ("pretrain.temperature=0.01,1",) and request.pretrain.steps == 1500
    assert (request.out, request.task, request.encoders_only) == (tmp_path, "shoes_in_box", True)
