"""Where the project keeps things. Every path is below the checkout's own folder."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = ROOT / "notebooks"
PARAMS = ROOT / "params"
FIGURES = ROOT / "figures"
PAPER = ROOT / "paper"
LOCK = ROOT / "environment.lock"
PACKAGE = ROOT / "sngr_utils"
BUILD = ROOT / "build"
RESULTS = BUILD / "results"
EXECUTED = BUILD / "executed"
STAGING = BUILD / "staging"
RUNS = BUILD / "runs"
REFERENCE = PAPER / "reference"
PRINTED_VALUES = PAPER / "printed_values.yaml"
CLAIMS = PAPER / "claims.yaml"
VERDICTS = PAPER / "verdicts.json"
README = ROOT / "README.md"
VERIFIED = PAPER / "verified.json"
CITATION = ROOT / "CITATION.cff"
