# Tasks. On Windows, or without make, README.md gives the same as plain pip lines.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Longest files first. One worker more than the two cores: tests in a browser wait for much of their time.
SPREAD := -n 3 --dist loadfile --no-loadscope-reorder

.PHONY: help demo test test-full check style layers types spread docs bench lock sbom clean
help:  ## List the tasks
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 12

demo: $(VENV)/.installed  ## Run the main job on shipped data
	$(BIN)/fingertwin demo

test: style  ## Check style, then layers and types while the tests run
	$(MAKE) --no-print-directory -j 3 layers types spread

test-full: style  ## The same with all examples (some minutes more)
	$(MAKE) --no-print-directory -j 3 layers types spread SPREAD='$(SPREAD) -m "full or not full"'

check: style layers types  ## Style, layers, types

style: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

layers: $(VENV)/.dev
	$(BIN)/lint-imports

# Types take over a minute of one core at first; tests wait for much of their time.
types: $(VENV)/.dev
	nice $(BIN)/mypy

spread: $(VENV)/.dev
	$(BIN)/pytest $(SPREAD)

docs: $(VENV)/.dev  ## Build the documentation as a site in build/docs; warnings and broken links are errors
	$(BIN)/sphinx-build -q -W --keep-going -b html -c docs -d build/doctrees . build/docs

bench: $(VENV)/.dev  ## Time everything against its rivals (about five minutes)
	$(BIN)/python -m benchmarks.run

lock: $(VENV)/.installed  ## Write requirements.lock: what the service is installed from, with hashes
	$(BIN)/python docs/deploy/lock.py requirements.lock

sbom: $(VENV)/.installed  ## Write the service's bill of materials (CycloneDX) to dist/
	$(BIN)/python docs/deploy/lock.py dist/fingertwin.cdx.json

clean:  ## Remove the environment and caches
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml constraints.txt | $(BIN)/python
	$(BIN)/pip install --disable-pip-version-check -q -c constraints.txt -e .
	@touch $@

# Modules are compiled when they are first imported: of all that the tools bring, few ever are.
$(VENV)/.dev: pyproject.toml constraints.txt | $(BIN)/python
	$(BIN)/pip install --disable-pip-version-check -q --no-compile -c constraints.txt -e '.[dev]'
	@touch $(VENV)/.installed $@
