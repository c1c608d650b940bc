# `make flatten` and `make test` need git, make and Python 3.11, 3.12 or 3.13; the rest goes into .venv.
# `make ... PYTHON=python3.12` uses that interpreter, in a virtual environment of its own (.venv-python3.12).

ifeq ($(origin PYTHON), undefined)
PYTHON := $(shell for p in python3.11 python3.12 python3.13 python3; do \
	$$p -c 'import sys, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
VENV ?= .venv
else
VENV ?= .venv-$(notdir $(PYTHON))
endif
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check
BENCHMARKS := $(shell sed -n 's/^    "\([a-z0-9_]*\)": .*/\1/p' benchmarks/harness/registry.py)

.PHONY: help flatten test smoke lint type bench bench-check docs docs-pages format clean

help:
	@echo "make flatten   flatten a crumpled towel in the simulated cell, live in the browser, and name the report"
	@echo "make test      lint, import contracts, type check, and all tests"
	@echo "make smoke     a few minutes' tests: every module, every command, one plan, one loop"
	@echo "make format    format and mend what ruff can"
	@echo "make bench     run every benchmark and write docs/results (long; QUICK=1 for a smaller sample)"
	@echo "make bench-check   check that every page in docs/results is that of its report"
	@echo "make docs      build the site into out/docs, and run the lines of its quick start"
	@echo "make docs-pages    run the printed lines of all pages"
	@echo "make clean     remove what was built (and .venv)"

flatten: $(VENV)/ready
	$(BIN)/unwrinkle flatten

# The stubs of Drake 1.58 (Python 3.12 and newer) are good, but for those of its systems framework.
TYPES = $(shell $(BIN)/python -c 'import sys; print(("pyproject.toml", "$(VENV)/pyproject.toml")[sys.version_info >= (3, 12)])')
define TYPE_CHECK
sed 's/"pydrake\.\*"/"pydrake.systems.*", "pydrake.common.value", "pydrake.common.yaml"/' pyproject.toml >$(VENV)/pyproject.toml && \
	$(BIN)/mypy -p unwrinkle -p benchmarks -p tests.robustness --config-file $(TYPES)
endef

# Files with tests that need the computer's clock. They run one at a time, at a higher priority than the others beside
# them; the others begin while types are checked.
ALONE = $(shell grep -rl --include='test_*.py' 'mark\.alone' tests)
test: lint
	nice -n 10 $(BIN)/pytest -m "not alone and not long and not smoke" --numprocesses 2 --dist loadfile \
		--no-loadscope-reorder >$(VENV)/tests.log 2>&1 & others=$$!; \
	trap 'kill $$others' INT TERM; \
	status=0; \
	$(TYPE_CHECK) || status=1; \
	$(BIN)/pytest -m "alone and not long" $(ALONE) || status=1; \
	wait $$others || status=1; \
	cat $(VENV)/tests.log; \
	exit $$status

smoke: $(or $(wildcard $(VENV)/ready),$(VENV)/smoke-ready)
	$(BIN)/pytest tests/test_smoke.py

lint: $(VENV)/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-cache

type: $(VENV)/ready
	$(TYPE_CHECK)

bench: $(VENV)/ready
	$(PIP) install --quiet --constraint constraints.txt --no-build-isolation --editable '.[bench]'
	set -e; for name in $(BENCHMARKS); do \
		$(BIN)/python -m benchmarks $$name $(if $(QUICK),--quick --json out/$$name.json, \
			--json docs/results/$$name.json --markdown docs/results/$$name.md); done

# The site, offline; warnings are errors. Sphinx runs the notebook, pytest the printed lines of the quick start.
docs: $(VENV)/docs-ready
	$(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet -b html docs out/docs
	$(BIN)/pytest docs -k "quickstart or fails"
	@echo "open out/docs/index.html"

bench-check: $(VENV)/ready
	$(BIN)/python -m benchmarks.harness.check docs/results

docs-pages: $(VENV)/docs-ready
	$(BIN)/pytest docs

format: $(VENV)/ready
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:
	rm -rf $(VENV) .venv-* build dist out *.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# An environment with the extra $(1).
define install
	@test -n "$(PYTHON)" || { echo "no Python 3.11, 3.12 or 3.13 with venv found; set PYTHON=..." >&2; exit 1; }
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(PIP) install --quiet --constraint constraints.txt pip setuptools
	$(PIP) install --quiet --constraint constraints.txt --no-build-isolation --editable '.[$(1)]'
	@$(BIN)/python -c 'import pydrake' || { echo "Drake does not load; on Debian: apt-get install libglib2.0-0" >&2; exit 1; }
	@touch $@
endef

$(VENV)/ready: pyproject.toml constraints.txt
	$(call install,dev)

$(VENV)/smoke-ready: pyproject.toml constraints.txt
	$(call install,smoke)

$(VENV)/docs-ready: $(VENV)/ready
	$(PIP) install --quiet --constraint constraints.txt --no-build-isolation --editable '.[docs]'
	@touch $@
