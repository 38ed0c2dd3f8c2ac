"""The presets of the open conventions: what they are, and printed tables beside all of them."""

from collections.abc import Mapping

import pandas as pd
from matplotlib.figure import Figure

from sngr_utils.publish import cells
from sngr_utils.slam.conventions import PRESETS, WHY, OpenConventions

Levels = Mapping[float, Mapping[str, float | None]]  # level -> quantity -> number

FIELDS = {
    "x0_sigmas": "prior on the first pose: sigmas [m, m, rad]",
    "landmark_prior_sigma": "weak prior on a landmark: sigma [m]",
    "relinearize_threshold": "relinearised: variables that moved by more than",
    "relinearize_skip": "looked for at every n-th update, n",
    "nees_frame": "frame of the covariance in the NEES",
}


def explained() -> pd.DataFrame:
    """What each preset of the open conventions sets, and why it is there."""
    rows = [
        [meaning, *(_setting(getattr(chosen, field)) for chosen in PRESETS.values())]
        for field, meaning in FIELDS.items()
    ]
    rows.append(["why it is there", *(WHY[name] for name in PRESETS)])
    return pd.DataFrame(rows, columns=["", *(f"preset {name}" for name in PRESETS)])


def _setting(value: float | str | list) -> str:
    if isinstance(value, list):
        return ", ".join(_setting(part) for part in value)
    return value if isinstance(value, str) else f"{value:g}"


def beside_printed(
    quantities: Mapping[str, tuple[str, str]],
    printed: Levels | None,
    ours: Mapping[str, Levels],
    over: str = "p",
) -> pd.DataFrame:
    """Printed numbers beside those under each preset, a row for each quantity and level.

    Parameters
    ----------
    quantities : key -> name and format; named in its first row only
    printed : the paper's numbers, where it has them; None if it has no such table
    ours : preset -> the numbers under it
    over : what a level is, as the heading of its column
    """
    rows = []
    for key, (name, fmt) in quantities.items():
        for i, level in enumerate(next(iter(ours.values()))):
            was = [] if printed is None else [printed.get(level, {}).get(key)]
            now = [levels[level].get(key) for levels in ours.values()]
            shown = [cells.number(value, fmt) for value in [*was, *now]]
            rows.append(["" if i else name, f"{level:g}", *shown])
    heads = [("", ""), ("", over), *([] if printed is None else [("", "printed")])]
    heads += [("preset", name) for name in ours]
    return pd.DataFrame(rows, columns=pd.MultiIndex.from_tuples(heads))


def entitle(fig: Figure, config: OpenConventions) -> None:
    """Write above a figure which preset it rests on, and whether fields of it were replaced."""
    changed = ", changed" if config.conventions else ""
    fig.suptitle(f"preset {config.preset}{changed}", fontsize=7)
