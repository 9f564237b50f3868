"""Shoes in Box for tests: one task object, so that programs compiled for it serve them all."""

from tasks.shoes_in_box.task import ShoesInBox

TASK = ShoesInBox()
