"""`python -m graphrl_jax`: see `cli.py`."""

from graphrl_jax.cli import main

main()
