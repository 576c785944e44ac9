# SPDX-License-Identifier: Apache-2.0
# `make report` sets up from nothing and judges the recordings; `make test` sets up from nothing
# and passes the tests. Both need Python 3.11, a C++ compiler and make, and nothing else.

VENV := .venv
BIN := $(VENV)/bin
PYTHON ?= python3

# Recordings that other people made, for the tests that try estimators and decoders on them.
export HIL_DATA ?= $(wildcard ../shared/data)

.PHONY: help report test lint lint-types lint-c lint-style lint-generated lock unit fuzz replay sim bench clean

help:
	@echo "make report   set up, judge the recordings, write build/report/index.html"
	@echo "make test     set up, run every check; with a Zephyr workspace also build and run the firmware"
	@echo "make lint     ruff, mypy, cppcheck, generated files"
	@echo "make lock     renew ci/requirements.lock: the versions and hashes of the Python packages"
	@echo "make fuzz     every fuzz target for a minute; ci/fuzz 600 for ten"
	@echo "make sim      build the firmware and run the suite live on the simulated radio"
	@echo "make bench    how fast it is, beside what a user would take instead: docs/performance.md"
	@echo "make clean    remove what the build made"

CORE := $(wildcard hil/core/CMakeLists.txt hil/core/*.?pp hil/wire/native/*.?pp firmware/lib/estimator/*.?pp \
  firmware/lib/calib/*.?pp)

PIP := $(BIN)/python -m pip --quiet --disable-pip-version-check

# Every package is one of the lock, byte for byte; hil itself is built with those too.
# --no-compile: most modules are never imported, and the others are compiled when they first are.
$(VENV)/ready: pyproject.toml ci/requirements.lock ci/debian-packages ci/packages.txt $(CORE)
	bash ci/debian-packages base
	$(PYTHON) -m venv $(VENV)
	$(PIP) install --no-compile --require-hashes --requirement ci/requirements.lock
	$(PIP) install --no-deps --no-build-isolation --editable .
	touch $@

lock: $(VENV)/ready
	ci/lock

report: $(VENV)/ready
	$(BIN)/hil report fixtures/recordings/* --output build/report --league fixtures/league.json

test: lint unit fuzz replay sim

# Each part is one processor's work and none needs another's: two at a time.
lint: $(VENV)/ready
	bash ci/debian-packages test
	@$(MAKE) --no-print-directory --keep-going --jobs=2 --output-sync=target \
	  lint-types lint-c lint-style lint-generated

lint-types: $(VENV)/ready
	$(BIN)/mypy

lint-c:
	nice cppcheck --quiet --enable=warning,portability --std=c11 --error-exitcode=1 \
	  --suppressions-list=ci/cppcheck.txt -Ifirmware/lib/wire -ifirmware/tests \
	  firmware/apps firmware/lib firmware/drivers firmware/sim hil/core

lint-style: $(VENV)/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

lint-generated: $(VENV)/ready
	ci/lock --check
	$(BIN)/python -m hil.sbom.page --check
	$(BIN)/python -m hil.wire.cgen --check
	$(BIN)/python -m hil.report.format_page --check

unit: $(VENV)/ready
	bash ci/debian-packages test
	$(BIN)/pytest tests/unit -m "not alone" -n 3 --dist loadfile --no-loadscope-reorder
	$(BIN)/pytest tests/unit -m alone

fuzz: $(VENV)/ready
	bash ci/debian-packages test
	ci/fuzz

replay: $(VENV)/ready
	$(BIN)/python -m hil.expected --check
	$(BIN)/python -m hil.compare.page --check
	$(BIN)/pytest tests/hil --hil-report build/replay

sim: $(VENV)/ready
	bash ci/sim

# The machine should have nothing else to do. -m: benchmarks/ is not part of the package.
bench: $(VENV)/ready
	$(PIP) install "filterpy>=2.0"  # The one peer that the tests do without.
	$(BIN)/python -m benchmarks

clean:
	rm -rf build
