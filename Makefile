# `make map` and `make test` set up what they need; both are quick the second time.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

.PHONY: help setup map test check lint types bench clean

help:
	@echo "make map    set up, and build the seabed map of the sample log into out/sample"
	@echo "make test   set up, and run the tests"
	@echo "make check  lint and types"
	@echo "make bench  the figures of merit on the independent dives beside this checkout"

setup: $(READY)

$(READY): pyproject.toml tools/setup.sh
	@PYTHON=$(PYTHON) sh tools/setup.sh $(VENV)
	@touch $(READY)

map: setup
	@$(BIN)/garbi map logs/sample.mcap -o out/sample
	@echo
	@echo "Look at:"
	@echo "  out/sample/report.html     what was read, left out and reached"
	@echo "  out/sample/hillshade.png   the seabed from above"
	@echo "  out/sample/map.rrd         everything, in Rerun: $(BIN)/garbi view out/sample"

test: setup
	@$(BIN)/python -m pytest -q -n 2 --dist loadfile

check: lint types

lint: setup
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .

types: setup
	@$(BIN)/mypy

bench: setup
	@$(BIN)/python -m tools.bench.map
	@$(BIN)/python -m tools.bench.drift --keep out/bench

clean:
	rm -rf $(VENV) out build *.egg-info
