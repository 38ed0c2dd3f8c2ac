"""Whatever a log may be, a file of it says the same again, or the field that it cannot say."""

import string
from dataclasses import fields

import numpy as np
import pytest

from sngr_utils.files import formats, pyfg, table_writer
from sngr_utils.files.recording import Recording
from sngr_utils.world.log import NO_LABEL, Log
from sngr_utils.world.truth import Truth

LETTERS = string.printable.strip() + " äß漢,;\"'#:"
pytestmark = pytest.mark.filterwarnings("ignore::sngr_utils.world.log.LogWarning")


def sizes(rng, shape, least=-20, most=20):
    """Numbers of all sizes and both signs."""
    return rng.choice([-1, 1], shape) * 10 ** rng.uniform(least, most, shape)


def covariances(rng, n):
    sigmas = np.abs(sizes(rng, (n, 3)))
    roots = rng.normal(size=(n, 3, 3)) * (rng.random((n, 1, 1)) < 0.7) + np.eye(3)
    products = roots @ roots.swapaxes(1, 2)
    scale = np.sqrt(np.diagonal(products, axis1=1, axis2=2))
    return products / (scale[:, :, None] * scale[:, None]) * sigmas[:, :, None] * sigmas[:, None]


def random_log(rng, **changed):
    """A log anywhere within what a log may be: no poses' motion, no landmark, any size."""
    steps, k = rng.integers(5), rng.integers(5)
    m = rng.integers(6) if k else 0
    sigmas = np.abs(sizes(rng, m))
    ranges = np.abs(sizes(rng, m))
    below = rng.random(m) < 0.3
    ranges[below] = -rng.uniform(1e-3, 5, below.sum()) * np.minimum(sigmas[below], 1e19)
    surveyed = rng.random(k) < 0.5
    return Log(**{
        "odometry": sizes(rng, (steps, 3)), "odometry_covariances": covariances(rng, steps),
        "pose_of": rng.integers(steps + 1, size=m), "ranges": ranges, "range_sigmas": sigmas,
        "label_of": rng.integers(k, size=m) if k else [], "n_landmarks": int(k),
        "x0_mean": sizes(rng, 3), "x0_sigmas": np.abs(sizes(rng, 3)),
        "times": np.sort(sizes(rng, steps + 1)),
        "landmark_means": np.where(surveyed[:, None], sizes(rng, (k, 2)), np.nan),
        "landmark_sigmas": np.where(surveyed, np.abs(sizes(rng, k)), np.nan),
        **changed,
    })  # fmt: skip


def with_more(rng):
    """A random log with what tables alone can say."""
    plain = random_log(rng)
    m, k = len(plain.ranges), plain.n_landmarks
    given = {field.name: getattr(plain, field.name) for field in fields(Log)}
    given["label_of"] = np.where(rng.random(m) < 0.5, NO_LABEL, plain.label_of)
    if k and rng.random() < 0.5:
        given["label_probabilities"] = rng.dirichlet(np.ones(k + 1), m)[:, :k]
    sigma = [0.0, np.inf, np.abs(sizes(rng, ()))]
    given["scale"] = (np.abs(sizes(rng, ())), sigma[rng.integers(3)])
    given["offset"] = (sizes(rng, ()), sigma[rng.integers(3)])
    return Log(**given)


def names_of(rng, k):
    drawn = {"".join(rng.choice(list(LETTERS), 6)).strip() or "x" for _ in range(3 * k)}
    return sorted(drawn)[:k]


def assert_same(found: Log, log: Log, rtol: float = 0.0) -> None:
    """In all but the rows, which are those of the file now."""
    for field in fields(Log):
        x, y = getattr(found, field.name), getattr(log, field.name)
        if field.name == "row_of" or (x is None and y is None):
            continue
        rounded = field.name in ("odometry_covariances", "label_probabilities")
        np.testing.assert_allclose(x, y, rtol=rtol if rounded else 0.0, atol=0, err_msg=field.name)


