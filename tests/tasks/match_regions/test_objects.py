"""Which object sits in which slot."""

import jax
import jax.numpy as jnp
import numpy as np

from graphrl_jax.graph import build_graph
from tasks.match_regions import geometry, layouts, variants
from tasks.match_regions.objects import class_ids, variant_objects


def test_classes_say_colour_and_shape() -> None:
    objects = variant_objects(variants.BLOCKS)
    world = jax.jit(variants.VARIANTS["all"].sample)(jax.random.key(2)).world
    names = [objects.class_names[index] for index in class_ids(world)]
    assert names[0] == f"{layouts.COLOURS[world.region_colour]}_region" and names[1] == "robot"
    expected = [f"{layouts.COLOURS[c]}_{geometry.SHAPES[s]}" for c, s in zip(world.colours, world.shapes, strict=True)]
    assert names[2:] == expected
    graph = build_graph(objects, jnp.zeros((10, 4)), jnp.ones(10, bool), jnp.zeros(10, bool), class_ids(world))
    np.testing.assert_array_equal(np.argmax(graph.classes, axis=1), class_ids(world))
