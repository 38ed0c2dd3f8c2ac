"""One look for all figures: colours with one meaning each, IEEE column widths, fonts."""

import matplotlib as mpl
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

COLUMN_WIDTH = 3.5  # in, one IEEE column
PANEL_WIDTH = 1.72  # in, half a column: two panels side by side

# Okabe & Ito's colour-blind safe palette, one meaning each
TRUTH = "#000000"
ESTIMATE = "#0072B2"  # iSAM2
TRIGGERED = "#D55E00"  # windows that fire, and the threshold
SAMPLES = "#009E73"  # nested sampling
PRINTED = "#999999"  # the paper's printed values
PRIOR = "#CC79A7"
LANDMARK = "#E69F00"
SEQUENCE = ["#56B4E9", SAMPLES, LANDMARK, TRIGGERED, PRIOR, PRINTED]  # where none of these is meant

RC = {
    "font.family": "STIXGeneral",
    "mathtext.fontset": "stix",
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "legend.fontsize": 7,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "axes.linewidth": 0.6,
    "lines.linewidth": 1.0,
    "lines.markersize": 3,
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
    "figure.dpi": 150,
    "pdf.fonttype": 42,
}


def use_style() -> None:
    """Set the project's look for all figures drawn from here on."""
    mpl.rcdefaults()
    mpl.rcParams.update(RC)


def figure(width: float = COLUMN_WIDTH, height: float = 2.4) -> tuple[Figure, Axes]:
    """One figure with one axes, width and height in inches."""
    return plt.subplots(figsize=(width, height))


def panels(width: float, height: float, n: int) -> tuple[Figure, list[Axes]]:
    """One figure with n axes side by side, width and height in inches."""
    fig, axes = plt.subplots(1, n, figsize=(width, height))
    return fig, list(axes)


def stack(width: float, height: float, n: int) -> tuple[Figure, list[Axes]]:
    """One figure with n axes above each other that share x, width and height in inches."""
    fig, axes = plt.subplots(n, 1, figsize=(width, height), sharex=True)
    return fig, list(axes)


# Where a landmark is, and where an estimate has it, of `Axes.plot`
TRUE_LANDMARK = {"ls": "none", "marker": "+", "ms": 6, "color": TRUTH}
FOUND_LANDMARK = {"ls": "none", "marker": "*", "ms": 6, "color": LANDMARK}

PRESET_COLOURS = {"A": LANDMARK, "B": ESTIMATE, "C": SAMPLES}

PRESET_MARKERS = {"A": "^", "B": "o", "C": "s"}

WRONG_LABEL = "share p of wrong labels"
