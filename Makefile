# make paper    from nothing to paper/sngr.pdf and paper/supplement.pdf
# make test     everything that checks the project
# `make help` lists the rest. Works with GNU Make 3.81 and later, with or without -j.

SHELL := bash
# -p: without what a user exports to all shells, options and functions
.SHELLFLAGS := -p -euo pipefail -c
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help

PYTHON ?=
export PYTHON
JOBS ?= 2
# Of `make mutants`: how many, and the seed of their choice.
MUTANTS ?= 300
SEED ?= 1
# The last ones first, which are long: the short ones fill what is left of two cores.
NOTEBOOKS := $(notdir $(basename $(shell ls -r notebooks/*.ipynb)))
PY := .venv/bin/python
RUN := $(PY) -m sngr_utils
# Once for all notebooks and tests that follow; seconds if it has been done.
COMPILE := $(RUN) compile

# The environment is private: nothing of the user's set-up of Python, Jupyter, Matplotlib, numba,
# joblib, pytest, git or TeX counts, whatever they have put into variables.
unexport $(filter PYTHON% JUPYTER% IPYTHON% MPL% NUMBA_% JOBLIB_% LOKY_% DASK_% PYTEST_% COVERAGE_% \
  RUFF_% PAPERMILL_% NBVAL_% PYDEVD_% TQDM_% NODE_% OPENBLAS_% MKL_% KMP_% TEX% BIB% BST% MF% TFM% \
  T1% ENC% GIT_% VIRTUAL_ENV CONDA_PREFIX LATEXMKRCSYS max_print_line error_line half_error_line \
  shell_escape openout_any openin_any CDPATH BASH_ENV BASHOPTS SHELLOPTS BASH_FUNC_% ENV \
  GREP_OPTIONS POSIXLY_CORRECT TZ, $(.VARIABLES))
export PYTHONNOUSERSITE := 1
export PYTHONHASHSEED := 0
export PYTHONUTF8 := 1
export JUPYTER_CONFIG_DIR := $(CURDIR)/build/cache/jupyter
export JUPYTER_PREFER_ENV_PATH := 1
export IPYTHONDIR := $(CURDIR)/build/cache/ipython
export MPLCONFIGDIR := $(CURDIR)/build/cache/matplotlib
export TEXMFHOME := $(CURDIR)/build/cache/texmf
export OPENBLAS_NUM_THREADS := 1
export OMP_NUM_THREADS := 1
export SOURCE_DATE_EPOCH := 1735689600

# In a recipe: -j$(JOBS) for a sub-make, unless the user gave make a -j of their own.
PARALLEL = $(if $(filter -j% --jobserver%,$(MAKEFLAGS)),,-j$(JOBS))
SUBMAKE = $(MAKE) --no-print-directory

.PHONY: verify reference
.PHONY: help setup lock tex check results notebooks paper pdf test lint clean distclean
.PHONY: quick $(NOTEBOOKS:%=run/%) $(NOTEBOOKS:%=quick/%) $(NOTEBOOKS:%=refresh/%)

help:
	@echo 'make paper      everything, from nothing to paper/sngr.pdf and its supplement (installs TeX by apt if it may: NO_APT=1 declines)'
	@echo 'make test       tests, and the committed notebooks re-run and compared'
	@echo 'make coverage   the unit tests, with the lines of the library they miss (90 % at least)'
	@echo 'make mutants    break the library at random in MUTANTS places: do its tests notice?'
	@echo 'make matrix     try make in many situations: tried, clean, skipped'
	@echo 'make study/NAME  a long study, into paper/studies; takes up what an earlier run left'
	@echo "make original   the printed digits under the authors' conventions, with GTSAM 4.2 (wheels: Python 3.11)"
	@echo 'make results    the notebooks only: figures/ and build/results/ (needs no TeX)'
	@echo 'make quick      the notebooks with the small params/quick, into build/quick'
	@echo 'make run/NAME   one notebook, e.g. make run/01_bimodal'
	@echo 'make notebooks  execute the committed notebooks in place, refreshing their outputs (one: make refresh/NAME)'
	@echo 'make reference  make the results at hand the reference, after a deliberate change'
	@echo 'make tex        install TeX only'
	@echo 'make why KEY=online.p0.4.ratio  (or TABLE=, FIGURE=) trace it to its cell and its code'
	@echo 'make bench      time the engines side by side, with their errors'
	@echo 'make verify     re-run everything aside and compare with paper/reference'
	@echo 'make setup      the Python environment only (.venv)'
	@echo 'make site       the web site, in build/site; make test-site looks at it in a browser (Chromium by apt: NO_APT=1 declines)'
	@echo 'make archive    results with checksums and metadata, for a repository of data, in build/archive'
	@echo 'make arxiv      the sources of the paper as a tarball that typesets alone'
	@echo 'make results-from TARBALL=...  take results from an archive; one notebook is run to check'
	@echo 'make lint       ruff, imports between rooms, and how long each notebook takes to read'
	@echo 'make student    the notebooks without their solutions, into build/student'
	@echo 'make slides     a deck of slides for each chapter, into build/slides; no network needed'
	@echo 'make lock       resolve pyproject.toml into environment.lock again (needs uv)'
	@echo 'make clean      remove what was built; make distclean also removes .venv'
	@echo 'JOBS=1 runs the notebooks one after the other (default 2 at a time).'

# Sequential on purpose, so that -j cannot start long work before the checks.
paper:
	@+$(SUBMAKE) tex
	@+$(SUBMAKE) results
	@+$(SUBMAKE) pdf

setup:
	@bash scripts/setup.sh '$(PYTHON)'

check: setup
	@$(RUN) check

results: setup
	@+stale=$$($(RUN) stale) && if [ -n "$$stale" ]; then \
	  $(COMPILE) && $(SUBMAKE) $(PARALLEL) $$stale; \
	  else echo 'all notebooks are up to date'; fi

$(NOTEBOOKS:%=run/%): run/%: setup
	@$(RUN) notebook $*

quick: check
	@$(COMPILE)
	@+$(SUBMAKE) $(PARALLEL) $(NOTEBOOKS:%=quick/%)

$(NOTEBOOKS:%=quick/%): quick/%: setup
	@$(RUN) quick $*

notebooks: check
	@$(COMPILE)
	@+$(SUBMAKE) $(PARALLEL) $(NOTEBOOKS:%=refresh/%)

$(NOTEBOOKS:%=refresh/%): refresh/%: setup
	@$(RUN) refresh $*

verify: check
	@$(COMPILE)
	@+$(SUBMAKE) $(PARALLEL) $(NOTEBOOKS:%=scratch/%)
	@$(RUN) verify

# The engines side by side as a table, with the parameters of notebook 04.
bench: check
	@$(COMPILE)
	@$(RUN) bench

.PHONY: bench $(NOTEBOOKS:%=scratch/%)
$(NOTEBOOKS:%=scratch/%): scratch/%: setup
	@$(RUN) aside $*

# Where a number, a table or a figure comes from: make why KEY=online.p0.4.ratio, TABLE=online_goal
# or FIGURE=08_association_aware_summary; a cell of a table as paper/reference has it,
# KEY=tab_online_goal.row1.column2.
.PHONY: why
why: export ASKED := $(or $(KEY),$(TABLE),$(FIGURE))
why: setup
	@$(RUN) why "$${ASKED:?name one: KEY=, TABLE= or FIGURE=}"

# After a deliberate change: make the results at hand the reference.
reference: results
	@$(RUN) adopt

tex:
	@bash scripts/install_tex.sh

# One at a time: two would write the same files.
pdf: setup
	@+$(PY) scripts/alone.py build/.pdf.lock $(SUBMAKE) typeset

.PHONY: typeset
typeset:
	@$(RUN) latex
	@[ ! -d build/paper ] || find build/paper/ -type l -exec rm -f {} + # TeX would write through them
	@bash scripts/typeset.sh

test: check
	@$(COMPILE)
	@$(PY) -m pytest

.PHONY: coverage
coverage: check
	@$(COMPILE)
	@$(PY) -m pytest tests --cov=sngr_utils --cov-report=term-missing:skip-covered \
	  --cov-fail-under=90

# The web site, from the committed notebooks as they are; open build/site/index.html.
.PHONY: site test-site
site: setup student
	@bash scripts/setup_more.sh site docs/site/requirements.lock
	@$(PY) docs/site/assemble.py
	@rm -rf build/site
	@$(PY) -m sphinx -q -W -E -c docs/site -d build/cache/site build/site-source build/site
	@echo 'build/site/index.html is written'

test-site: site slides
	@bash scripts/install_browser.sh
	@$(PY) -m pytest tests/site/test_*.py --dist=load

# What is left for others to keep: build/archive, from results at hand; and paper's sources.
.PHONY: archive arxiv results-from
archive: results
	@bash scripts/setup_more.sh archive scripts/archive.lock
	@$(RUN) latex
	@$(PY) scripts/archive.py

arxiv: pdf
	@$(PY) scripts/arxiv.py

# In place of executing: make results-from TARBALL=sngr-results.tar.gz, its .sha256 beside it.
results-from: setup
	@$(PY) scripts/results_from.py '$(or $(TARBALL),$(error name it: TARBALL=))'

# A study that stands outside `make paper`: make study/NAME, as often as it is interrupted.
study/%: setup
	@$(RUN) study $*

# The printed digits under the authors' conventions, with GTSAM 4.2 in an environment of its own. What
# the sampler moves is drawn DRAWS times, half a minute each, and kept; without, it is left out.
.PHONY: original
original: export FILE := $(if $(DRAWS),paper/studies/authors_digits.json,build/original.json)
original: setup
	@bash scripts/original.sh "$$FILE" '$(or $(DRAWS),0)'
	@$(RUN) original "$$FILE"
	@[ -n '$(DRAWS)' ] || echo 'left out: what the sampler moves, which had no seed (DRAWS=20 draws it, half a minute each)'

# On copies in build/mutants; SEED=2 draws other ones. Fails below 90 %.
.PHONY: mutants
mutants: setup
	@$(PY) scripts/mutants.py --sample $(MUTANTS) --seed $(SEED)

# In copies below build/matrix; STRICT=1 fails on a skip that scripts/matrix does not name, and
# MINUTES=10 begins none after that and names those that were not tried.
.PHONY: matrix
matrix: setup
	@bash scripts/setup_more.sh archive scripts/archive.lock
	@$(PY) scripts/matrix $(if $(STRICT),--strict) $(if $(MINUTES),--minutes $(MINUTES))

lint: setup
	@$(PY) -m ruff check . && $(PY) -m ruff format --check .
	@mkdir -p build && .venv/bin/lint-imports --no-cache > build/imports.log || { cat build/imports.log; exit 1; }
	@$(PY) scripts/reading.py

# The notebooks without their solutions, into build/student; nothing is executed.
.PHONY: student
student: setup
	@$(PY) scripts/student.py

# Slides of every chapter, from its cells and stored outputs; open build/slides/NAME.html.
.PHONY: slides
slides: setup
	@bash scripts/setup_more.sh site docs/site/requirements.lock
	@$(PY) scripts/slides.py

lock:
	@command -v uv > /dev/null || { echo 'make lock needs uv on the PATH' >&2; exit 1; }
	uv pip compile --quiet --universal --fork-strategy fewest --generate-hashes --no-annotate \
	  --no-header --python-version 3.11 --group dev pyproject.toml -o environment.lock
	uv pip compile --quiet --universal --fork-strategy fewest --generate-hashes --no-annotate \
	  --no-header --python-version 3.11 --group site -c environment.lock -o docs/site/requirements.lock
	uv pip compile --quiet --universal --fork-strategy fewest --generate-hashes --no-annotate \
	  --no-header --python-version 3.11 --group archive -c environment.lock -o scripts/archive.lock

clean:
	rm -rf build paper/generated paper/sngr.pdf paper/supplement.pdf .pytest_cache .ruff_cache .coverage

distclean: clean
	rm -rf .venv .venv.before
	find sngr_utils tests -name __pycache__ -prune -exec rm -rf {} +
