"""A graph in NSFG's format, through nested sampling: its modes, their masses and covariances."""

from dataclasses import replace

import numpy as np
import pytest

from sngr_utils.files import formats
from sngr_utils.sampling import graph_modes
from sngr_utils.sampling.targets import whole_graph

SIGMA, BEND = 0.3, 0.4  # m
TIGHT = " ".join(str(value) for value in (1e-6 * np.eye(3)).ravel())
PLACES = np.array([[0.0, 0.0], [2.0, BEND], [4.0, 0.0]])  # of three poses, all but on a line
LANDMARK = np.array([2.0, 3.0])


def write(path, ranges, extra=()):
    lines = [f"Variable Pose SE2 A{t} {x} {y} 0" for t, (x, y) in enumerate(PLACES)]
    lines += ["Variable Landmark R2 L0 2 3", f"Factor {PRIOR} A0 0 0 0 covariance {TIGHT}"]
    for t, (dx, dy) in enumerate(np.diff(PLACES, axis=0)):
        lines.append(f"Factor {STEP} A{t} A{t + 1} {dx} {dy} 0 covariance {TIGHT}")
    lines += [f"Factor {RANGE} A{t} L0 {r} {SIGMA}" for t, r in enumerate(ranges)]
    path.write_text("\n".join([*lines, *extra]) + "\n")
    return formats.read(path).log


PRIOR, STEP = "UnarySE2ApproximateGaussianPriorFactor", "SE2RelativeGaussianLikelihoodFactor"
RANGE = "SE2R2RangeGaussianLikelihoodFactor"


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    ranges = np.linalg.norm(LANDMARK - PLACES, axis=1)
    return write(tmp_path_factory.mktemp("graph") / "two.fg", ranges)


def by_grid(log):
    """Mass, mean and covariance of the landmark on each side of the way, all poses known."""
    side = np.linspace(-6, 6, 601)
    places = np.stack(np.meshgrid(2 + side, side), axis=-1).reshape(-1, 2)
    off = np.linalg.norm(places[:, None] - PLACES, axis=2) - log.ranges
    middle = PLACES.mean(axis=0)
    prior = -0.5 * np.sum((places - middle) ** 2, axis=1) / log.ranges.max() ** 2
    density = np.exp(prior - 0.5 * np.sum((off / SIGMA) ** 2, axis=1))
    found = []
    for mine in (places[:, 1] > BEND / 2, places[:, 1] <= BEND / 2):
        weights = density[mine] / density[mine].sum()
        mean = weights @ places[mine]
        centred = places[mine] - mean
        found.append((
            density[mine].sum() / density.sum(),
            mean,
            centred.T @ (weights[:, None] * centred),
        ))
    return found


def test_the_two_sides_of_a_landmark_have_their_masses_means_and_covariances(log):
    """Against a grid. A mass of .89 by 600 live points errs by .02 (six runs); asked is .06."""
    found = graph_modes.modes_of(log, rng=np.random.default_rng(100))
    assert len(found) == 2
    for mode, (mass, mean, covariance) in zip(found, by_grid(log), strict=True):
        assert mode.mass == pytest.approx(mass, abs=0.06)
        assert mode.landmarks[0] == pytest.approx(mean, abs=0.05)
        assert mode.landmark_covariances[0] == pytest.approx(covariance, rel=0.25, abs=0.01)
        assert mode.poses == pytest.approx(PLACES, abs=0.01)
    assert sum(mode.mass for mode in found) == pytest.approx(1.0)


def test_an_ambiguous_range_leaves_its_pose_two_places(tmp_path):
    """Two known landmarks, one range with weights 3 to 1, and hardly any odometry."""
    loose = " ".join(str(v) for v in np.diag([9.0, 1e-6, 1e-6]).ravel())
    text = [
        "Variable Pose SE2 A0 0 0 0", "Variable Pose SE2 A1 0 0 0",
        "Variable Landmark R2 L0 -10 0", "Variable Landmark R2 L1 10 0",
        f"Factor {PRIOR} A0 0 0 0 covariance {TIGHT}",
        f"Factor {STEP} A0 A1 0 0 0 covariance {loose}",
        f"Factor AmbiguousDataAssociationFactor Observer A1 Observed L0 L1 Weights .75 .25 "
        f"Binary {RANGE} Observation 8 Sigma .2",
    ]  # fmt: skip
    (tmp_path / "which.fg").write_text("\n".join(text) + "\n")
    known = formats.read(tmp_path / "which.fg")
    surveyed = replace(
        known.log, landmark_means=known.truth.landmarks, landmark_sigmas=np.full(2, 1e-3)
    )
    found = graph_modes.modes_of(surveyed, rng=np.random.default_rng(100))
    assert [mode.mass for mode in found] == pytest.approx([0.75, 0.25], abs=0.06)
    assert [mode.poses[1, 0] for mode in found] == pytest.approx([-2.0, 2.0], abs=0.1)


def test_what_cannot_be_sampled_is_refused(log):
    with pytest.raises(ValueError, match="no range"):
        graph_modes.modes_of(log.keep(np.zeros(3, bool)), rng=np.random.default_rng(0))
    with pytest.raises(ValueError, match="scale and offset"):
        whole_graph.of_log(replace(log, scale=(1.0, 0.1)))
    with pytest.raises(ValueError, match="label_probabilities of row 1 must sum"):
        whole_graph.of_log(replace(log, label_probabilities=[[1.0], [0.9], [1.0]]))
    longer = log.joined(log)
    for _ in range(3):
        longer = longer.joined(longer)
    with pytest.raises(ValueError, match="unknowns"):
        whole_graph.of_log(longer)
