"""The study's tables: what is averaged over what, and what is compared with what."""

import json

from benchmarks.studies.reward import report
from benchmarks.tables.markers import BEGIN, END


def encoder(variant: str, pair_accuracy: float) -> dict:
    others = {name: 1.0 for name in report.MEASURES if name not in ("pair_accuracy", "undiscounted", "discounted")}
    sums = {"undiscounted": 1.0, "discounted": 1 - pair_accuracy}
    return {"variant": variant, "pair_accuracy": pair_accuracy, "successes_above": sums, **others}


def policy(encoder: str, score: float, variant: str = "default") -> dict:
    outcome = {"success_rate": score / 2, "mean_score": score, "env_steps": 1_500_000}
    return {"encoder": encoder, "variant": variant, **outcome}


ENCODERS = {
    "a_0": encoder("a", 0.75), "a_1": encoder("a", 0.25), "b_0": encoder("b", 0.9), "b_1": encoder("b", 0.8)
}  # fmt: skip
POLICIES = {name: policy(name, score) for name, score in (("a_0", 0.2), ("a_1", 0.1), ("b_0", 0.6))}


def test_encoders_are_averaged_over_seeds_with_the_worst_beside():
    head, _, a, b = report.encoder_table(ENCODERS).splitlines()
    assert head.startswith("| variant | pairs in order |") and head.endswith("| seeds |")
    assert a.startswith("| a | 0.500 (0.25) |") and a.endswith("| 2 |")
    assert b.startswith("| b | 0.850 (0.80) |") and "| 0.150 (0.10) |" in b


def test_policies_come_best_first_and_are_ranked_against_their_encoders():
    lines = report.oracle_table(ENCODERS, POLICIES).splitlines()
    assert [line.split(" | ")[0] for line in lines[2:5]] == ["| b_0", "| a_0", "| a_1"]
    assert lines[2] == "| b_0 | 30.0% | 0.600 | 1.5 |"
    assert "| pairs in order | 1.00 |" in lines and "| successes above, discounted | -1.00 |" in lines


def test_ways_to_train_policies_are_compared_on_the_encoders_they_share():
    others = {f"{name}.slots": policy(name, 0.5, "slots") for name in ("a_0", "a_1")}
    assert report.policy_table(POLICIES | others).splitlines()[2:] == [
        "| default | 7.5% | 0.150 | 2 |",
        "| slots | 25.0% | 0.500 | 2 |",
    ]


def test_ceilings_are_averaged_over_seeds():
    seeds = {
        str(seed): {
            "pair_accuracy_by_approach": {"0.5": 0.8 + seed / 10},
            "rank_correlation_by_approach": {"0.5": 0.5},
            "kendall_tau_by_approach": {"0.5": 0.25},
            "finished_above_unfinished": {"ends": 1 - seed / 10},
            "successes_above": {"undiscounted": 1.0, "discounted": 0.75 + seed / 10},
        }
        for seed in (0, 1)
    }
    lines = report.ceiling_table(seeds).splitlines()
    assert lines[2] == "| 0.5 | 0.850 | 0.500 | 0.250 |" and lines[-1] == "| 0.0 | 0.950 | 1.000 | 0.800 |"


def test_whole_trainings_come_soonest_first_and_never_comes_last():
    def run(seed: int, half_solved_at: int | None, pair_accuracy: float) -> dict:
        outcome = {"training_seed": seed, "success_rate": 1.0, "env_steps": 4_000_000, "half_solved_at": half_solved_at}
        return {**outcome, "audit": encoder("a", pair_accuracy)}

    results = {
        "graph": {"runs": [run(1, None, 0.7), run(2, 1_500_000, 0.9)]},
        "plain": {"runs": [run(3, 3_000_000, 0.8)]},
    }
    lines = report.full_table(results).splitlines()
    assert [line.split(" | ")[1:4] for line in lines[2:5]] == [
        ["2", "100.0%", "1.5"], ["3", "100.0%", "3.0"], ["1", "100.0%", "never"],
    ]  # fmt: skip
    assert lines[5].startswith("| rank correlation with being soon | | | | 1.00 |")


def test_a_report_keeps_its_own_words(tmp_path):
    (tmp_path / "report.md").write_text(f"# Words\n{BEGIN}old{END}\nmore words\n")
    other = {"a_0.slots": policy("a_0", 0.5, "slots")}
    for name, rows in (("encoders", ENCODERS), ("policies", POLICIES | other)):
        (tmp_path / f"{name}.json").write_text(json.dumps(rows))
    report.write_report(tmp_path, tmp_path)
    text = (tmp_path / "report.md").read_text()
    assert (
        text.startswith("# Words\n") and text.endswith("\nmore words\n") and "| a | 0.500" in text and "old" not in text
    )
    assert (tmp_path / "encoders.png").stat().st_size > 1000 and (tmp_path / "oracle.png").stat().st_size > 1000


def test_a_report_leaves_out_what_is_not_measured(tmp_path):
    (tmp_path / "report.md").write_text(f"{BEGIN}{END}")
    (tmp_path / "encoders.json").write_text(json.dumps(ENCODERS))
    report.write_report(tmp_path, tmp_path)
    text = (tmp_path / "report.md").read_text()
    assert "| a | 0.500" in text and "ideal" not in text and "policy" not in text and "nan" not in text
    assert not (tmp_path / "oracle.png").exists()
