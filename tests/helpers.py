"""What tests of several files use: small posteriors, a dense inverse, what has been compiled."""

import importlib
import math
import re
import runpy
import warnings
from dataclasses import replace
from itertools import permutations

import gtsam
import nbformat
import numpy as np

from sngr_utils import paths
from sngr_utils.publish import claims, files, links, parameters
from sngr_utils.sampling.targets import ambiguous_window, landmark
from sngr_utils.slam import conventions
from sngr_utils.world import simulation, variations
from sngr_utils.world.log import Log, LogWarning
from sngr_utils.world.scenario import Scenario

SIGMAS = conventions.PRESETS["C"].x0_sigmas
SIGMA = 0.1  # m, of a range
WEAK = Scenario(n_poses=3, odometry_sigma_xy=0.5, odometry_sigma_theta=0.1)


def read_notebook(name):
    """A committed notebook, as nbformat has it."""
    return nbformat.read(paths.NOTEBOOKS / f"{name}.ipynb", as_version=4)


def cells_from_scratch(name, **given):
    """What the cells of a notebook tagged "from-scratch" define, with NumPy and what is given."""
    names = {"np": np, "math": math, "permutations": permutations, **given}
    for cell in read_notebook(name).cells:
        if "from-scratch" in cell.metadata.get("tags", []):
            exec(cell.source, names)
    return names


def paper_text():
    """The paper and its supplement, without what stands before their first words."""
    texts = [(paths.ROOT / file).read_text(encoding="utf-8") for file in links.DOCUMENTS]
    return "\n".join(text.split(r"\begin{document}")[1] for text in texts)


FIRST_CHAPTER = ("cost", "sigma", "error")


def asked_keys():
    """What paper, first chapter, findings and claims, under any preset, ask of the notebooks."""
    needed = {key for preset in conventions.PRESETS for key in claims.needed(preset)}
    drives = [f"start.{drive}.{what}" for drive in ("right", "one_wrong") for what in FIRST_CHAPTER]
    needed |= {"start.upper_mass", *drives}  # tests/test_start_here.py holds sentences against them
    for path in (paths.ROOT / "tests" / "publish").glob("test_findings_*.py"):
        needed |= runpy.run_path(str(path)).get("ASKED", set())
    return needed | set(re.findall(r"\\res\{([^}]*)\}", paper_text()))


def drawn_as_printed(ax):
    """Every number of the paper that a panel marks: legend -> (x, y), and the legend has it."""
    marked = {line.get_label(): line for line in ax.lines if line.get_label().startswith("printed")}
    assert {(line.get_marker(), line.get_color()) for line in marked.values()} == {("s", "#999999")}
    assert marked.keys() <= {text.get_text() for text in ax.get_legend().get_texts()}
    return {name: tuple(map(list, line.get_data())) for name, line in marked.items()}


def handed_on(to):
    """What a report hands on, values and samples and wall clocks; nothing that nobody asks for."""
    to.save()
    found = {}
    for path in to.output_dir.glob(f"{to.notebook}*.json"):
        found |= files.entries(files.read_json(path))
    assert found.keys() <= asked_keys(), sorted(found.keys() - asked_keys())
    return found


def anchors(distance=4.0, measured=3.0, sigma=0.2):
    """Notebook 1: two known anchors, both `measured` metres from a landmark."""
    positions = np.array([[0.0, 0.0], [distance, 0.0]])
    return landmark.Landmark(
        positions, np.zeros((4, 4)), np.array([measured, measured]), sigma, positions.mean(axis=0),
        10.0,
    )  # fmt: skip


def quick_config(name):
    """The parameters with which a notebook is tried out."""
    values = parameters.read_params(name, paths.PARAMS / "quick")
    return parameters.config_of(name)(**values)


def a_world(seed=100):
    return simulation.simulate(Scenario(), 0.0, rng=np.random.default_rng(seed))


def window(n_ranges=1, seed=100, range_sigma=0.1, **changes):
    """Three poses, each with ranges that may belong to any of six landmarks."""
    rng = np.random.default_rng(seed)
    scenario = WEAK.model_copy(update={"range_sigma": range_sigma})
    the_world = variations.draw_x0(
        simulation.simulate(scenario, 0.4, rng=rng), [0.5, 0.5, 0.1], rng=rng
    )
    return replace(ambiguous_window.window_of(the_world, [0.5, 0.5, 0.1], 0.4, n_ranges), **changes)


def scans(label_of, pose_of=None, n_landmarks=3, ranges=None):
    """A log of which the ranges, their poses and their labels count."""
    labels = np.array(label_of)
    poses = np.zeros(len(labels), dtype=int) if pose_of is None else np.array(pose_of)
    measured = np.full(len(labels), 5.0) if ranges is None else np.array(ranges)
    n_poses = poses.max() + 1
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LogWarning)
        return Log(
            odometry=np.zeros((n_poses - 1, 3)), odometry_covariances=np.eye(3), pose_of=poses,
            ranges=measured, range_sigmas=SIGMA, label_of=labels, n_landmarks=n_landmarks,
            x0_mean=np.zeros(3), x0_sigmas=SIGMAS,
        )  # fmt: skip


def dense_covariance(solution):
    """Inverse of the dense information matrix at the estimate, and the slice of each key."""
    ordering = gtsam.Ordering()
    keys = list(solution.estimate.keys())
    for key in keys:
        ordering.push_back(key)
    a, _ = solution.graph.linearize(solution.estimate).jacobian(ordering)
    sizes = [3 if gtsam.Symbol(key).chr() == ord("x") else 2 for key in keys]
    ends = np.cumsum(sizes)
    slices = {k: slice(e - n, e) for k, e, n in zip(keys, ends, sizes, strict=True)}
    return np.linalg.inv(a.T @ a), slices


def signatures():
    """Types that each compiled function has been compiled for, by name."""
    found = {}
    for path in paths.PACKAGE.rglob("*.py"):
        module = ".".join(path.relative_to(paths.ROOT).with_suffix("").parts)
        for name in re.findall(r"^@compile_once\ndef (\w+)", path.read_text(), flags=re.M):
            compiled = getattr(importlib.import_module(module), name)
            found[f"{module}.{name}"] = list(compiled.signatures)
    return found
