# `make demo` and `make test` need Python 3.11 or newer, and nothing else.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
SOURCES := benchmarks data docs examples gaitpref labeling_ui policy rewardmodel studies tests

.PHONY: install chromium demo docs test test-fast check format clean

install: $(VENV)/.installed

$(VENV)/.installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[train,label,explain,parquet,postgres,logs,export,onnx,scale,gpu,film,sb3,wandb,s3-server,docs,dev]'
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[interop]' \
	  || echo 'without the extra interop: tests that open files with other projects skip'
	touch $@

demo: install
	$(BIN)/gaitpref loop --run runs/demo --preset quick --criterion high_step

# The pages as a site in runs/site; a link that leads nowhere is an error. With --quiet, warnings
# are not counted and nothing is one.
docs: install
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# For the browser tests, which skip by name where none can be had.
chromium: install
	.ci/chromium $(BIN)/python

# One process more than cores; the tests of a file stay together and share what they
# made. In their own order, or files of one long test would come last.
PYTEST := $(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder

test: install chromium
	$(PYTEST)

test-fast: install
	$(PYTEST) -m 'not slow and not browser'

check: install docs
	$(BIN)/ruff format --check $(SOURCES)
	$(BIN)/ruff check $(SOURCES)
	$(BIN)/pyright --pythonpath $(BIN)/python

format: install
	$(BIN)/ruff format $(SOURCES)
	$(BIN)/ruff check --fix $(SOURCES)

clean:
	rm -rf $(VENV) build dist .pytest_cache .ruff_cache
