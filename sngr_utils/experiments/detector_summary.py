"""The windows of `detector_scores` summed up: ranking, decisions, false positives.

Each summary goes group by group of worlds of one kind (scenario and case) and detector by
detector; every interval draws whole worlds.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from sngr_utils.metrics import cluster_bootstrap

GROUPS = ["scenario", "case"]


def ranking(
    rows: pd.DataFrame, names: Sequence[str], truth: str, *, rng: np.random.Generator
) -> pd.DataFrame:
    """How well scores rank windows, whatever the threshold.

    Parameters
    ----------
    names : columns of scores
    truth : "failed" or "contaminated"

    Returns
    -------
    one row per group and score: auc and precision (area under the precision-recall curve) of
    all windows pooled, within (AUC from pairs of the same world), each with _low and _high;
    base_rate, worlds
    """
    found = []
    for keys, group in rows.groupby(GROUPS, sort=False):
        true, worlds = group[truth].to_numpy(), group["seed"].to_numpy()
        for name in names:
            score = group[name].to_numpy()
            within, _ = cluster_bootstrap.within_auc(score, true, worlds, rng=rng)
            found.append({
                **dict(zip(GROUPS, keys, strict=True)), "detector": name, "truth": truth,
                **_columns("auc", cluster_bootstrap.roc_auc(score, true, worlds, rng=rng)),
                **_columns(
                    "precision", cluster_bootstrap.average_precision(score, true, worlds, rng=rng)
                ),
                **_columns("within", within),
                "base_rate": true.mean(), "worlds": len(np.unique(worlds)),
            })  # fmt: skip
    return pd.DataFrame(found)


def decisions(
    rows: pd.DataFrame, thresholds: Mapping[str, float], truth: str, *, rng: np.random.Generator
) -> pd.DataFrame:
    """How well firing above a threshold decides.

    Parameters
    ----------
    thresholds : by column of scores
    truth : "failed" or "contaminated"

    Returns
    -------
    one row per group and score: fired (share), precision, recall, false_alarms (share of the
    windows without `truth` that fire), mcc, each with _low and _high; base_rate, worlds,
    silent (share of the worlds in which nothing fires)
    """
    found = []
    for keys, group in rows.groupby(GROUPS, sort=False):
        true, worlds = group[truth].to_numpy(), group["seed"].to_numpy()
        everything = np.ones(len(group), dtype=bool)
        for name, threshold in thresholds.items():
            fired = group[name].to_numpy() > threshold
            shares = {
                "fired": (fired, everything), "precision": (true, fired), "recall": (fired, true),
                "false_alarms": (fired, ~true),
            }  # fmt: skip
            row = {**dict(zip(GROUPS, keys, strict=True)), "detector": name, "truth": truth}
            for column, (marked, among) in shares.items():
                row |= _columns(column, cluster_bootstrap.share(marked, among, worlds, rng=rng))
            row |= _columns("mcc", cluster_bootstrap.matthews(fired, true, worlds, rng=rng))
            silent = ~group.assign(fired=fired).groupby("seed")["fired"].any()
            row |= {
                "base_rate": true.mean(), "worlds": len(silent), "silent": silent.mean()
            }  # fmt: skip
            found.append(row)
    return pd.DataFrame(found)


def _columns(name: str, interval: cluster_bootstrap.Interval) -> dict[str, float]:
    return {name: interval.value, f"{name}_low": interval.low, f"{name}_high": interval.high}
