"""Tables of throughput, from result files of every age."""

from benchmarks.tables import costs

MEASURED = {
    "steps_per_second": {"physics": 200.0, "ppo_graph": 100.0},
    "of_physics": {"physics": 1.0, "ppo_graph": 0.5},
    "compile_s": {"physics": 1.0, "ppo_graph": 2.0},
    "memory_mib": {"physics": 3.0, "ppo_graph": 4.0},
}
ABOUT = {"task": "shoes_in_box", "device": "cpu", "commit": "0123456789", "command": "python -m benchmarks.throughput"}
RATIOS = {"mujoco": {"physics": 3.0, "ppo_graph": 2.5}}


def test_a_file_of_mjx_alone_is_read():
    text = costs.throughput_of({"batches": [{"num_envs": 4, **MEASURED}], **ABOUT, "task": "match_regions"})
    assert text.splitlines()[0].startswith(
        "| Match Regions: control steps/s (share of bare physics), by environments | 4 |"
    )
    assert "| bare `mjx.step`, same scene and sub-steps | 200 (1.00) | 1 | 3 |" in text
    assert "| PPO, learned reward | 100 (0.50) | 2 | 4 |" in text


def test_engines_stand_beside_each_other_with_their_ratio():
    batch = {"num_envs": 4, "engines": {"mjx": MEASURED, "mujoco": MEASURED}, "of_first_engine": RATIOS}
    text = costs.throughput_of({"batches": [batch, batch], **ABOUT})
    assert text.startswith("| Shoes in Box: control steps/s")
    assert "| mujoco: bare `mujoco.batch`, same scene and sub-steps | 200 (1.00) | 200 (1.00) | 1 | 3 |" in text
    assert "| PPO, learned reward: mujoco / mjx | 2.50 | 2.50 | | |" in text


def test_an_earlier_commit_stands_beside_the_present_one():
    slower = {**MEASURED, "steps_per_second": {"physics": 200.0, "ppo_graph": 80.0}}
    before, now = ([{"num_envs": 4, "engines": {"mujoco": one}, "of_first_engine": {}}] for one in (slower, MEASURED))
    earlier = {**ABOUT, "batches": before, "commit": "9876543210"}
    text = costs.speedup_of({**ABOUT, "batches": now, "before": earlier})
    assert "| commit 9876543 | commit 0123456 | times as fast |" in text
    assert "| PPO, learned reward | 80 (0.50) | 100 (0.50) | 1.25 |" in text
    assert costs.speedup_of({**ABOUT, "batches": now}) == ""


def test_scale_is_told_by_cores_environments_and_members():
    batch = {"num_envs": 64, "physics": 200.0, "ppo_graph": 100.0, "memory_mib": 7.0,
             "microseconds": {"physics": 6000.0, "gradient steps": 2000.0}}  # fmt: skip
    result = {**ABOUT, "cores": {"1": [batch], "2": [batch]}, "on_paper": {"1": 100.0, "4": 250.0},
              "members": {"1": 10.0, "2": 15.0}, "members_num_envs": 64}  # fmt: skip
    rows = costs.cores_of(result).splitlines()
    assert rows[0].endswith("| memory (MiB) | physics (share of time) | gradient steps (share of time) |")
    assert rows[2:4] == [f"| {cores} | 64 | 200 | 100 | 7 | 0.75 | 0.25 |" for cores in (1, 2)]
    scale = costs.scale_of(result)
    assert "| cores, on paper, with 64 environments | 1 | 4 |" in scale and "| PPO (steps/s) | 100 | 250 |" in scale
    assert "| PPO, all together (steps/s) | 10 | 15 |" in scale
