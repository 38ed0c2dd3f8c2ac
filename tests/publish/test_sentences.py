"""What the README and the abstract say, word by word, and the tests that hold it.

Whoever alters a word finds here which tests to read: a sentence stands once more beside them.
"""

import ast
import re

import pytest

from sngr_utils import paths

AUDIT, WORLDS, DIGITS = "findings_audit", "findings", "authors_conventions"
ASSOCIATION, SECOND, PEERS = "findings_association_aware", "findings_triggers", "findings_peers"
MODES, DRIVES, AUTHORS = "findings_multimodal", "findings_real_data", "findings_authors"
TWENTIETH = f"{WORLDS}: in_most_worlds_refinement_moves_the_error_by_less_than_a_twentieth"
GROWS = f"{AUDIT}: error_and_inconsistency_grow_under_every_preset"
BASE_RATE = f"{WORLDS}: an_alarm_adds_little_to_the_base_rate_under_our_reading"
GAUSSIAN = f"{AUDIT}: windows_with_neighbours_held_are_gaussian"
SOLVER = f"{WORLDS}: gains_are_what_the_solver_left"
ORACLE = f"{WORLDS}: asking_where_a_range_came_from_comes_before_forgetting_it"
SILENT = f"{WORLDS}: silent_on_clean_data_and_blind_at_small_p"
STARTS = f"{MODES}: many_starts_are_cheapest_of_all_that_meet_the_target"
SECOND_OPINION = f"{SECOND}: disagreement_finds_failure_and_as_well_as_with_the_oracle"

