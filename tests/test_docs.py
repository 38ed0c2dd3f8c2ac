"""What the documents point at is there, and the glossary can be read by a program."""

import re

import pytest
from helpers import paper_text, read_notebook

from sngr_utils import paths, real_data

NOTEBOOKS = sorted(path.stem for path in paths.NOTEBOOKS.glob("*.ipynb"))
DOCS = sorted((paths.ROOT / "docs").rglob("*.md"))


@pytest.mark.parametrize("path", DOCS, ids=lambda path: path.name)
def test_links_lead_somewhere(path):
    for link in re.findall(r"\]\(([^)#]+)\)", path.read_text(encoding="utf-8")):
        assert "://" in link or (path.parent / link).exists(), link


def test_a_section_that_is_named_is_in_its_notebook():
    text = (paths.ROOT / "docs/teaching/README.md").read_text(encoding="utf-8")
    named = re.findall(r"\[([^\]]+)\]\(\.\./\.\./notebooks/(\w+)\.ipynb\)", text)
    assert len(named) > 20
    for section, name in named:
        cells = [c.source for c in read_notebook(name).cells if c.cell_type == "markdown"]
        headings = re.findall(r"^#+ (?:\d+\. )?(.*)$", "\n".join(cells), re.MULTILINE)
        assert section in headings, (section, name)


def test_systems_that_have_rows_on_the_real_drives_are_those_the_page_names():
    page = (paths.ROOT / "docs" / "other_systems.md").read_text(encoding="utf-8")
    named = {
        "least squares": "least_squares", "Huber": "huber", "Cauchy": "cauchy", "DCS": "dcs",
        "Geman-McClure": "geman_mcclure", "switchable constraints": "switchable", "EM": "em",
    }  # fmt: skip
    (rows,) = (line for line in page.splitlines() if line.endswith("| rows of these names |"))
    assert all(re.search(rf"\b{name}\b", rows) for name in [*named, "max-mixtures"])
    quoted = {"gnc_tls", "gnc_gm", "gnc_tls_superlinear", "isam", "isam2"}
    assert all(f"`{name}`" in page for name in quoted)
    mixtures = {"max_mixture_all", "max_mixture_null"}
    assert set(real_data.study("plaza_peers")["method"]) == {*named.values(), *quoted, *mixtures}


def test_the_glossary_is_one_sentence_a_term_in_order():
    text = (paths.ROOT / "docs/glossary.md").read_text(encoding="utf-8")
    entries = re.findall(r"^\*\*([^*]+)\*\*(?: \(([^)]*)\))?: (.+)$", text, re.MULTILINE)
    assert len(entries) == text.count("\n**") >= 60
    terms = [term for term, _, _ in entries]
    assert terms == sorted(set(terms), key=str.lower)
    for _, _, meaning in entries:
        assert meaning.endswith(".")
        assert ". " not in meaning


# Commands that are no letters, with what they set upright; the Greek ones are letters.
UPRIGHT = r"\\(?:text|mathrm|mathbb|mathcal|mathsf|operatorname|[eq]*ref|res|label|begin|end)\*?"
GREEK = (
    "alpha|beta|gamma|delta|varepsilon|eta|kappa|lambda|mu|nu|xi|pi|rho|sigma|tau|phi|chi|psi|omega"
    "|theta|Gamma|Delta|Lambda|Sigma|Phi|Psi|Omega|Theta|ell"
)
LETTER = re.compile(rf"\\(?:{GREEK})(?![a-zA-Z])|(?<![a-zA-Z\\])[a-zA-Z](?![a-zA-Z])")
FORMULA = re.compile(r"\$\$(.*?)\$\$|\$([^$]+)\$|\\begin{(?:align|equation)}(.*?)\\end", re.DOTALL)


def letters(text):
    """The letters that stand for something in the formulas of a text."""
    formulas = ("".join(parts) for parts in FORMULA.findall(text))
    upright = re.compile(rf"{UPRIGHT}(?:{{[^}}]*}}| *[A-Z](?![a-z]))")
    return {one for formula in formulas for one in LETTER.findall(upright.sub(" ", formula))}


