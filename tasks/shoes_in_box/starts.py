"""Starts of training episodes: from the layout, and along the expert's successes.

From the layout alone, a policy meets the later subtasks too seldom to learn them. Half of the starts along a success
are shortly before a contact: the reward is flat on the way to an object, so that this way is learned only from nearby.
In some starts along a success, untouched objects are where a policy may leave them and an expert does not.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp

from tasks.shoes_in_box import geometry, kinematics, layouts
from tasks.shoes_in_box.model import INNER, LID_OPEN
from tasks.shoes_in_box.objects import OBJECTS
from tasks.shoes_in_box.state import PhysicsState, shoes, shoes_inside

# Area of the table where a disturbed shoe may lie, metres.
TABLE = ((0.25, -0.42), (0.62, 0.42))
# Objects this far from the gripper are not held, metres.
_AWAY = 0.15
_LID, _SHOES = OBJECTS.names.index("lid"), slice(OBJECTS.names.index("lid") + 1, None)
# The lid has begun to move; radians.
_LIFTED = 0.05


class Starts(NamedTuple):
    """States along successes. D episodes of T frames.

    | field    | shape      | dtype | meaning                                                           |
    |----------|------------|-------|-------------------------------------------------------------------|
    | states   | (D, T, ..) |       | `PhysicsState`                                                    |
    | active   | (D, T, N)  | bool  | activity                                                          |
    | lengths  | (D,)       | int32 | frames of each episode                                            |
    | contacts | (D, 3)     | int32 | frames in which the lid, the first and the second shoe are gripped |
    """

    states: PhysicsState
    active: jax.Array
    lengths: jax.Array
    contacts: jax.Array


class Start(NamedTuple):
    """A start: the physics state, and which objects count as moved, (N,) bool."""

    physics: PhysicsState
    active: jax.Array


@dataclass(frozen=True)
class Mixture:
    """How training starts are drawn (static).

    Attributes:
      from_start: share of episodes from the layout's own starts.
      before_contact: share of the others that start shortly before a contact; the rest start uniformly.
      lead: mean time before the contact, exponentially distributed, control steps.
      disturbed: share of the starts along successes in which untouched objects are disturbed.
    """

    from_start: float = 0.2
    before_contact: float = 0.5
    lead: float = 30.0
    disturbed: float = 0.2


def contacts_of(states: PhysicsState) -> jax.Array:
    """Frames of the first contacts in an episode with leaves (T, ...): (3,) int32."""
    lifted = jnp.argmax(states.qpos[:, 9] > _LIFTED)
    return jnp.stack([lifted, *jnp.argmax(states.touched, axis=0)]).astype(jnp.int32)


def draw(key: jax.Array, mixture: Mixture, starts: Starts) -> Start:
    """A start along a success."""
    episode_key, time_key, contact_key, lead_key, kind_key, disturb_key, which_key = jax.random.split(key, 7)
    number = jax.random.randint(episode_key, (), 0, starts.lengths.shape[0])
    uniform = jax.random.uniform(time_key) * starts.lengths[number]
    contact = starts.contacts[number, jax.random.randint(contact_key, (), 0, 3)]
    shortly = contact - mixture.lead * jax.random.exponential(lead_key)
    frame = jnp.where(jax.random.bernoulli(kind_key, mixture.before_contact), shortly, uniform)
    frame = jnp.clip(frame, 0, starts.lengths[number] - 1).astype(jnp.int32)
    physics = jax.tree.map(lambda leaf: leaf[number, frame], starts.states)
    start = Start(physics, starts.active[number, frame])
    disturbed = disturb(which_key, start)
    chosen = jax.random.bernoulli(disturb_key, mixture.disturbed)
    return jax.tree.map(lambda new, old: jnp.where(chosen, new, old), disturbed, start)


def disturb(key: jax.Array, start: Start) -> Start:
    """The same start with each shoe that lies outside, away from the gripper, somewhere else on the table with
    probability 1/2; and the lid at any angle with probability 1/4, if the gripper is away and no shoe is inside."""
    place_key, yaw_key, shoe_key, lid_key, angle_key = jax.random.split(key, 5)
    physics = start.physics
    here = kinematics.pose(physics.qpos[:7])[:3]
    places = jax.random.uniform(place_key, (2, 2), minval=jnp.array(TABLE[0]), maxval=jnp.array(TABLE[1]))
    yaws = jax.random.uniform(yaw_key, (2, 1), minval=-jnp.pi / 2, maxval=jnp.pi / 2)
    lying = shoes(physics.qpos)
    moved = shoes(layouts.pack(physics.qpos[:7], physics.qpos[9], jnp.concatenate([places, yaws], axis=1)))
    inside = shoes_inside(physics)
    clear = jnp.linalg.norm(places - here[None, :2], axis=1) > _AWAY
    # Beside the box, its own way, and on no other shoe: each keeps to its side of the table.
    clear &= (jnp.abs(places[:, 1] - physics.box[1]) > INNER[1] + 0.1) & (places[:, 1] * lying[:, 1] > 0)
    free = ~inside & (jnp.linalg.norm(lying[:, :3] - here[None], axis=1) > _AWAY)
    shifts = free & clear & jax.random.bernoulli(shoe_key, 0.5, (2,))
    placed = jnp.where(shifts[:, None], moved, lying)

    bar = geometry.bar(physics.box, physics.qpos[9])
    turned = jax.random.bernoulli(lid_key, 0.25) & (jnp.linalg.norm(bar - here) > _AWAY) & ~inside.any()
    angle = jnp.where(turned, jax.random.uniform(angle_key, maxval=LID_OPEN), physics.qpos[9])
    qpos = physics.qpos.at[9].set(angle).at[10:].set(placed.ravel())
    active = start.active.at[_SHOES].set(start.active[_SHOES] | shifts)
    active = active.at[_LID].set(active[_LID] | (turned & (angle > 0.2)))
    return Start(physics._replace(qpos=qpos), active)