# words of a part of the README, in their order -> tests that hold them, "FILE: NAME"
FOUND = {
    "Reproduced: run as its authors run it, every number of the paper's baseline comes out, three "
    "of them rounded twice;": [f"{DIGITS}: every_number_of_four_tables_comes_out_but_those_named"],
    "and under our own readings too the estimate gets worse and overconfident with wrong labels,":
        [GROWS],
    "and in most worlds refinement moves it by less than a twentieth (chapter 5).": [TWENTIETH],
    "Failed: under C, our reading, an alarm says little more than how often windows are wrong "
    "anyway,": [BASE_RATE],
    "and the windows hold nothing to sample (chapter 5).": [GAUSSIAN],
    "Works: asking of each distance which beacon it came from makes the final estimate as good as "
    "knowing it, in the paper's scenario, up to half of the labels wrong (chapter 8).": [ORACLE],
}  # fmt: skip
CAPTION = {
    "Pose error over that of an oracle that knows which landmark each range came from (chapter 8). "
    "SNGR changes iSAM2's error little. Asking each range where it came from brings it down to "
    "the oracle's, for a graph built while driving and for EM in batch alike.":
        [f"{WORLDS}: in_the_first_figure_two_stay_at_one_and_all_others_lie_above"],
}  # fmt: skip
CHAPTERS = {
    "Trigger (2, 5). A trigger is silent where it does not fire, blind where windows have failed "
    "and it fires at none of them, and uninformative where its score does not rank failures.":
        [f"{SECOND}: the_papers_threshold_is_neither_silent_nor_blind_but_uninformative"],
    "On clean data the paper's is silent at τ = 3.96 in most worlds under A and B and as its "
    "authors run it, in none under C;":
        [SILENT, f"{AUTHORS}: silent_on_clean_data_and_right_from_two_tenths_on"],
    "at 3.92 in few under A.":
        [f"{WORLDS}: at_the_lower_threshold_a_is_silent_in_few_clean_worlds"],
    "At p = 0.1 it is blind in most worlds under A and B, in hardly any under C.": [SILENT],
    "At a fixed threshold most of its precision is the base rate.":
        [f"{WORLDS}: most_of_the_precision_is_the_base_rate_under_every_preset"],
    "Refinement (3, 5). Under C at p = 0.3 it helps more often than it harms, by millimetres in "
    "the median,":
        [f"{WORLDS}: refinement_changes_little_and_under_c_at_the_most_noise_for_the_better"],
    "and so it does in sixty other worlds;":
        [f"{WORLDS}: in_sixty_other_worlds_it_helps_more_often_than_it_harms"],
    "elsewhere no direction is beyond chance.":
        [f"{WORLDS}: elsewhere_no_direction_is_beyond_chance"],
    "Windows with their separators held are Gaussian, and the gains measure how far iSAM2 had "
    "converged (both in eight worlds at p = 0.2).":
        [GAUSSIAN, SOLVER,
         f"{WORLDS}: the_paper_says_in_words_how_many_worlds_windows_were_studied_in"],
    "A second opinion (6) finds the windows that failed.": [SECOND_OPINION],
    "But whoever has one, a robust estimate, may as well use it.":
        [f"{PEERS}: any_doubt_removes_most_of_it"],
    "A chi-square with leverage keeps its rate of false alarms in every scenario, at that robust "
    "estimate and for known noise.":
        [f"{SECOND}: the_robust_chi_square_keeps_its_level_in_every_scenario"],
    "Doubt (7, 8). From a good start robust losses remove most of the error,":
        [f"{PEERS}: any_doubt_removes_most_of_it"],
    "and soft association nearly all.":
        [f"{PEERS}: who_reassigns_stays_closest_in_poses_and_landmarks"],
    "Several places (9). The posterior has them on a landmark's first poses.":
        [f"{MODES}: it_lasts_for_two_or_three_poses"],
    "A mirror test finds them":
        [f"{MODES}: the_mirror_test_finds_nearly_all_and_the_condition_number_nothing"],
    "and an ancestral prior samples them.":
        [f"{MODES}: after_few_poses_the_ancestral_prior_and_importance_weights_find_the_masses"],
    "We found no place where nested sampling is needed: many starts with importance weights do "
    "the same for less.": [STARTS],
    "Real drives (10). On two public drives of a mower among four radios,":
        [f"{DRIVES}: four_radios_are_counted"],
    "whose odometry leaks its truth,":
        [f"{DRIVES}: most_steps_of_the_odometry_are_as_long_as_those_of_the_gps"],
    "EM that grows its map from a short stretch needs no labels at all.":
        [f"{DRIVES}: no_labels_are_as_good_as_right_ones"],
    "Radios have mirror images on the first poses and none after the next corner,":
        [f"{DRIVES}: every_radio_has_a_mirror_image_on_the_first_poses"],
    "and sampling changes nothing.":
        [f"{DRIVES}: nested_sampling_is_hardly_asked_and_adds_nothing"],
}  # fmt: skip
ABSTRACT = {
    r"With the conventions of its authors' public code \res{claims.authors.equal} of "
    r"\res{claims.authors.printed} numbers come out to the digit.":
        [f"{DIGITS}: every_number_of_four_tables_comes_out_but_those_named"],
    "What holds: wrong associations make the estimate inconsistent,": [GROWS],
    "and in most worlds refinement changes the trajectory by less than a twentieth.": [TWENTIETH],
    "What does not: the score adds little to the base rate at a fixed threshold,": [BASE_RATE],
    "the windows that it refines are Gaussian (eight worlds),":
        [GAUSSIAN, f"{WORLDS}: the_paper_says_in_words_how_many_worlds_windows_were_studied_in"],
    "and the gains are what the solver had left lying.": [SOLVER],
    "What works: failed windows are found by the disagreement with a second, robust estimate (AUC "
    r"\res{triggers.auc.failed.disagreement.all_p}, against "
    r"\res{triggers.auc.failed.condition.all_p} for the condition number).": [SECOND_OPINION],
    "Asking of each range which landmark it came from brings the final estimate in the mean from "
    r"\res{online.isam2.p0.4.ratio} times the error of an oracle that knows the associations to "
    r"\res{online.p0.4.ratio} times, with four labels of ten wrong;": [ORACLE],
    r"Cauchy's loss is at \res{online.cauchy.p0.4.ratio}, a gap that is not beyond chance in "
    "forty other worlds.":
        [f"{ASSOCIATION}: in_forty_fresh_worlds_no_gap_of_seven_peers_is_beyond_chance"],
    "We found no place where nested sampling is needed.": [STARTS],
}  # fmt: skip
PARTS = {  # name -> the file, what stands before and after, what is said
    "found": (paths.README, "**What was found.**", "What the paper leaves open", FOUND),
    "caption": (paths.README, "association_aware_summary.png)", "## The verdicts", CAPTION),
    "chapters": (paths.README, "with the chapters in brackets:", "![Film strip", CHAPTERS),
    "abstract": (paths.PAPER / "sngr.tex", "verdict by rules stated beforehand.",
                 "All numbers, tables and figures", ABSTRACT),
}  # fmt: skip


def plain(text):
    """Without links, emphasis and the marks of a list."""
    text = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", text).replace("*", "")
    text = re.sub(r"\\emph\{([^}]*)\}", r"\1", re.sub(r"^- ", "", text, flags=re.M))
    return " ".join(text.split())


@pytest.mark.parametrize("name", PARTS)
def test_no_word_of_a_finding_is_altered_but_beside_its_tests(name):
    file, before, after, said = PARTS[name]
    text = file.read_text(encoding="utf-8").split(before)[1].split(after)[0]
    assert plain(text) == " ".join(said)


@pytest.mark.parametrize("name", PARTS)
def test_each_finding_has_tests(name):
    there = {
        f"{path.stem.removeprefix('test_')}: {node.name.removeprefix('test_')}"
        for path in paths.ROOT.glob("tests/**/test_*.py")
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.FunctionDef)
    }
    for sentence, tests in PARTS[name][3].items():
        assert tests, sentence
        assert set(tests) <= there, sentence
