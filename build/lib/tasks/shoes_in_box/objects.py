"""The object table of Shoes in Box."""

from graphrl_jax.graph import ObjectTable
from tasks.shoes_in_box.model import SHOE_NAMES

OBJECTS = ObjectTable(
    names=("gripper", "box", "lid", *SHOE_NAMES),
    class_ids=(0, 1, 2, 3, 3),
    is_robot=(True, False, False, False, False),
    class_names=("gripper", "box", "lid", "shoe"),
    is_fixture=(False, True, False, False, False),
    is_articulated=(False, False, True, False, False),
)
