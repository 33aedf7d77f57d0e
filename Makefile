# Everything a fresh machine needs is git, make and Python 3.11 or newer.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
OUT ?= out
JOBS ?= 2

# Hundreds of processes start: each would compile all that it imports, 1.5 s of CPU.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-all check bench docs pictures results replays clean

demo: $(VENV)/.base
	$(BIN)/swath run laser-pilot --out $(OUT)/demo

test: $(VENV)/.dev
	$(BIN)/python -m pytest -n $(JOBS) --dist loadfile --no-loadscope-reorder -m "not draws"

# what proves over draws: statistics, fuzz, fleets of jobs, tutorials
test-all: $(VENV)/.dev
	$(BIN)/python -m pytest -n $(JOBS) --dist loadfile --no-loadscope-reorder -m draws

check: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache
	$(BIN)/python -m tests.durations check

bench: $(VENV)/.dev
	$(BIN)/python benchmarks/run.py --out $(OUT)/bench

# needs Chromium; ONLY="gallery moving" makes some
pictures: $(VENV)/.dev
	$(BIN)/python -m docs.make.pictures $(ONLY)

replays: $(VENV)/.dev
	$(BIN)/python -m docs.make.replays

results: $(VENV)/.dev
	$(BIN)/python -m docs.make.tables $(ONLY)

docs: $(VENV)/.docs
	$(BIN)/sphinx-build -W --keep-going -n -q -b html docs $(OUT)/site
	@echo $(OUT)/site/index.html

# Each is one installation; `dev` holds what the others do. Modules are compiled where they are first imported.
INSTALL = $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt -e

$(VENV)/.base: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(INSTALL) .
	@touch $@

$(VENV)/.docs: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(INSTALL) '.[docs,gym]'
	@touch $@ $(VENV)/.base

$(VENV)/.dev: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(INSTALL) '.[dev]'
	@touch $@ $(VENV)/.base $(VENV)/.docs

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "swath needs Python 3.11 or newer; try: make $(MAKECMDGOALS) PYTHON=python3.12"; exit 1; }
	$(PYTHON) -m venv $(VENV)

clean:
	rm -rf $(VENV) $(OUT) build src/*.egg-info
