"""Table II: what it trains."""

import pytest

from benchmarks import table2
from graphrl_jax.experiment.settings import compose
from graphrl_jax.registry import make_task


def test_table_2_trains_what_it_names():
    task = make_task("shoes_in_box")
    settings = table2.settings_of(task, "graph_no_edges", "smoke")
    assert settings.reward == "graph" and table2.REWARDS["graph_no_edges"] == ("graph", ("edges",))
    assert not settings.pretrain_config.encoder.edges
    assert table2.settings_of(task, "xirl", "default").reward == "xirl"
    assert table2.settings_of(task, "graph", "default") == compose(task, "graph", "cpu")
    with pytest.raises(ValueError, match="--methods 'env'; allowed: graph, graphirl, graph_with_robot"):
        table2.Options(methods=("env",))
