"""What ``python -m sngr_utils estimate FILE`` does: a log from a file, a map into files."""

import os
import re
import sys
import tempfile
import warnings
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from threading import Thread

import numpy as np
from pydantic import ValidationError
from tqdm import tqdm

from sngr_utils.files import formats, plaza, tum
from sngr_utils.files.recording import Recording, named
from sngr_utils.metrics.alignment import aligned_rmse, rigid
from sngr_utils.online import calibration, rivals
from sngr_utils.robust import growing_map, naming
from sngr_utils.robust.growing_map import GrownMap
from sngr_utils.slam.noise_estimation import RANGE, SOURCES
from sngr_utils.world.dead_reckoning import dead_reckoning
from sngr_utils.world.log import NO_LABEL, LogWarning


def run(path: Path, out: Path | None, overwrite: bool) -> None:
    """Estimate the log of a file; print a summary, write a trajectory and a picture.

    Parameters
    ----------
    path : of a file or a folder that `formats.read` can read, or the name of a Plaza set
    out : folder of what is written, made if need be; None for beside the input
    overwrite : whether files that are there may be replaced

    Raises
    ------
    ValueError : one line that says what is wrong, before any long work where it can be known
    """
    with warnings.catch_warnings(record=True) as odd:
        warnings.simplefilter("always", LogWarning)
        recording = _printable(formats.read(_of_wheel(path)))
    if len(recording.log.ranges) and not recording.log.ranges.max() > 0:
        raise ValueError(f"{path}: no range is above zero")
    for text in dict.fromkeys(str(warning.message) for warning in odd):
        print(f"warning: {_in_names(text, recording)}", file=sys.stderr)
    places = _places(path, out, overwrite)
    try:  # written aside, for what is there is replaced whole or not at all
        with tempfile.TemporaryDirectory(prefix=".estimate", dir=places[0].parent) as aside:
            trajectory, image = (Path(aside, place.name) for place in places)
            grown = _estimate(path, recording)
            tum.write(trajectory, recording.log.times, grown.soft.poses)
            _draw(image, recording, grown)
            for place in places:
                os.replace(Path(aside, place.name), place)
    except OSError as error:
        raise ValueError(f"{places[0].parent}: {error.strerror or error}") from None
    print("\n".join([*summary(recording, grown), *(f"written: {place}" for place in places)]))


def _of_wheel(path: Path) -> Path:
    """Where the file is: a set of the wheel may be given by its name, if no file has it."""
    return plaza.wheel(path.name) if str(path) in plaza.SETS and not path.exists() else path


def _printable(recording: Recording) -> Recording:
    """The same with names that cannot command a terminal."""
    names = [name if name.isprintable() else repr(name)[1:-1] for name in recording.landmark_names]
    return replace(recording, landmark_names=names)


def _estimate(path: Path, recording: Recording) -> GrownMap:
    """The work, in a thread: Ctrl-C while numba hands on a named tuple would crash the process."""
    found = Future()

    def progress(share: float) -> None:
        bar.update(share - bar.n)

    def work():
        try:
            found.set_result(growing_map.estimate(recording.log, progress))
        except BaseException as error:
            found.set_exception(error)

    bar = tqdm(total=1.0, bar_format="{percentage:3.0f} %|{bar}|", ncols=50, nrows=20, disable=None)
    with warnings.catch_warnings(), named(path), bar:
        warnings.simplefilter("ignore", LogWarning)  # said when the log was read
        Thread(target=work, daemon=True).start()
        try:
            return found.result()
        except (np.linalg.LinAlgError, ValidationError):
            raise ValueError("its numbers are too large or too small beside each other") from None


def _in_names(text: str, recording: Recording) -> str:
    """What is said of "landmarks [0, 2]" said of those that the file calls so."""
    names = recording.landmark_names
    return re.sub(
        r"landmarks \[([\d, ]+)\]",
        lambda found: "landmarks " + ", ".join(names[int(k)] for k in found[1].split(", ")),
        text,
    )


