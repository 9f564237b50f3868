"""Settings of the test session: compile fast rather than well; how MuJoCo renders is settled before its import."""

import os

import jax

# Most of a test's time would go into optimising programs that run for milliseconds.
if jax.__version_info__ < (0, 11):
    os.environ["XLA_FLAGS"] = os.environ.get("XLA_FLAGS", "") + " --xla_cpu_use_fusion_emitters=false"
jax.config.update("jax_disable_most_optimizations", True)

import graphrl_jax  # noqa: E402, F401
