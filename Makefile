# Each verb sets up what it needs on first use; `make help` lists them.
PYTHON ?= python3
VENV ?= .venv
# A bag is a folder as `gip simulate` writes it, with its map.yaml and params.yaml.
BAG ?= $(patsubst %/metadata.yaml,%,$(firstword $(wildcard bags/*/metadata.yaml)))
GIP = $(VENV)/bin/gip
# How many processes test: three for two cores, because tests of nodes mostly wait.
WORKERS ?= $(shell cores=$$(nproc 2>/dev/null || echo 2); echo $$((cores * 3 / 2)))
PYTEST = $(VENV)/bin/python -m pytest --numprocesses $(WORKERS) --dist worksteal
# Tests of what has a compiled loop and a way without it.
LOOPS = kernel_compiled kernel_correlation kernel_pyramid kernel_support matching refinement levels \
  birdseye footprints known_poses
READY = $(VENV)/.ready
# Results of `make` verbs are replaced by the next run; a folder of your own is not.
RESULTS = --out $(or $(OUT),results/$@) $(if $(OUT),,--force)

.DEFAULT_GOAL := help
.PHONY: help setup demo replay evaluate bench paper params figures fit-confidence fit-protection error-level sensitivity test docs lint type pytest numpy fuzz soak clean

help: ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /  make \1\t/' | expand -t 24

setup: $(READY) ## set up the environment only

$(READY): setup.py $(wildcard gip_localizer/core/kernels/*)
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 14))' || { \
	  echo 'gip_localizer needs CPython 3.10 to 3.14 (ROS wheels exist for these);' \
	    '$(PYTHON) is' "$$($(PYTHON) --version 2>&1). Name another: make PYTHON=python3.12 ..."; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || { \
	  echo '$(PYTHON) has no venv module. On Debian and Ubuntu: apt install python3-venv'; exit 1; }
	@extras=ros,test; \
	  if $(PYTHON) -c 'import rclpy' 2>/dev/null; then extras=test; fi; \
	  echo "Setting up $(VENV) with [$$extras] (once; one to three minutes) ..."; \
	  $(PYTHON) -m venv $(VENV) && \
	  $(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --editable ".[$$extras]"
	@touch $@

demo: $(READY) ## camera, node and observer over DDS (WORLD= RATE= SECONDS= METRIC= OUT=)
	@$(GIP) demo $(RESULTS) $(if $(WORLD),--world $(WORLD)) $(if $(RATE),--rate $(RATE)) \
	  $(if $(SECONDS),--seconds $(SECONDS)) $(if $(METRIC),--metric $(METRIC))

replay: $(READY) ## localize a recorded bag (BAG= METRIC= OUT=)
	@test -n '$(BAG)' || { echo 'no bag below bags/; name one: make replay BAG=path'; exit 1; }
	@$(GIP) replay $(BAG) $(if $(wildcard $(BAG)/params.yaml),--params $(BAG)/params.yaml) $(RESULTS) $(if $(METRIC),--metric $(METRIC))

evaluate: $(READY) ## accuracy and integrity, compared with bounds, under 10 minutes (SUITE= FRAMES= SEED= OUT=)
	@$(GIP) evaluate $(RESULTS) $(if $(SUITE),--suite $(SUITE)) $(if $(FRAMES),--frames $(FRAMES)) \
	  $(if $(SEED),--seed $(SEED))

paper: $(READY) ## reproduce the numbers and figures of the paper (OUT=)
	@$(GIP) paper $(RESULTS)

bench: $(READY) ## speed compared with OpenCV; stop other programs (SUITE= QUICK= OUT=)
	@$(GIP) bench $(if $(SUITE),--suite $(SUITE)) $(if $(QUICK),--quick) $(RESULTS)

params: $(READY) ## write config/*.yaml, docs/parameters.md and docs/diagnostics.md again
	@$(GIP) params --write .

figures: $(READY) ## draw the README's picture again
	@$(VENV)/bin/python -m gip_localizer.visualization.overview_figure bags/demo docs/figures/overview.png

fit-confidence: $(READY) ## fit the confidence of a match again (TRIALS=new: make its trials first, 15 minutes)
	@$(VENV)/bin/python -m gip_localizer.evaluation.confidence --write $(if $(TRIALS),--trials)

fit-protection: $(READY) ## fit the tails of the protection level again (10 minutes)
	@$(VENV)/bin/python -m gip_localizer.evaluation.protection_fit

error-level: $(READY) ## consistency of the covariances for settings of the error level (10 minutes)
	@$(VENV)/bin/python -m gip_localizer.evaluation.error_level_study

sensitivity: $(READY) ## write docs/constants.md: the effect of each constant of matching (10 minutes)
	@$(VENV)/bin/python -m gip_localizer.evaluation.sensitivity

docs: $(READY) ## the documents as a site: results/site
	@$(VENV)/bin/mkdocs build --strict --quiet && echo 'site: results/site/index.html'

test: lint ## all checks; mypy runs in parallel with the tests
	@$(MAKE) --no-print-directory --jobs=2 type pytest

lint: $(READY) ## ruff
	@$(VENV)/bin/ruff check .

type: $(READY) ## mypy
	@$(VENV)/bin/mypy

pytest: $(READY) ## only the tests, in parallel (WORKERS=)
	@$(PYTEST) --durations=15

numpy: $(READY) ## the core's tests without the compiled loops
	@GIP_COMPILED=0 $(PYTEST) $(LOOPS:%=test/test_%.py)

fuzz: $(READY) ## mutated messages and files of every kind (MANY=10000 of each; over an hour)
	@GIP_FUZZ=$(or $(MANY),10000) $(VENV)/bin/python -m pytest --durations=0 test/test_fuzz_messages.py test/test_fuzz_files.py

soak: $(READY) ## the node with all simulated faults of a vehicle (MINUTES=30)
	@GIP_SOAK=$$(( $(or $(MINUTES),30) * 60 )) $(VENV)/bin/python -m pytest -s test/test_ros_soak.py

clean: ## remove the environment, caches and results
	rm -rf $(VENV) gip_localizer/core/kernels/*.so build install log results *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
