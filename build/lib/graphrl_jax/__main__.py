"""`python -m graphrl_jax`, the same as `graphrl`."""

from graphrl_jax.cli import main

main()
