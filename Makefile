# `make demo` and `make test` need Python 3.11 or newer, and nothing else.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
SOURCES := benchmarks data gaitpref labeling_ui policy rewardmodel tests

.PHONY: install demo test test-browser test-fast check format lint type clean

install: $(VENV)/.installed

$(VENV)/.installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[train,label,explain,parquet,dev]'
	touch $@

demo: install
	$(BIN)/gaitpref loop --run runs/demo --preset quick --criterion high_step

test: install
	$(BIN)/python -m pytest -m 'not browser'

test-browser: install
	$(BIN)/python -m pytest -m browser

test-fast: install
	$(BIN)/python -m pytest -m 'not slow and not browser'

check: install
	$(BIN)/ruff format --check $(SOURCES)
	$(BIN)/ruff check $(SOURCES)
	$(BIN)/pyright --pythonpath $(BIN)/python

format: install
	$(BIN)/ruff format $(SOURCES)
	$(BIN)/ruff check --fix $(SOURCES)

clean:
	rm -rf $(VENV) build dist .pytest_cache .ruff_cache
