# Two commands on a fresh machine with Python >= 3.11, git and make: `make demo` and `make test`.
SHELL := bash
BIN := .venv/bin
# A worker waits for its browsers much of the time: on two cores four are slower than six, and eight no faster.
WORKERS ?= 6
# A worker takes neighbours, which share servers and browsers, and helps out when it is done with its own.
PYTEST := $(BIN)/pytest -n $(WORKERS) --dist worksteal
# Anything to add to a command: make test ARGS="tests/judge -k answer", make demo ARGS="--tasks 20".
ARGS ?=

# Options of scripts/setup: make setup SETUP=--docs.
SETUP ?=

# The tests start dozens of commands: none has to compile our code again, whatever the surroundings say.
export PYTHONDONTWRITEBYTECODE :=

.DEFAULT_GOAL := help
.PHONY: help setup demo test test-all test-integrations compile-tests coverage lint format bench docs lock clean

help: ## Show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-10s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: ## Make .venv, install the locked packages, a browser and fonts; quick when nothing changed
	@scripts/setup $(SETUP)

demo: setup ## Have a small model learn on the offline web; ARGS=--collect-only: 200 trajectories alone
	@$(BIN)/webgym demo $(ARGS)

test: setup ## Run the tests with real Chromium
	@$(PYTEST) -m "not slow" $(ARGS)

test-all: setup ## Run the slow tests too
	@$(PYTEST) $(ARGS)

test-integrations: setup ## Test the adapters with the frameworks themselves; ARGS="trl verl": only these
	@scripts/test-integrations $(ARGS)

compile-tests: setup ## Collect the tests once, so that no worker of `make test` has to compile them
	@$(BIN)/pytest --collect-only -qq >build/collected.log || { cat build/collected.log; exit 1; }

coverage: setup ## Run the tests and tell what they cover; twice the computing of `make test`
	@$(PYTEST) -m "not slow" --cov --cov-report=term $(ARGS)

lint: setup ## Check format, style, types, the packages' imports and the tree
	@scripts/lint

format: setup ## Rewrite the code in the house's format
	@$(BIN)/ruff format .
	@$(BIN)/ruff check --fix .

bench: setup ## Run everything in benchmarks/, which prints figures
	@set -e; for script in benchmarks/*.py; do PYTHONPATH=. $(BIN)/python "$$script" $(ARGS); done

docs: ## Build the documentation into build/docs, warnings are errors
	@scripts/setup --docs
	@$(BIN)/python -m sphinx --fresh-env --fail-on-warning --keep-going --quiet docs build/docs
	@echo "build/docs/index.html"

lock: ## Renew requirements/*.txt from pyproject.toml; ARGS=--upgrade: the newest versions
	@scripts/lock $(ARGS)

clean: ## Remove what was built; runs are kept
	@rm -rf .venv build dist htmlcov .coverage .coverage.* .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	@find src tests -name __pycache__ -type d -prune -exec rm -rf {} +
