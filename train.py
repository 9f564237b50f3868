"""One command: demonstrations -> encoder -> frozen reward -> policy, with everything it made in one folder."""

from graphrl_jax.cli import train_main

if __name__ == "__main__":
    train_main()
