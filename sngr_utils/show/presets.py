"""The presets of the open conventions: what they are, and printed tables beside all of them."""

from collections.abc import Callable, Mapping

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sngr_utils.publish import cells
from sngr_utils.show import style
from sngr_utils.show.common import draw_printed, legend_above
from sngr_utils.show.style import PRESET_COLOURS, PRESET_MARKERS, WRONG_LABEL
from sngr_utils.slam.conventions import PRESETS, WHY, OpenConventions

Levels = Mapping[float, Mapping[str, float | None]]  # level -> quantity -> number

FIELDS = {
    "x0_sigmas": "prior on the first pose: sigmas [m, m, rad]",
    "landmark_prior_sigma": "weak prior on a landmark: sigma [m]",
    "relinearize_threshold": "relinearised: variables that moved by more than",
    "relinearize_skip": "variables to relinearise: looked for at every n-th update, n",
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


def draw_beside_printed(
    ax: Axes, table: pd.DataFrame, quantity: str, ncols: int = 0, **looks
) -> None:
    """One quantity of a `beside_printed` table against its levels, a line for each column.

    Parameters
    ----------
    quantity : as the table names it
    ncols : columns of the legend; none if 0
    looks : as matplotlib's ``Axes.set`` takes them
    """
    names = table["", ""].replace("", np.nan).ffill()
    rows = table[(names == quantity).to_numpy()]
    levels = [float(level) for level in rows.iloc[:, 1]]
    for head in rows.columns[2:]:
        values = [np.nan if cell.numbers[0] is None else cell.numbers[0] for cell in rows[head]]
        if head[1] == "printed":
            draw_printed(ax, levels, values, line=True)
            continue
        colour, marker = PRESET_COLOURS[head[1]], PRESET_MARKERS[head[1]]
        ax.plot(levels, values, marker + "-", color=colour, mfc="none", ms=5, lw=0.8,
                label=f"preset {head[1]}")  # fmt: skip
    level = rows.columns[1][1]
    ax.set(xlabel=WRONG_LABEL if level == "p" else level, ylabel=quantity)
    ax.set(**looks)
    if ncols:
        legend_above(ax, ncols)


def panel(
    config: OpenConventions | None, draw: Callable[..., None], *args, height: float = 2.0, **looks
) -> Figure:
    """A panel as wide as half a column of the paper; a notebook hands it on and shows a wider one.

    Parameters
    ----------
    config : whose preset is named; None where none has a part
    draw : takes the axes, then `args` and `looks`
    height : [in]
    """
    fig, ax = style.figure(style.PANEL_WIDTH, height)
    draw(ax, *args, **looks)
    if config is not None:
        entitle(fig, config)
    plt.close(fig)
    return fig