def signs():
    """The signs of the table of notation, one a meaning."""
    text = (paths.ROOT / "docs/notation.md").read_text(encoding="utf-8")
    cells = [row.split("|")[1].strip() for row in text.splitlines() if row.startswith("| ")][1:]
    return [sign for cell in cells for sign in cell.split(", ")]


def test_a_letter_has_one_meaning():
    found = signs()
    assert len(found) == len(set(found)) > 40


def told(name):
    """The text of a notebook, or of the paper and its supplement, without code and comments."""
    if name == "paper":
        return re.sub(r"(?<!\\)%.*", "", paper_text()).replace(r"\MAP", " ").replace(r"\T", " ")
    cells = [cell.source for cell in read_notebook(name).cells if cell.cell_type == "markdown"]
    return re.sub(r"`[^`]*`", "", "\n".join(cells))


@pytest.mark.parametrize("name", [*NOTEBOOKS, "paper"])
def test_every_letter_of_a_formula_is_in_the_table_of_notation(name):
    text = told(name)
    assert letters("$ab + \\text{c} \\mathcal N d_w \\hat k \\sigma^e$") == set("dwke") | {
        r"\sigma"
    }
    assert letters(text)
    assert letters(text) <= letters(" ".join(signs())) | set("TK")


# What a letter can be called, and which letters are: "the weight $w$" has another meaning.
CALLED = {
    "weight": r"\omega \gamma", "density": r"\pi \phi", "leverage": "H", "covariance": r"\Sigma",
    "information": r"\Lambda R", "jacobian": "J", "hessian": r"\nabla", "threshold": r"\tau",
    "score": "s", "eigenvalue": r"\lambda", "evidence": "Z", "innovation": r"\nu", "variance": "S",
    "odometry": "u", "residual": "r i", "error": "e E", "step": r"\delta t", "loss": r"\rho",
    "width": r"\kappa \sigma", "switch": r"\gamma", "share": r"p \beta", "mass": "m",
    "mean": r"\mu x", "pose": "x t", "landmark": "l k", "range": "z i", "window": "w t",
    "factor": r"\phi \alpha i", "sigma": r"\sigma \xi", "tolerance": r"\xi", "dimension": "d",
}  # fmt: skip


def second_meanings(text):
    """Where a word for one letter stands before another: (word, letter)."""
    found = []
    for word, formula in re.findall(r"(?<![\w-])([A-Za-z]+)\s+\$([^$]+)\$", text):
        word = word.lower() if word.lower() in CALLED else word.lower().removesuffix("s")
        first = LETTER.match(re.sub(r"^\\(?:hat|bar) ", "", formula))
        if word in CALLED and first and first[0] not in CALLED[word].split():
            found.append((word, first[0]))
    return found


@pytest.mark.parametrize("name", [*NOTEBOOKS, "paper"])
def test_no_letter_is_called_what_another_is(name):
    assert second_meanings("the weights $w_i$, the share\n$p$") == [("weight", "w")]
    assert second_meanings(told(name)) == []


def test_the_quiz_has_fifteen_questions_and_answers():
    text = (paths.ROOT / "docs/teaching/quiz.md").read_text(encoding="utf-8")
    parts = re.split(r"^\*\*(\d+)\.\*\* ", text, flags=re.MULTILINE)
    assert parts[1::2] == [str(number) for number in range(1, 16)]
    for part in parts[2::2]:
        assert part.count("<details>") == part.count("</details>") == 1


def test_each_message_of_the_page_of_help_is_one_that_is_given():
    text = (paths.ROOT / "docs/help.md").read_text(encoding="utf-8")
    heads = re.findall(r"^- (`.+?`(?:, `.+?`)*):(?: |$)", text, re.MULTILINE)
    told = [message for head in heads for message in re.findall(r"`(.+?)`", head)]
    assert len(told) > 20
    assert len(heads) == text.count("\n- `")
    folders = [*paths.PACKAGE.rglob("*.py"), *(paths.ROOT / "scripts").glob("*.*")]
    sources = [*folders, paths.ROOT / "conftest.py"]
    given = "\n".join(path.read_text(encoding="utf-8") for path in sources)
    given = re.sub(r'"\s*\n\s*f?"', "", given)  # a string that goes on in the next line
    for message in told:
        for part in message.removeprefix("error: ").split("…"):
            assert part.strip(" :") in given, message
