"""Starts of training episodes: from the layout, and along the expert's successes.

From the layout alone, a policy meets the later jobs too seldom to learn them. So most episodes start within a job (lid,
first shoe, second shoe) of a success, at first near its end, then farther and farther from it (Florensa et al.,
"Reverse curriculum generation for reinforcement learning", 2017). How far is learned in every environment, by a
staircase that goes up after a success and down after a failure. In some starts, untouched objects are where a policy
may leave them and an expert does not.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp

from tasks.shoes_in_box import geometry, kinematics, layouts
from tasks.shoes_in_box.model import INNER, LID_OPEN
from tasks.shoes_in_box.objects import OBJECTS
from tasks.shoes_in_box.state import PhysicsState, events, shoes, shoes_inside

# Area of the table where a disturbed shoe may lie, metres.
TABLE = ((0.25, -0.42), (0.62, 0.42))
# Objects this far from the gripper are not held, metres.
_AWAY = 0.15
# Places drawn for a disturbed shoe, of which the first clear one counts.
_PLACES = 16
_LEAST_LEAD = 0.05
_LID, _SHOES = OBJECTS.names.index("lid"), slice(OBJECTS.names.index("lid") + 1, None)


class Starts(NamedTuple):
    """States along successes. D episodes of T frames.

    | field  | shape      | dtype | meaning                                                            |
    |--------|------------|-------|--------------------------------------------------------------------|
    | states | (D, T, ..) |       | `PhysicsState`                                                     |
    | active | (D, T, N)  | bool  | activity                                                           |
    | ends   | (D, 3)     | int32 | frames from which on the lid is open, one shoe and both are inside |
    """

    states: PhysicsState
    active: jax.Array
    ends: jax.Array


class Start(NamedTuple):
    """A start: the physics state, and which objects count as moved, (N,) bool."""

    physics: PhysicsState
    active: jax.Array


class Curriculum(NamedTuple):
    """How far from the end of each job the episodes of an environment start.

    | field | shape | dtype   | meaning                                                               |
    |-------|-------|---------|-----------------------------------------------------------------------|
    | leads | (3,)  | float32 | largest share of each job that is left at a start                     |
    | job   | ()    | int32   | the job in which this episode started, -1 if its success changes none |
    """

    leads: jax.Array
    job: jax.Array


@dataclass(frozen=True)
class Mixture:
    """How training starts are drawn (static).

    Attributes:
      from_start: share of episodes from the layout's own starts; starts with the whole job of the lid left come on top.
      disturbed: share of the starts along successes in which untouched objects are disturbed.
      first_lead: the leads of `Curriculum` before the first episode.
      growth: factor on a lead after an episode in which its job was done.
      success: share of such episodes at which a lead stays the same on average.
    """

    from_start: float = 0.2
    disturbed: float = 0.2
    first_lead: float = 0.25
    growth: float = 1.6
    success: float = 0.6


def jobs_done(state: PhysicsState) -> jax.Array:
    """How many jobs are done, of the lid and two shoes; () int32."""
    return jnp.sum(events(state), dtype=jnp.int32)


def ends_of(states: PhysicsState) -> jax.Array:
    """Frames from which on one, two and three jobs stay done, in an episode with leaves (T, ...): (3,) int32."""
    done = jax.lax.cummin(jax.vmap(jobs_done)(states), reverse=True)
    return jnp.argmax(done[:, None] > jnp.arange(3)[None], axis=0).astype(jnp.int32)


def begin(mixture: Mixture) -> Curriculum:
    """The curriculum before the first episode."""
    return Curriculum(jnp.full(3, mixture.first_lead), jnp.full((), -1, jnp.int32))


def adapt(curriculum: Curriculum, mixture: Mixture, last: PhysicsState) -> Curriculum:
    """The curriculum after an episode that ended in the state `last`.

    A weighted up-down staircase (Kaernbach, "Simple adaptive testing with the weighted up-down method", 1991).
    """
    down = mixture.growth ** -(mixture.success / (1 - mixture.success))
    factor = jnp.where(jobs_done(last) > curriculum.job, mixture.growth, down)
    leads = jnp.where(jnp.arange(3) == curriculum.job, factor * curriculum.leads, curriculum.leads)
    return curriculum._replace(leads=jnp.clip(leads, _LEAST_LEAD, 1.0))


def draw(
    key: jax.Array, mixture: Mixture, starts: Starts, curriculum: Curriculum, first: Start
) -> tuple[Start, Curriculum]:
    """The start of a training episode, and the curriculum with its job.

    Args:
      key: randomness.
      mixture: shares of the kinds of starts.
      starts: states along successes.
      curriculum: leads.
      first: a start from the layout.
    """
    episode_key, job_key, lead_key, first_key, disturb_key, which_key = jax.random.split(key, 6)
    number = jax.random.randint(episode_key, (), 0, starts.ends.shape[0])
    job = jax.random.randint(job_key, (), 0, 3)
    ends = jnp.append(0, starts.ends[number])
    # Starts farther from the end, where more is to be learned, are more likely.
    lead = curriculum.leads[job] * jnp.sqrt(jax.random.uniform(lead_key))
    frame = jnp.round(ends[job + 1] - lead * (ends[job + 1] - ends[job])).astype(jnp.int32)
    start = Start(jax.tree.map(lambda leaf: leaf[number, frame], starts.states), starts.active[number, frame])

    def choose(chosen: jax.Array, new: Start, old: Start) -> Start:
        return jax.tree.map(lambda a, b: jnp.where(chosen, a, b), new, old)

    disturbed = jax.random.bernoulli(disturb_key, mixture.disturbed)
    anyhow = jax.random.bernoulli(first_key, mixture.from_start)
    start = choose(disturbed, disturb(which_key, start), start)
    start = choose(anyhow | (frame == 0), first, start)
    return start, curriculum._replace(job=jnp.where(anyhow | disturbed, -1, job))


def disturb(key: jax.Array, start: Start) -> Start:
    """The same start with each shoe that lies outside, away from the gripper, somewhere else on its side of the table
    with probability 1/2; and the lid at any angle with probability 1/4, if the gripper is away and no shoe is inside.

    A shoe stays where it is if none of a few places drawn for it is clear of box and gripper, as happens seldom.
    """
    place_key, yaw_key, shoe_key, lid_key, angle_key = jax.random.split(key, 5)
    physics = start.physics
    here = kinematics.pose(physics.qpos[:7])[:3]
    places = jax.random.uniform(place_key, (2, _PLACES, 2), minval=jnp.array(TABLE[0]), maxval=jnp.array(TABLE[1]))
    # Beside the box, its own way, and on no other shoe: each keeps to its side of the table.
    lying = shoes(physics.qpos)
    clear = jnp.linalg.norm(places - here[None, None, :2], axis=-1) > _AWAY
    clear &= (jnp.abs(places[..., 1] - physics.box[1]) > INNER[1] + 0.1) & (places[..., 1] * lying[:, 1:2] > 0)
    places = jnp.take_along_axis(places, jnp.argmax(clear, axis=1)[:, None, None], axis=1)[:, 0]
    yaws = jax.random.uniform(yaw_key, (2, 1), minval=-jnp.pi / 2, maxval=jnp.pi / 2)
    moved = shoes(layouts.pack(physics.qpos[:7], physics.qpos[9], jnp.concatenate([places, yaws], axis=1)))
    inside = shoes_inside(physics)
    free = ~inside & (jnp.linalg.norm(lying[:, :3] - here[None], axis=1) > _AWAY)
    shifts = free & clear.any(axis=1) & jax.random.bernoulli(shoe_key, 0.5, (2,))
    placed = jnp.where(shifts[:, None], moved, lying)

    bar = geometry.bar(physics.box, physics.qpos[9])
    turned = jax.random.bernoulli(lid_key, 0.25) & (jnp.linalg.norm(bar - here) > _AWAY) & ~inside.any()
    angle = jnp.where(turned, jax.random.uniform(angle_key, maxval=LID_OPEN), physics.qpos[9])
    qpos = physics.qpos.at[9].set(angle).at[10:].set(placed.ravel())
    active = start.active.at[_SHOES].set(start.active[_SHOES] | shifts)
    active = active.at[_LID].set(active[_LID] | (turned & (angle > 0.2)))
    return Start(physics._replace(qpos=qpos), active)
