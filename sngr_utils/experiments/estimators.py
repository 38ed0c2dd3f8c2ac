"""All peers behind one call, on identical data: the method is a name, the start another.

Every method is given the same odometry and ranges, the noise levels, and the mean of the x0
prior. None is given the truth; the oracle alone is given which landmark each range came from.
Just over 300 lines: a case for each method.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pandas as pd

from sngr_utils.experiments.many_worlds import map_rows
from sngr_utils.metrics import rmse_and_nees, summaries
from sngr_utils.robust import em, fastslam, losses, max_mixtures, switchable_constraints
from sngr_utils.sampling import engines
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.slam import chain_solver, isam2, landmark_starts, marginals, selected_inverse
from sngr_utils.slam.conventions import Conventions
from sngr_utils.sngr import algorithm, gate, refine, trigger
from sngr_utils.world import dead_reckoning, simulation
from sngr_utils.world.log import Log
from sngr_utils.world.scenario import Scenario

STARTS = landmark_starts.STARTS
METHODS = (
    "dead_reckoning", "isam2", "sngr", "least_squares", "huber", "cauchy", "dcs", "geman_mcclure",
    "gnc_tls", "gnc_gm", "switchable", "max_mixture_null", "max_mixture_all", "fastslam", "em",
    "em_exclusive", "oracle",
)  # fmt: skip
WITHOUT_START = ("dead_reckoning", "isam2", "sngr", "fastslam")  # they need none of ours
BATCH = "em_exclusive"  # the same posterior over associations as ours, not online
REFERENCE_START = "grid"  # of the oracle that ratios are to
TAU = 3.9  # of SNGR, as in the paper's comparison of trajectories
PARTICLES = fastslam.Settings()
LOST = 1.5  # times the oracle's RMSE, above which a run counts as lost
STREAM = 70  # of a method's own random numbers, beside the seed of the world


@dataclass(frozen=True)
class Estimate:
    """What a method says about a world.

    Attributes
    ----------
    poses : (T, 3), [m, m, rad]
    landmarks : (K, 2), [m]; NaN where a method has none
    position_covariances : (T, 2, 2) in the world frame, [m^2]. Robust losses and GNC: inverse
        of the reweighted Gauss-Newton information; mixtures: of the chosen components; switches
        integrated out; EM: Louis' (`association`); FastSLAM: the spread of the histories
    """

    poses: np.ndarray
    landmarks: np.ndarray
    position_covariances: np.ndarray


def estimate(
    the_world: simulation.World,
    conventions: Conventions,
    method: str,
    start: str,
    particles: fastslam.Settings = PARTICLES,
    *,
    rng: np.random.Generator,
) -> Estimate:
    """What `method` makes of a world.

    Parameters
    ----------
    method : one of `METHODS`
    start : one of `STARTS`, where the landmarks start and their weak priors are centred; those
        in `WITHOUT_START` take no notice of it
    particles : settings of FastSLAM
    rng : for SNGR and FastSLAM; the others draw nothing

    Raises
    ------
    ValueError : unknown method or start
    """
    _require_known([method], [start])
    ((_, _, given, begin),) = _pairs(the_world, conventions, [method], [start])
    return _from(given, conventions, method, begin, particles, rng)


def _require_known(methods: Sequence[str], starts: Sequence[str]) -> None:
    for name, given, known in (("method", methods, METHODS), ("start", starts, STARTS)):
        for value in given:
            if value not in known:
                raise ValueError(f"{name} is {value!r}: it must be one of {sorted(known)}")


def _from(
    the_world: simulation.World,
    conventions: Conventions,
    method: str,
    start: losses.Estimate,
    particles: fastslam.Settings,
    rng: np.random.Generator,
) -> Estimate:
    """The estimate of `method` from poses and landmarks to start from."""
    if method == "fastslam":
        found = fastslam.run(the_world, conventions, particles, rng=rng)
        covariances = found.position_covariances(conventions.x0_sigmas)
        return Estimate(found.poses, found.mean_landmarks, covariances)
    if method == "sngr":
        return _sngr(the_world, conventions, rng)
    if method == "isam2":
        solution = isam2.run_isam2(the_world, conventions)
        covariances = marginals.position_covariances(solution, "world")
        return Estimate(solution.poses, solution.landmarks, covariances)
    found = batch(the_world.log(conventions.x0_sigmas), conventions, method, start)
    return Estimate(found.poses, found.landmarks, found.position_covariances)


def batch(
    log: Log, conventions: Conventions, method: str, start: losses.Estimate, clutter: bool = False
) -> em.SoftEstimate | chain_solver.Estimate:
    """What a method that takes all data at once makes of a log; EM may admit clutter."""
    if method in ("em", "em_exclusive"):
        exclusive = method == "em_exclusive"
        return em.fit(log, conventions, start, exclusive=exclusive, clutter=clutter)
    if method == "switchable":
        return switchable_constraints.solve(log, conventions, start)[0]
    if method.startswith("max_mixture_"):
        return max_mixtures.solve(log, conventions, start, method.removeprefix("max_mixture_"))
    # without a landmark, least squares is dead reckoning
    loss = "least_squares" if method in ("dead_reckoning", "oracle") else method
    return losses.solve(log, conventions, loss, start)


def _sngr(
    the_world: simulation.World, conventions: Conventions, rng: np.random.Generator
) -> Estimate:
    """The paper's Algorithm 1. Its windows are nearly Gaussian: the fast path samples them.

    It hands those on to nested sampling that it cannot be trusted with (`engines`).
    """
    refined = algorithm.run(
        the_world, conventions, partial(trigger.triggers, tau=TAU),
        refine.Paper(SamplerSettings(min_walks=engines.ENOUGH_WALKS), "fast"), gate.Gate(),
        marginals=partial(
            selected_inverse.window_covariances, world=the_world, conventions=conventions
        ), rng=rng,
    )  # fmt: skip
    covariances = marginals.position_covariances(refined.solution, "world")
    return Estimate(refined.poses, refined.solution.landmarks, covariances)


def expected_nees(
    the_world: simulation.World, conventions: Conventions, poses: np.ndarray, covariances
) -> float:
    """NEES of positions, expected over a drawn mean of the x0 prior; 2 if consistent.

    The paper's prior is centred on the truth. Were its mean drawn from its own law, odometry
    and ranges would look the same and the whole estimate would move rigidly with it, by J d in a
    position. So no run needs repeating: E (e + J d)^T P^-1 (e + J d) = e^T P^-1 e + tr(P^-1 J
    Sigma_0 J^T), to first order in the heading.

    Parameters
    ----------
    the_world : whose x0 prior is centred on the truth
    poses : (T, 3) estimated, [m, m, rad]
    covariances : (T, 2, 2) of the positions in the world frame, [m^2]
    """
    errors = poses[:, :2] - the_world.poses[:, :2]
    moved = dead_reckoning.rigid_covariances(poses, conventions.x0_sigmas)
    traces = np.trace(np.linalg.solve(covariances, moved), axis1=1, axis2=2)
    return rmse_and_nees.nees(errors, covariances) + float(traces.mean())


def compare(
    scenario: Scenario,
    conventions: Conventions,
    p_levels: Sequence[float],
    seeds: Sequence[int],
    methods: Sequence[str] = METHODS,
    starts: Sequence[str] = (REFERENCE_START,),
    particles: fastslam.Settings = PARTICLES,
    jobs: int | None = None,
) -> pd.DataFrame:
    """Every method from every start on the same worlds.

    Returns
    -------
    one row per p, seed, method and start ("none" for those in `WITHOUT_START`): pose_rmse and
    landmark_rmse [m], nees (`expected_nees`), seconds of CPU, without the start, which is shared

    Raises
    ------
    ValueError : unknown method or start
    """
    _require_known(methods, starts)
    cases = [
        (scenario, conventions, p, seed, methods, starts, particles)
        for p in p_levels
        for seed in seeds
    ]
    rows = map_rows(_compare_one, cases, jobs)
    columns = ["method", "start", "p", "seed", "pose_rmse", "landmark_rmse", "nees", "seconds"]
    return pd.DataFrame(rows, columns=columns)


def _compare_one(
    scenario: Scenario,
    conventions: Conventions,
    p: float,
    seed: int,
    methods: Sequence[str],
    starts: Sequence[str],
    particles: fastslam.Settings,
) -> list[tuple]:
    the_world = simulation.simulate(scenario, p, rng=np.random.default_rng(seed))
    rows = []
    for method, start, given, begin in _pairs(the_world, conventions, methods, starts):
        rng = np.random.default_rng([seed, STREAM])
        before = time.thread_time()
        found = _from(given, conventions, method, begin, particles, rng)
        seconds = time.thread_time() - before
        pose_rmse = rmse_and_nees.rmse(found.poses[:, :2], the_world.poses[:, :2])
        landmark_rmse = rmse_and_nees.rmse(found.landmarks, the_world.landmarks)
        nees = expected_nees(the_world, conventions, found.poses, found.position_covariances)
        rows.append((method, start, p, seed, pose_rmse, landmark_rmse, nees, seconds))
    return rows


def _pairs(
    the_world: simulation.World,
    conventions: Conventions,
    methods: Sequence[str],
    starts: Sequence[str],
) -> Iterator[tuple[str, str, simulation.World, losses.Estimate]]:
    """Method, start, the world it is given, and where it begins; each start computed once."""
    poses = dead_reckoning.dead_reckoning(the_world.x0_mean, the_world.odometry)
    nowhere = np.full((the_world.n_landmarks, 2), np.nan)
    log = the_world.log(conventions.x0_sigmas)
    for method in methods:
        if method in WITHOUT_START:
            yield method, "none", the_world, (poses, nowhere)
    for start in starts:
        landmarks = landmark_starts.start_landmarks(log, poses, start)
        for method in methods:
            if method == "oracle":
                true = replace(the_world, label_of=the_world.source_of)
                own = landmark_starts.start_landmarks(true.log(conventions.x0_sigmas), poses, start)
                yield method, start, true, (poses, own)
            elif method not in WITHOUT_START:
                yield method, start, the_world, (poses, landmarks)


def relative_to_oracle(runs: pd.DataFrame) -> pd.DataFrame:
    """`runs` with errors over the oracle's from `REFERENCE_START` on the same world.

    Returns
    -------
    with the columns ratio and landmark_ratio, of pose_rmse and landmark_rmse, and oracle_rmse,
    the oracle's pose RMSE, [m]

    Raises
    ------
    ValueError : the oracle from there is missing in some world
    """
    oracle = runs[(runs["method"] == "oracle") & (runs["start"] == REFERENCE_START)]
    best = oracle.set_index(["p", "seed"])[["pose_rmse", "landmark_rmse"]]
    joined = runs.join(best.add_prefix("oracle_"), on=["p", "seed"])
    if joined["oracle_pose_rmse"].isna().any():
        raise ValueError(f"runs lack the oracle from start {REFERENCE_START!r} in some world")
    return joined.assign(
        ratio=joined["pose_rmse"] / joined["oracle_pose_rmse"],
        landmark_ratio=joined["landmark_rmse"] / joined.pop("oracle_landmark_rmse"),
    ).rename(columns={"oracle_pose_rmse": "oracle_rmse"})


def paired(runs: pd.DataFrame, a: str, b: str) -> pd.DataFrame:
    """Pose RMSE of method `a` less that of `b` on the same worlds, at each p.

    The differences are skewed, a few worlds having most of the change, so that no mean decides.

    Returns
    -------
    one row per p: p and the columns of `summaries.medians` for the differences, then less, more
    (worlds in which `a` is better, or worse) and p_value, see `summaries.sign_test`

    Raises
    ------
    ValueError : they share no world
    """
    chosen = runs[runs["start"].isin([REFERENCE_START, "none"])].set_index(["p", "seed"])
    sides = [chosen.loc[chosen["method"] == method, "pose_rmse"] for method in (a, b)]
    both = pd.concat(sides, axis=1, join="inner", keys=["a", "b"])
    if both.empty:
        raise ValueError(f"methods {a!r} and {b!r} have no p and seed in common")
    apart = (both["a"] - both["b"]).rename("difference").reset_index()
    by_p = apart.groupby("p", sort=False)["difference"]
    signs = zip(*(summaries.sign_test(each.to_numpy()) for _, each in by_p), strict=True)
    table = summaries.medians(apart, "difference", by=["p"])
    return table.assign(**dict(zip(("less", "more", "p_value"), signs, strict=True)))
