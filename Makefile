# The two commands that everyone needs: `make up` and `make test`. Both set up what is missing first.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
PIP_INSTALL := $(BIN)/python -W ignore -m pip install --disable-pip-version-check -q -c constraints.txt
PACKAGES := shared services/edge services/learner services/robot_sim services/dashboard deploy/local
SOURCES := $(PACKAGES:%=%/bpn*)

.DEFAULT_GOAL := help
.PHONY: help up test test-browser lint format bench learning doctor clean

help:            ## this list
	@grep -hE '^[a-z-]+: .*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 14

up: $(INSTALLED) ## start the dashboard and workers, with a first run
	$(BIN)/bpn up

test: lint       ## lint, then every test that takes seconds, then those that take minutes
	$(BIN)/pytest tests --ignore=tests/browser
	$(MAKE) test-browser

test-browser: $(INSTALLED) ## the web UI in Chromium: journeys, accessibility, nothing leaves the machine
	sh deploy/local/check-system.sh $(PYTHON) browser
	$(BIN)/pytest tests/browser

lint: $(INSTALLED) ## ruff, mypy --strict, import-linter; prettier, svelte-check and vitest for the web UI
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy -p bpn_shared -p bpn_edge -p bpn_learner -p bpn_robot_sim -p bpn_dashboard -p bpn
	$(BIN)/lint-imports --no-logo
	$(BIN)/python services/dashboard/hatch_build.py check test

format: $(INSTALLED) ## write code as ruff wants it
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/python services/dashboard/hatch_build.py format

bench: $(INSTALLED) ## kernel, learner, loop and dashboard, side by side with what they are measured against
	$(BIN)/bpn bench kernel
	$(BIN)/bpn bench learner
	$(BIN)/bpn bench loop
	$(BIN)/bpn bench dashboard

learning: $(INSTALLED) ## the paper's reaching run on three seeds (about 15 minutes), with the plot in docs
	$(BIN)/python bench/learning_curve.py

doctor: $(INSTALLED) ## what this machine has, for bug reports
	$(BIN)/bpn doctor

clean:           ## remove what `make` installed and built; runs stay
	rm -rf $(VENV) services/dashboard/web/node_modules services/dashboard/bpn_dashboard/static services/*/build services/edge/bpn_edge/kernel/*.so services/learner/bpn_learner/*.so

# The compiled kernels and the web UI are part of the editable installs, so their sources are among the prerequisites.
$(INSTALLED): constraints.txt pyproject.toml $(PACKAGES:%=%/pyproject.toml) \
              $(foreach s,edge learner,services/$(s)/CMakeLists.txt $(wildcard services/$(s)/src/*)) \
              services/dashboard/hatch_build.py $(shell find services/dashboard/web -type f -not -path '*/node_modules/*' -not -path '*/generated/*')
	sh deploy/local/check-system.sh $(PYTHON)
	$(PYTHON) -m venv $(VENV)
	$(PIP_INSTALL) pip
	$(PIP_INSTALL) --group build
	$(PIP_INSTALL) --group dev --no-build-isolation $(PACKAGES:%=-e %) -e 'deploy/local[bench]'
	touch $@
