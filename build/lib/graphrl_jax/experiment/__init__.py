"""Experiments: demonstrations -> encoder -> reward -> policy -> summary, for one run or for many side by side."""
