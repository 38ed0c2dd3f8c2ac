"""A world made harder, or its prior honest: clutter, partial view, slips, misstated noise, roads.

Each takes a world and returns another; what is not named stays as it was.
"""

from dataclasses import replace

import numpy as np

from sngr_utils.world.dead_reckoning import dead_reckoning
from sngr_utils.world.scenario import Scenario
from sngr_utils.world.simulation import World, measure
from sngr_utils.world.wrong_associations import wrong_associations


def draw_x0(world: World, sigmas: list[float], *, rng: np.random.Generator) -> World:
    """The mean of the x0 prior drawn about the truth, as its sigmas say it is.

    The paper's prior is centred on the truth: it errs by nothing, which its sigmas deny, and a
    consistent estimator has a NEES below the number of coordinates. With this one it has 2.

    Parameters
    ----------
    sigmas : (3,) in the body frame, [m, m, rad]
    """
    noise = rng.normal(size=3) * sigmas
    return replace(world, x0_mean=dead_reckoning(world.poses[0], noise[None])[-1])


def burst(world: World, p: float, length: int, *, rng: np.random.Generator) -> World:
    """Wrong associations at `length` consecutive poses, beginning at a random one, with chance p.

    Outside the burst all labels are true. The place is uniform, so that it tells nothing of
    where the trajectory is held weakly.

    Parameters
    ----------
    p : probability that a range of the burst is attached to a wrong landmark, in [0, 1]
    length : poses, from 1 to T

    Raises
    ------
    ValueError : p or length out of range
    """
    if not 0 <= p <= 1:
        raise ValueError(f"p is {p!r}: a wrong-association probability lies in [0, 1]")
    if not 1 <= length <= world.n_poses:
        raise ValueError(f"length is {length!r}: a burst has from 1 to {world.n_poses} poses")
    first = rng.integers(world.n_poses - length + 1)
    inside = (world.pose_of >= first) & (world.pose_of < first + length)
    wrong = wrong_associations(world.source_of, world.n_landmarks, p, rng=rng)
    return replace(world, label_of=np.where(inside, wrong, world.source_of))


def slip(world: World, steps: int, sigma: float, *, rng: np.random.Generator) -> World:
    """Odometry that errs by N(0, sigma^2) more in x and y at `steps` consecutive steps.

    The estimator is not told. The place is uniform.

    Parameters
    ----------
    steps : from 1 to T-1
    sigma : per step and axis, [m]

    Raises
    ------
    ValueError : steps or sigma out of range
    """
    if not 1 <= steps <= len(world.odometry):
        raise ValueError(f"steps is {steps!r}: there are {len(world.odometry)}")
    if sigma < 0:
        raise ValueError(f"sigma is {sigma!r}: it must not be negative")
    first = rng.integers(len(world.odometry) - steps + 1)
    odometry = world.odometry.copy()
    odometry[first : first + steps, :2] += rng.normal(size=(steps, 2)) * sigma
    return replace(world, odometry=odometry)


def jump(world: World, metres: float, radians: float, *, rng: np.random.Generator) -> World:
    """Odometry that misses one motion: by a distance in a random direction, and by a turn.

    The step is uniform, the turn to either side.
    """
    at = rng.integers(len(world.odometry))
    angle, side = rng.uniform(0, 2 * np.pi), rng.choice([-1.0, 1.0])
    odometry = world.odometry.copy()
    odometry[at] += [metres * np.cos(angle), metres * np.sin(angle), side * radians]
    return replace(world, odometry=odometry)


def misstated(world: World, range_factor: float, odometry_factor: float) -> World:
    """The estimator is told so many times the noise that there is."""
    s = world.scenario
    told = {
        "range_sigma": s.range_sigma * range_factor,
        "odometry_sigma_xy": s.odometry_sigma_xy * odometry_factor,
        "odometry_sigma_theta": s.odometry_sigma_theta * odometry_factor,
    }
    return replace(world, scenario=s.model_copy(update=told))


def within_reach(world: World, reach: float) -> World:
    """Only ranges from landmarks nearer than `reach` to the pose, [m]."""
    offsets = world.poses[world.pose_of, :2] - world.landmarks[world.source_of]
    return world.keep(np.linalg.norm(offsets, axis=1) < reach)


# --- clutter: ranges that come from no landmark, whose source is -1 ---------------------------


def clutter_replaced(
    world: World, share: float, longest: float, *, rng: np.random.Generator
) -> World:
    """Each range, with probability `share`, uniform in [0, longest] instead, [m]; labels stay."""
    hit = rng.random(len(world.ranges)) < share
    drawn = rng.uniform(0, longest, len(world.ranges))
    return replace(
        world,
        ranges=np.where(hit, drawn, world.ranges),
        source_of=np.where(hit, -1, world.source_of),
    )


def clutter_added(world: World, share: float, longest: float, *, rng: np.random.Generator) -> World:
    """As many more ranges, uniform in [0, longest] [m], that `share` of all are clutter.

    Their poses are uniform, and so are their labels; in a scan they come last.
    """
    count = rng.binomial(len(world.ranges), share / (1 - share))
    added = {
        "pose_of": rng.integers(world.n_poses, size=count),
        "label_of": rng.integers(world.n_landmarks, size=count),
        "source_of": np.full(count, -1),
        "ranges": rng.uniform(0, longest, count),
    }
    order = np.argsort(np.append(world.pose_of, added["pose_of"]), kind="stable")
    return replace(
        world, **{name: np.append(getattr(world, name), v)[order] for name, v in added.items()}
    )


def too_long(world: World, share: float, most: float, *, rng: np.random.Generator) -> World:
    """Each range, with probability `share`, longer by a uniform length up to `most`, [m].

    It took another way than the straight one, and its source counts as none.
    """
    hit = rng.random(len(world.ranges)) < share
    extra = rng.uniform(0, most, len(world.ranges))
    return replace(
        world,
        ranges=world.ranges + hit * extra,
        source_of=np.where(hit, -1, world.source_of),
    )


# --- roads --------------------------------------------------------------------------------------


def on_a_road(scenario: Scenario, bend: float, p: float, *, rng: np.random.Generator) -> World:
    """A road driven once in each direction, with a bend in its middle, instead of the circle.

    Steps are as long as those of the circle. Landmarks are uniform on a strip along the road,
    up to `landmark_half_width` to either side of each half, and a tenth of that at least.

    Parameters
    ----------
    bend : 0 for a straight road, pi / 2 for one in the shape of an L, [rad]
    """
    (association_rng,) = rng.spawn(1)
    s, n = scenario, (scenario.n_poses + 1) // 2
    step = 2 * np.pi * s.radius / s.n_poses
    headings = np.where(np.arange(n) < n // 2, 0.0, bend)
    ahead = np.column_stack([np.cos(headings), np.sin(headings)])
    road = np.vstack([np.zeros(2), np.cumsum(step * ahead[:-1], axis=0)])
    out = np.column_stack([road, headings])
    back = np.column_stack([road[::-1], headings[::-1] - np.pi])
    poses = np.vstack([out, back])[: s.n_poses]
    beside = rng.integers(n, size=s.n_landmarks)
    away = rng.uniform(0.1, 1.0, s.n_landmarks) * s.landmark_half_width
    across = away * rng.choice([-1.0, 1.0], s.n_landmarks)
    left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
    landmarks = road[beside] + across[:, None] * left[beside]
    return measure(poses, landmarks, s, p, rng=rng, association_rng=association_rng)
