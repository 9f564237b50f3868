# `make install` sets everything up, in .venv; the other targets do so themselves.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: train install test test-slow test-study lint smoke docs clean

train: .venv/installed
	$(BIN)/python train.py $(ARGS)

install: .venv/installed

test: .venv/installed
	$(BIN)/python -m pytest -q -n 2 --dist loadfile -m "not slow and not study"

test-slow: .venv/installed
	$(BIN)/python -m pytest -q -n 2 --dist loadfile -m slow

test-study: .venv/installed
	$(BIN)/python -m pytest -q -n 2 --dist loadfile -m study

lint: .venv/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

smoke: .venv/installed
	rm -rf runs/smoke
	$(BIN)/python train.py --preset smoke --out runs/smoke

docs: .venv/installed
	$(BIN)/python -m docs.generate
	$(BIN)/python -m benchmarks.tables

.venv/installed: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable ".[dev]"
	touch $@

clean:
	rm -rf .venv runs
