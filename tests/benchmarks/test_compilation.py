"""Seconds of compilation."""

import pytest

from benchmarks import compilation
from benchmarks.tables.compilation import compilation_of

LOG = """Finished XLA compilation of jit(run) in 7.5 sec
Finished jaxpr to MLIR module conversion jit(run) in 1.0 sec
Finished XLA compilation of jit(step) in 0.4 sec
Finished XLA compilation of jit(run) in 2.5e-01 sec
Finished XLA compilation of jit(evaluate) in 8.0 sec
"""


def test_programs_are_summed_up_by_name_and_short_ones_together():
    assert compilation.by_program(LOG) == {"evaluate": 8.0, "run": 7.75, "others": pytest.approx(0.4)}


def test_earlier_sources_have_to_be_there(tmp_path):
    with pytest.raises(ValueError, match="--before .* has no folder graphrl_jax"):
        compilation.Options(before=tmp_path)


def test_the_table_has_a_column_per_cache_and_source():
    cold = {"before": {"wall_s": 50.0, "programs": {"run": 11.0, "others": 3.0}},
            "now": {"wall_s": 40.0, "programs": {"evaluate": 2.0, "run": 7.0, "others": 1.0}}}  # fmt: skip
    warm = {name: {"wall_s": 20.0, "programs": {"others": 0.5}} for name in cold}
    result = {"cold": cold, "warm": warm, "device": "cpu", "commit": "0123456789", "command": "python -m x"}
    lines = compilation_of(result).splitlines()
    assert lines[0] == "| compiled (s) | cold, before | cold, now | warm, before | warm, now |"
    assert lines[2:6] == [
        "| `evaluate` | - | 2.0 | - | - |",
        "| `run` | 11.0 | 7.0 | - | - |",
        "| `others` | 3.0 | 1.0 | 0.5 | 0.5 |",
        "| the whole run | 50.0 | 40.0 | 20.0 | 20.0 |",
    ]
