"""The picture of an estimate: its path and landmarks, and the truth where there is one."""

import numpy as np
from matplotlib.figure import Figure

from sngr_utils.show import style


def picture(
    poses: np.ndarray,
    landmarks: np.ndarray,
    reckoned: np.ndarray,
    truth: np.ndarray | None,
    doubts: list[str],
) -> Figure:
    """Path and landmarks, dead reckoning in grey behind them.

    Parameters
    ----------
    poses, reckoned : (T, 3), [m, m, rad]
    landmarks : (K, 2), [m]
    truth : (T, 2) true positions in the frame of the estimate, [m]; None where nobody knows
    doubts : printed above; nothing speaks against the estimate if there are none
    """
    style.use_style()
    fig, axes = style.figure(style.COLUMN_WIDTH, style.COLUMN_WIDTH)
    axes.plot(*reckoned[:, :2].T, color=style.PRINTED, label="dead reckoning")
    if truth is not None:
        axes.plot(*truth.T, color=style.TRUTH, label="truth, aligned")
    axes.plot(*poses[:, :2].T, color=style.ESTIMATE, label="estimate")
    axes.plot(*landmarks.T, "*", color=style.LANDMARK, markersize=8, label="landmarks")
    axes.set(xlabel="x in m", ylabel="y in m", aspect="equal")
    axes.set_title("\n".join(doubts) or "nothing speaks against it")
    axes.legend(loc="best")
    return fig
