# `make train` and `make test` set everything up themselves, in .venv.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: train test lint smoke clean

train: .venv/installed
	$(BIN)/python train.py $(ARGS)

test: .venv/installed
	$(BIN)/python -m pytest -q

lint: .venv/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

smoke: .venv/installed
	rm -rf runs/smoke
	$(BIN)/python train.py --preset smoke --out runs/smoke

.venv/installed: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable ".[dev]"
	touch $@

clean:
	rm -rf .venv runs
