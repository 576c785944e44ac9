# SPDX-License-Identifier: Apache-2.0
# `make report` sets up from nothing and judges the recordings; `make test` sets up from nothing
# and passes the tests. Both need Python 3.11, a C++ compiler and make, and nothing else.

VENV := .venv
BIN := $(VENV)/bin
PYTHON ?= python3

# Recordings that other people made, for the tests that try estimators and decoders on them.
export HIL_DATA ?= $(wildcard ../shared/data)

.PHONY: help report test lint unit replay sim clean

help:
	@echo "make report   set up, judge the recordings, write build/report/index.html"
	@echo "make test     set up, run every check; with a Zephyr workspace also build and run the firmware"
	@echo "make lint     ruff, mypy, generated files"
	@echo "make sim      build the firmware and run the suite live on the simulated radio"
	@echo "make clean    remove what the build made"

CORE := $(wildcard hil/core/CMakeLists.txt hil/core/*.?pp firmware/lib/estimator/*.?pp \
  firmware/lib/calib/*.?pp)

$(VENV)/ready: pyproject.toml ci/debian-packages ci/packages.txt $(CORE)
	bash ci/debian-packages base
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[build,dev]'
	touch $@

report: $(VENV)/ready
	$(BIN)/hil report fixtures/recordings/* --output build/report

test: lint unit replay sim

lint: $(VENV)/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python -m hil.wire.cgen --check
	$(BIN)/python -m hil.report.format_page --check

unit: $(VENV)/ready
	bash ci/debian-packages test
	$(BIN)/pytest tests/unit -n 2 --dist loadfile

replay: $(VENV)/ready
	$(BIN)/python -m hil.expected --check
	$(BIN)/pytest tests/hil --hil-report build/replay

sim: $(VENV)/ready
	bash ci/sim

clean:
	rm -rf build
