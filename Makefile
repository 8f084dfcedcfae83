# `make demo` and `make test` work in a fresh clone: what they need is set up on the first run, inside .venv.
.PHONY: demo test check lint types imports setup bench figures clean
.DEFAULT_GOAL := demo

PYTHON := .venv/bin/python
# Two processes: most of the suite waits for one core at a time.
PYTEST_ARGS ?= -n 2
LOCK := requirements/lock.txt pyproject.toml tools/setup.sh tools/setup_system.sh

# Nothing from outside the clone may be imported in relight3d's place.
unexport PYTHONPATH PYTHONHOME
export PYTHONNOUSERSITE := 1

demo: .venv/.ready
	.venv/bin/relight3d demo

test: .venv/.ready
	$(PYTHON) -m pytest $(PYTEST_ARGS)

# Style, types and the direction of imports; warnings count. `make -k check` shows all three at once.
check: lint types imports

lint: .venv/.ready-dev
	$(PYTHON) -m ruff check --output-format=concise .

types: .venv/.ready-dev
	.venv/bin/basedpyright --warnings

imports: .venv/.ready-dev
	.venv/bin/lint-imports --no-logo

# Everything a developer needs.
setup: .venv/.ready-dev

bench: .venv/.ready
	$(PYTHON) -m pytest tests/benchmarks --benchmark-enable --benchmark-only --jaxtyping-packages= $(PYTEST_ARGS)

figures: .venv/.ready
	MPLBACKEND=Agg $(PYTHON) pipelines/make_figures.py

clean:
	rm -rf .venv .pytest_cache .ruff_cache .import_linter_cache .hypothesis .benchmarks build dist
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# Remade when a pin or the project changes, and when the clone was moved or copied with its .venv.
ifneq ($(shell cat .venv/.made-in 2>/dev/null),$(CURDIR))
.PHONY: .venv/.ready .venv/.ready-dev
endif

.venv/.ready: $(LOCK)
	tools/setup.sh

.venv/.ready-dev: $(LOCK) requirements/dev-lock.txt
	tools/setup.sh --dev
