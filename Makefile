# `make flatten` and `make test` need git, make and Python 3.11 (or newer); the rest goes into .venv.

PYTHON ?= $(shell for p in python3.11 python3; do \
	$$p -c 'import sys, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
VENV ?= .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check
BENCHMARKS := $(shell sed -n 's/^    "\([a-z0-9_]*\)": .*/\1/p' benchmarks/harness/registry.py)

.PHONY: help flatten test lint type bench bench-check format clean

help:
	@echo "make flatten   flatten a crumpled towel in the simulated cell, live in the browser, and name the report"
	@echo "make test      lint, import contracts, type check, and all tests"
	@echo "make format    format and mend what ruff can"
	@echo "make bench     run every benchmark and write docs/results (long; QUICK=1 for a smaller sample)"
	@echo "make bench-check   check that every page in docs/results is that of its report"
	@echo "make clean     remove what was built (and .venv)"

flatten: $(VENV)/ready
	$(BIN)/unwrinkle flatten

test: lint type
	status=0; \
	$(BIN)/pytest -m "alone and not long" || status=1; \
	$(BIN)/pytest -m "not alone" --numprocesses 2 --dist loadfile || status=1; \
	exit $$status

lint: $(VENV)/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-cache

type: $(VENV)/ready
	$(BIN)/mypy -p unwrinkle -p benchmarks -p tests.robustness

bench: $(VENV)/ready
	$(PIP) install --quiet --constraint constraints.txt --no-build-isolation --editable '.[bench]'
	set -e; for name in $(BENCHMARKS); do \
		$(BIN)/python -m benchmarks $$name $(if $(QUICK),--quick --json out/$$name.json, \
			--json docs/results/$$name.json --markdown docs/results/$$name.md); done

bench-check: $(VENV)/ready
	$(BIN)/python -m benchmarks.harness.check docs/results

format: $(VENV)/ready
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:
	rm -rf $(VENV) build dist out *.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(VENV)/ready: pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "no Python 3.11 or newer with venv found; set PYTHON=..." >&2; exit 1; }
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(PIP) install --quiet --constraint constraints.txt pip setuptools
	$(PIP) install --quiet --constraint constraints.txt --no-build-isolation --editable '.[dev]'
	@$(BIN)/python -c 'import pydrake' || { echo "Drake does not load; on Debian: apt-get install libglib2.0-0" >&2; exit 1; }
	@touch $@