@pytest.mark.parametrize("seed", range(100, 180))
def test_any_log_comes_back_from_tables(tmp_path, seed):
    rng = np.random.default_rng(seed)
    log = with_more(rng)
    m, k = len(log.ranges), log.n_landmarks
    truth = Truth(
        poses=sizes(rng, (log.n_poses, 3)) if rng.random() < 0.5 else None,
        landmarks=np.where(rng.random((k, 1)) < 0.5, np.nan, sizes(rng, (k, 2))),
        source_of=rng.integers(-1, k, size=m),
    )
    given = Recording(log, truth, names_of(rng, k))
    table_writer.write(tmp_path / "new", given)
    found = formats.read(tmp_path / "new")
    assert found.landmark_names == given.landmark_names
    assert_same(found.log, log, rtol=1e-14)  # sigmas and correlations say a covariance
    for name in ("poses", "landmarks", "source_of"):
        np.testing.assert_array_equal(getattr(found.truth, name), getattr(truth, name))


@pytest.mark.parametrize("seed", range(200, 260))
def test_a_log_comes_back_from_pyfg_to_the_last_bit_or_its_field_is_named(tmp_path, seed):
    rng = np.random.default_rng(seed)
    log, path = random_log(rng), tmp_path / "a.pyfg"
    places = sizes(rng, (log.n_poses, 3)), sizes(rng, (log.n_landmarks, 2))
    pyfg.write(path, log, *places)
    assert_same(formats.read(path).log, log)
    richer = with_more(rng)
    places = sizes(rng, (richer.n_poses, 3)), sizes(rng, (richer.n_landmarks, 2))
    with pytest.raises(ValueError, match=r"b\.pyfg: (label_of|label_prob\w+|scale|offset): "):
        pyfg.write(tmp_path / "b.pyfg", richer, *places)
    assert not (tmp_path / "b.pyfg").exists()


def fg_of(log: Log) -> str:
    """The lines of a log as NSFG writes them."""
    text = [f"Variable Pose SE2 X{t} 0 0 0" for t in range(log.n_poses)]
    text += [f"Variable Landmark R2 L{k} {k} 0" for k in range(log.n_landmarks)]
    factors = [
        ("UnarySE2ApproximateGaussianPriorFactor X0", log.x0_mean, np.diag(log.x0_sigmas**2))
    ]
    factors += [
        (f"SE2RelativeGaussianLikelihoodFactor X{t} X{t + 1}", motion, log.odometry_covariances[t])
        for t, motion in enumerate(log.odometry)
    ]
    for names, mean, covariance in factors:
        numbers = (" ".join(map(repr, map(float, np.ravel(part)))) for part in (mean, covariance))
        text.append(f"Factor {names} {' covariance '.join(numbers)}")
    kind = "SE2R2RangeGaussianLikelihoodFactor"
    for m, t in enumerate(log.pose_of):
        value, sigma = float(log.ranges[m]), float(log.range_sigmas[m])
        if log.label_of[m] != NO_LABEL:
            text.append(f"Factor {kind} X{t} L{log.label_of[m]} {value!r} {sigma!r}")
            continue
        weights = log.label_probabilities[m]
        text.append(
            f"Factor AmbiguousDataAssociationFactor Observer X{t} Observed "
            f"{' '.join(f'L{k}' for k in range(len(weights)))} Weights "
            f"{' '.join(repr(float(w)) for w in weights)} Binary {kind} "
            f"Observation {value!r} Sigma {sigma!r}"
        )
    return "\n".join(text) + "\n"


@pytest.mark.parametrize("seed", range(300, 340))
def test_a_log_comes_back_from_fg(tmp_path, seed):
    rng = np.random.default_rng(seed)
    log = random_log(rng, times=None, landmark_means=None, landmark_sigmas=None)
    m, k = len(log.ranges), log.n_landmarks
    if seed % 2 and m:
        label_of = np.where(rng.random(m) < 0.5, NO_LABEL, log.label_of)
        chances = np.eye(k)[label_of]
        chances[label_of == NO_LABEL] = rng.dirichlet(np.full(k, 0.5), m)[label_of == NO_LABEL]
        given = {field.name: getattr(log, field.name) for field in fields(Log)}
        if NO_LABEL in label_of and k > 1:
            log = Log(**{**given, "label_of": label_of, "label_probabilities": chances})
    path = tmp_path / "a.fg"
    path.write_text(fg_of(log))
    assert_same(formats.read(path).log, log, rtol=1e-15)
