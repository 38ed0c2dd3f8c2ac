"""Sentences about the authors' own conventions, in README, notebooks 02 and 03 and the paper."""

import re

import numpy as np
import pytest

from sngr_utils import paths
from sngr_utils.publish import authors, authors_worlds, claims, rules

LEVELS = (0.0, 0.1, 0.2, 0.3, 0.4)


def over(name):
    """One measure of the trigger at every p, with the ends of its interval."""
    each = [authors_worlds.measures(p)[name] for p in LEVELS]
    return np.array([[one.value, one.low, one.high] for one in each])


def test_silent_on_clean_data_and_right_from_two_tenths_on():
    assert 0.7 <= over("silent")[0, 0] <= 0.8
    assert (over("precision")[2:, 0] > 0.97).all()


def test_it_fires_in_a_third_of_the_worlds_and_then_in_two_thirds():
    fires = 1 - over("silent")[1:, 0]
    assert (np.abs(fires[:2] - 1 / 3) < 0.05).all()
    assert (np.abs(fires[2:] - 2 / 3) < 0.05).all()


def test_an_alarm_adds_one_to_four_hundredths_to_what_is_known_of_its_worlds():
    gain = over("gain")[1:]
    assert (gain[:, 1] > 0).all()
    assert (np.round(gain[:, 0], 2) >= 0.01).all()
    assert (np.round(gain[:, 0], 2) <= 0.04).all()
    there, every = over("base_there")[1:, 0], over("base_rate")[1:, 0]
    assert (there > every).all()
    assert (there > 0.85).all()  # nearly all have failed anyway


def test_it_misses_three_failures_of_four_at_one_tenth_and_two_and_most_at_three():
    recall = over("recall")[:, 0]
    assert (np.abs(recall[1:3] - 0.25) < 0.05).all()
    assert recall[3] < 0.5
    assert abs(recall[4] - 0.5) < 0.06


def test_at_the_fewest_wrong_labels_its_worlds_fail_more_than_all_worlds():
    assert over("base_there")[1, 0] > over("base_rate")[1, 0] + 0.2
    assert (over("precision")[1:, 0] > 0.9).all()


def test_its_score_ranks_failures_within_a_world():
    assert (over("auc")[1:, 1] > 0.6).all()


def test_errors_grow_in_every_world_and_the_blind_spot_is_as_they_say():
    holds = authors_worlds.holds()
    assert holds["inconsistent"].all()
    assert holds["rmse-grows"].all()
    assert rules.share(holds["blind-spot"], 0.8) in (rules.TREND, rules.REPRODUCED)


def test_refining_changes_some_errors_and_helps_as_often_as_it_harms():
    assert 0.2 < 1 - authors_worlds.holds()["rmse-unchanged"].mean() < 0.5
    for p in (0.2, 0.3):
        world = authors_worlds.at(p)
        better = (world["refined_rmse"] < world["rmse"]).sum()
        worse = (world["refined_rmse"] > world["rmse"]).sum()
        assert rules.stats.binomtest(int(better), int(better + worse)).pvalue > 0.05


def worse_and_better():
    """Worlds whose error changes by more than a twentieth, by the sign of the larger change."""
    changes = np.array([
        authors_worlds.at(p)["refined_rmse"] / authors_worlds.at(p)["rmse"] - 1 for p in (0.2, 0.3)
    ])
    larger = np.take_along_axis(changes, np.abs(changes).argmax(axis=0)[None], axis=0)[0]
    return (larger > 0.05).sum(), (larger < -0.05).sum()


def test_the_page_on_the_original_has_these_numbers():
    """Both tables of docs/original_code.md at its head, cell by cell, to the digits they show."""
    found, lines = authors.read(), (paths.ROOT / "docs/original_code.md").read_text().splitlines()
    values = {"/".join(path): each for path, each in authors.values(found).items()}
    ours = lambda table, p, name: values[f"{table}/{p}/{name}"]  # noqa: E731

    def told(words, levels):
        (line,) = (line for line in lines if line.startswith(f"| {words} |"))
        cells = [re.findall(r"[\d.]+", cell) for cell in line.split("|")[2:-1]]
        return zip(cells, levels, strict=True)

    def same(cell, numbers):
        for text, number in zip(cell, numbers, strict=True):
            assert f"{number:.{len(text.partition('.')[2])}f}" == text

    levels = ("0.0", "0.1", "0.2", "0.3", "0.4")
    shown = {"RMSE, mean of five": "rmse", "its standard deviation": "rmse_std",
             "NEES, seed 0": "nees", "failed windows, seed 0": "failed"}  # fmt: skip
    for words, name in shown.items():
        for cell, p in told(words, levels):
            same(cell, ours("baseline", p, name))
    for cell, p in told("triggers at 3.96, of them failed, seed 0", levels):
        (fired,), (precision,) = ours("baseline", p, "triggered"), ours("baseline", p, "precision")
        same(cell, [fired, fired * (precision or 0)])
    rows = iter([line for line in lines if line.startswith("| in twenty draws |")])
    for name in ("pose_rmse", "nees"):
        for cell, p in zip(next(rows).split("|")[2:-1], levels, strict=False):
            drawn = ours("sngr", p, name)
            ends = re.findall(r"[\d.]+", cell)
            same(ends, [min(drawn), max(drawn)][: len(ends)])
            assert len(ends) == 2 or max(drawn) - min(drawn) < 0.001


def test_every_claim_that_is_told_is_one_of_the_papers():
    ids = {entry.id for entry in [*claims.read().numbers, *claims.read().prose]}
    assert authors_worlds.told().keys() | authors_worlds.holds().keys() <= ids


@pytest.mark.parametrize(
    ("words", "numbers"),
    [
        (r"at p = 0.1, 0.2 and 0.3 (\d+), (\d+) and (\d+) % of them are right",
         lambda: 100 * over("precision")[1:4, 0]),
        (r"so are (\d+), (\d+) and (\d+) % of the windows of the worlds",
         lambda: 100 * over("base_there")[1:4, 0]),
        (r"silent at τ = 3.96 in (\d+) of 100 worlds and at 3.92 in (\d+), under C",
         lambda: [100 * over("silent")[0, 0], (authors_worlds.at(0.0)["fired_clean"] == 0).sum()]),
        (r"area 0\.(\d+) at p = 0\.1", lambda: 100 * over("auc")[1:2, 0]),
        (r"it finds no failure in (\d+)\s+worlds",
         lambda: [authors_worlds.holds()["blind-spot"].sum()]),
        (r"more than a twentieth in (\d+) of 100 worlds at p = 0.2 or 0.3, "
         r"for the worse in (\d+) and for the better in (\d+)",
         lambda: [(~authors_worlds.holds()["rmse-unchanged"]).sum(), *worse_and_better()]),
        (r"the (\d+) windows that SNGR samples in the paper's own world are Gaussian, in each",
         lambda: [sum(one["like_a_gaussian"] for one in authors.read()["draws"]) / 20]),
    ],
)  # fmt: skip
def test_the_readme_has_these_numbers(words, numbers):
    text = " ".join(paths.README.read_text(encoding="utf-8").split())
    found = re.search(words.replace(r"\s+", " "), text)
    assert found, words
    assert [int(each) for each in found.groups()] == [round(float(x)) for x in numbers()]