def summary(recording: Recording, grown: GrownMap) -> list[str]:
    """Lines on what was found, and on whether it can be trusted."""
    log, soft, noise = recording.log, grown.soft, grown.noise
    corrected = calibration.of(noise.log).after(soft.calibration).corrected(noise.log)
    needless = rivals.dispensable(corrected, soft) & (log.n_landmarks > 1)
    parts = (log.n_poses, "pose"), (len(log.ranges), "range"), (log.n_landmarks, "landmark")
    lines = [", ".join(f"{n} {what}{'s' * (n != 1)}" for n, what in parts)]
    covariance = noise.estimate.covariance.landmarks
    for k, name in enumerate(recording.landmark_names):
        sigma = np.sqrt(np.trace(covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2]) / 2)
        x, y = soft.landmarks[k]
        place = f"at {x:.2f}, {y:.2f} m, +- {sigma:.2f} m" if np.isfinite(x) else "is not found"
        hardly = ", or nowhere: other landmarks explain its ranges as well" * bool(needless[k])
        lines.append(f"landmark {name} {place}{hardly}")
    if log.n_landmarks > 1 and not naming.have_labels(log) and not log.surveyed.all():
        lines.append("no range says which landmark it is from: which name is whose is arbitrary")
    for name, value, sigma in _calibration(grown):
        lines.append(f"{name} {value:.4f} +- {sigma:.4f}")
    errors = noise.errors
    found = float(np.median(noise.log.range_sigmas))
    lines.append(f"range sigma {found:.3g} m +- {errors[RANGE]:.0%}")
    for name, unit in SOURCES.items():
        if noise.sigmas[name]:
            told = f"odometry, {name}: {noise.sigmas[name]:.2g} {unit}"
            known = errors[name] < 1
            lines.append(f"{told} +- {errors[name]:.0%}" if known else f"{told}, hardly determined")
    if np.any(log.label_of != NO_LABEL) and log.label_probabilities is None:
        lines.append(f"{soft.shares.wrong:.1%} of the labels are wrong")
    lines.append(
        f"{soft.shares.clutter:.1%} of the ranges are from no landmark; "
        f"of every tenth, foretold from the others, {grown.unexplained:.1%} fit none"
    )
    truth = recording.truth
    if truth is not None and truth.poses is not None:
        rmse = aligned_rmse(soft.poses[:, :2], truth.poses[:, :2])
        lines.append(f"aligned RMSE against the truth {rmse:.3f} m")
    doubts, open_names = [*grown.doubts], naming.exchanged(corrected, soft)
    if open_names.any():
        doubts.append(f"labels exchange landmarks {np.flatnonzero(open_names).tolist()} for a time")
    lines += [f"IT MAY BE WRONG: {_in_names(doubt, recording)}" for doubt in doubts]
    return lines + ["nothing speaks against it"] * (not doubts and not needless.any())


def _calibration(grown: GrownMap) -> list[tuple[str, float, float]]:
    """Range scale and offset as far as they are estimated, with their sigmas."""
    estimated = np.flatnonzero(grown.soft.chain.columns >= 0)
    names = ("range scale", "range offset [m]")
    return [
        (names[i], grown.soft.calibration[i], sigma)
        for i, sigma in zip(estimated, grown.calibration_sigmas, strict=True)
    ]


def _places(path: Path, out: Path | None, overwrite: bool) -> tuple[Path, Path]:
    """Where trajectory and picture go."""
    name = "estimate" if path.is_dir() else f"{path.stem}_estimate"
    folder = out or (path if path.is_dir() else path.parent)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:  # a zero byte is a ValueError
        raise ValueError(f"{folder}: {getattr(error, 'strerror', error)}") from None
    found = folder / f"{name}.tum", folder / f"{name}.png"
    for there in found:
        if there.is_dir():
            raise ValueError(f"{there} is a folder: --out DIR writes elsewhere")
        if os.path.lexists(there) and not overwrite:
            raise ValueError(
                f"{there} is there already: --overwrite replaces it, --out DIR writes elsewhere"
            )
    return found


def _draw(path: Path, recording: Recording, grown: GrownMap) -> None:
    import matplotlib.pyplot as plt

    from sngr_utils.show import grown_map

    log, soft, truth = recording.log, grown.soft, recording.truth
    true = None
    if truth is not None and truth.poses is not None:
        rotation, shift = rigid(truth.poses[:, :2], soft.poses[:, :2])
        true = truth.poses[:, :2] @ rotation.T + shift
    reckoned = dead_reckoning(log.x0_mean, log.odometry)
    fig = grown_map.picture(soft.poses, soft.landmarks, reckoned, true, grown.doubts)
    fig.savefig(path)
    plt.close(fig)
