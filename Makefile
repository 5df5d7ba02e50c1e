# `make run` and `make test` need python3 (3.11 or newer) and make, nothing else.
# Each sets up .venv by itself; where packages come from is pip's own configuration on the machine.
SHELL := /bin/bash
.ONESHELL:
.SHELLFLAGS := -eu -o pipefail -c
.NOTPARALLEL:
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help
.PHONY: help run test test-long docs fuzz bench campaign campaign-beds lock wheels clean figures explore

PYTHON ?= python3
WORKERS ?= 2
BIN := .venv/bin
# Of the lock what a target needs. Wheels only and by hash: no compiler is called, and what the lock does not name is refused.
PIP := $(BIN)/python -m pip --disable-pip-version-check
INSTALL := $(PIP) install --no-compile --quiet --only-binary :all: --require-hashes --constraint requirements.lock
# The backend is in the lock: no build isolation.
PROJECT := $(PIP) install --quiet --no-deps --no-build-isolation --no-index --editable .

# One thread a process, so that two workers fit two cores; figures without a display.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
export MPLBACKEND ?= Agg
# A match shares its work among all cores.
run explore: OMP_NUM_THREADS := $(or $(shell nproc 2>/dev/null),1)
export PYTHONNOUSERSITE := 1
# Nothing of the caller's Python; bytecode is written, or every process that a test starts compiles all libraries again.
unexport PYTHONPATH PYTHONHOME VIRTUAL_ENV PYTHONDONTWRITEBYTECODE

help:  ## this list
	@sed -n 's/^\([a-z-]*\):.*## /make \1\t/p' Makefile

run: .venv/run.stamp  ## set up, then match the reference rig to its vehicle; the report is out/road_to_rig/report.html
	$(BIN)/rigmatch match examples/road_to_rig/observer.toml --out out/road_to_rig

explore: .venv/explore.stamp  ## set up, then open the reference case in the browser
	$(BIN)/rigmatch explore examples/road_to_rig/case.toml

test: .venv/test.stamp  ## set up, then lint, types and the tests that take seconds
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	# types beside the tests, which begin on one core
	$(BIN)/mypy & types=$$!
	trap 'kill $$types 2>/dev/null || :' EXIT
	$(BIN)/python -m pytest -q -n $(WORKERS) --dist worksteal
	wait $$types

test-long: .venv/test.stamp  ## set up, then the tests that take a quarter of a minute or more each
	$(BIN)/python -m pytest -q -n $(WORKERS) --dist worksteal -m long --timeout 1800 -o faulthandler_timeout=1860 \
		|| [ $$? = 5 ]  # 5: there is none

docs: .venv/test.stamp  ## set up, then build the documentation site, out/docs/index.html
	$(BIN)/python -m sphinx -q -W --keep-going -b html -d out/.doctrees docs out/docs

fuzz: .venv/test.stamp  ## set up, then try 100 000 changed inputs of every kind; goes on where it was stopped
	$(BIN)/python -m tests.fuzz --workers $(WORKERS) $(FUZZ)

bench: .venv/bench.stamp  ## set up, then time rigmatch against its peers
	$(BIN)/python -m tests.benchmarks

campaign: .venv/test.stamp  ## set up, then make, diagnose and score 300 recordings with known causes
	$(BIN)/python -m tests.campaign make out/campaign
	$(BIN)/python -m tests.campaign run out/campaign
	$(BIN)/python -m tests.campaign table out/campaign

campaign-beds: .venv/test.stamp  ## set up, then the campaign of beds: drawn beds from first model to verified match
	$(BIN)/python -m tests.campaign.beds

figures: .venv/test.stamp  ## set up, then make the generated files of this repository anew (half an hour)
	$(BIN)/python docs/figures.py $(FIGURES)

lock: .venv/pip.stamp  ## write requirements.lock anew: the newest versions that all groups agree on, for every system and Python
	$(PIP) install --quiet uv
	$(BIN)/uv pip compile pyproject.toml --extra explore --group build --group test --group bench --universal \
		--python-version 3.11 --fork-strategy fewest --generate-hashes --only-binary :all: --no-emit-index-url \
		--no-annotate --custom-compile-command "make lock" --quiet --upgrade --output-file requirements.lock

wheels: .venv/pip.stamp  ## download what running needs, for the Containerfile
	$(BIN)/python -c 'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["dependencies"], sep="\n")' \
		| $(PIP) download --quiet --only-binary :all: --require-hashes --constraint requirements.lock --group build \
			--requirement /dev/stdin --dest wheels

clean:  ## remove the environment and everything made
	rm -rf .venv out build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# Debian's python3 makes environments but has no ensurepip, so pip comes from the wheel shipped here, everywhere.
.venv/pip.stamp: $(wildcard .ci/bootstrap/pip-*.whl)
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "rigmatch needs Python 3.11 or newer, this is " + sys.version.split()[0])'
	@echo "setting up .venv"
	$(PYTHON) -m venv --clear --without-pip .venv
	$(BIN)/python $</pip --disable-pip-version-check install --quiet --no-index $<
	touch $@

.venv/run.stamp: NEEDS := rigmatch
.venv/explore.stamp: NEEDS := "rigmatch[explore]"
.venv/test.stamp: NEEDS := rigmatch --group test
.venv/bench.stamp: NEEDS := rigmatch --group bench
.venv/run.stamp .venv/explore.stamp .venv/test.stamp .venv/bench.stamp: requirements.lock pyproject.toml .venv/pip.stamp
	@echo "installing $(NEEDS)"
	$(INSTALL) --group build
	$(PROJECT)
	$(INSTALL) $(NEEDS)
	touch $@
