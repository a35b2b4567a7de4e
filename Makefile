# The two commands that everyone needs: `make up` and `make test`. Both set up what is missing first.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
DEV := $(VENV)/.dev
PIP_LOUD := $(BIN)/python -W ignore -m pip install --disable-pip-version-check -c constraints.txt
PIP_INSTALL := $(PIP_LOUD) -q
PACKAGES := shared services/edge services/learner services/robot services/robot_sim services/tasks services/dashboard deploy/certificates bpn
SOURCES := $(PACKAGES:%=%/bpn*)

.DEFAULT_GOAL := help
.PHONY: $(shell sed -n 's/^\([a-z-]*\):.*\#\#.*/\1/p' $(firstword $(MAKEFILE_LIST)))

help:            ## this list
	@grep -hE '^[a-z-]+: .*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 20

up: $(INSTALLED) ## install what it needs, start the dashboard and workers, with a first run
	$(BIN)/bpn up --first-run reaching

dev: $(DEV)      ## install what tests, benchmarks and figures need beside
	@true

# More of them: make check QUICK="tests/unit tests/contract"
QUICK ?= tests/unit/shared tests/unit/edge tests/unit/tasks --ignore=tests/unit/edge/test_kernel_exactness.py --ignore=tests/unit/edge/test_c_library.py

check: $(DEV)    ## the inner loop, under a minute on an idle machine: ruff, import-linter, unit tests of what all share
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-logo
	$(BIN)/pytest -q --no-header -x -n $(BESIDE) $(QUICK)

# Whole files beside each other, in the order in which they stand: those that take minutes come first.
BESIDE ?= 2

test: lint       ## lint, then every test, two files beside each other (BESIDE=N), then those of browser and Prometheus
	[ "$$(id -u)" != 0 ] || sh deploy/check-system.sh $(PYTHON) network
	$(BIN)/pytest tests --ignore=tests/browser --ignore=tests/observability -n $(BESIDE) --dist loadfile --no-loadscope-reorder
	$(MAKE) test-browser test-observability

test-sanitized: $(DEV) ## both C++ kernels under the address and undefined-behaviour sanitizers (minutes)
	tests/sanitize.sh $(BIN)/python

INPUTS ?= 1000000
SEED ?= $(shell date +%s)

fuzz: $(DEV) ## a million changed inputs for whatever reads bytes from elsewhere; SEED=N repeats
	@echo "SEED=$(SEED) INPUTS=$(INPUTS)"
	BPN_FUZZ_SEED=$(SEED) BPN_FUZZ_INPUTS=$(INPUTS) $(BIN)/pytest -q tests/security/test_decoders.py

test-browser: $(DEV) ## the web UI in Chromium: journeys, accessibility, nothing leaves the machine
	sh deploy/check-system.sh $(PYTHON) browser
	$(BIN)/pytest tests/browser

test-observability: $(DEV) ## the alert rules by Prometheus's checker, and a real Prometheus that sees real trouble (a minute)
	sh deploy/check-system.sh $(PYTHON) observability
	$(BIN)/pytest tests/observability

# What few need has an environment of its own, which sees ours: $(call beside,ENVIRONMENT,PACKAGES)
define beside
	$(PYTHON) -m venv $(1)
	$(1)/bin/python -m pip install --disable-pip-version-check -q -c constraints.txt $(2)
	here=$$($(BIN)/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))') && \
	there=$$($(1)/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))') && \
	echo "import site; site.addsitedir('$$here')" >$$there/zz_bpn.pth
	touch $@
endef

# Not ours to pin in constraints.txt.
ENVIRONMENTS := $(VENV)/environments
$(ENVIRONMENTS)/.installed: $(DEV)
	$(call beside,$(ENVIRONMENTS),minigrid==3.2.0 ale-py==0.12.1 MinAtar==1.0.15 highway-env==1.12.1 flappy-bird-gymnasium==0.4.0)

test-environments: $(ENVIRONMENTS)/.installed ## one iteration of Gymnasium environments of five other packages (downloads them)
	BPN_ENVIRONMENTS=$(ENVIRONMENTS)/bin/python $(BIN)/pytest tests/environments

# Without what it asks for, which ours has.
$(ENVIRONMENTS)/.baselines: $(ENVIRONMENTS)/.installed
	$(ENVIRONMENTS)/bin/python -m pip install --disable-pip-version-check -q --no-deps stable-baselines3==2.9.2
	touch $@

# Some of it: make bench-gym GYM="--tasks catch,minigrid --seeds 0,1"
GYM ?=

bench-gym: $(ENVIRONMENTS)/.baselines ## the gym: preset beside Stable-Baselines3's DQN on six environments, five seeds (hours; goes on where it was)
	$(ENVIRONMENTS)/bin/python -m bench.gym_recipe $(GYM)

# As the extras wandb and mlflow of bpn-learner.
TRACKERS := $(VENV)/trackers
$(TRACKERS)/.installed: $(DEV)
	$(call beside,$(TRACKERS),wandb mlflow-skinny sqlalchemy alembic)

test-trackers: $(TRACKERS)/.installed ## the callbacks that write to Weights & Biases and MLflow, with both, offline (downloads them)
	BPN_TRACKERS=1 $(TRACKERS)/bin/python -m pytest tests/trackers

screenshots: $(DEV) ## the pictures of the web UI in docs/dashboard, and how long a newcomer waits for them
	sh deploy/check-system.sh $(PYTHON) browser
	$(BIN)/python docs/dashboard/screenshots.py

images:          ## build the images, which know version and commit
	BPN_COMMIT=$$(git describe --always --dirty --abbrev=40 --exclude='*' || true) docker compose build

# Its pins contradict ours, so it has an environment of its own.
CHECKOV := 3.3.30
$(VENV)/checkov-$(CHECKOV)/bin/checkov:
	$(PYTHON) -m venv $(VENV)/checkov-$(CHECKOV)
	$(VENV)/checkov-$(CHECKOV)/bin/pip install --disable-pip-version-check -q checkov==$(CHECKOV)

# Left out: 15 and 43, which want every image fetched again at each start and named by digest: yours are where you put them.
check-manifests: $(VENV)/checkov-$(CHECKOV)/bin/checkov ## Kubernetes' manifests, as kubectl renders them, against checkov's policies
	@command -v kubectl >/dev/null || { echo 'check-manifests needs kubectl 1.21 or newer, which renders them: install it first' >&2; exit 1; }
	kubectl kustomize deploy/kubernetes >$(VENV)/manifests.yaml
	$< --framework kubernetes --file $(VENV)/manifests.yaml --skip-check CKV_K8S_15,CKV_K8S_43 \
	  --skip-download --compact --quiet

test-weights: $(DEV) ## the weights of every task and algorithm, as they always were (minutes)
	BPN_ALL_WEIGHTS=1 $(BIN)/pytest tests/integration/test_golden_weights.py

test-machines: $(DEV) ## two sites with routers and networks of their own, in namespaces (root, two minutes)
	sh deploy/check-system.sh $(PYTHON) network
	BPN_MACHINES=1 $(BIN)/pytest -s tests/machines

test-containers: $(DEV) ## build the images, run the whole loop in containers (any Docker Engine from 25 on)
	sh deploy/check-system.sh $(PYTHON) observability
	BPN_CONTAINERS=1 $(BIN)/pytest tests/containers

test-chaos: $(DEV) ## every fault that containers may have in the middle of a run (about half an hour), and to a run's files
	BPN_CHAOS=1 $(BIN)/pytest tests/chaos/test_flip_anything.py tests/chaos/test_cut_off.py
	BPN_CONTAINERS=1 BPN_CHAOS=1 $(BIN)/pytest -s tests/containers/test_chaos.py tests/containers/test_full_disk.py

test-fresh-machine: ## the README's two commands in a bare container, as root and as a normal user (half an hour; any Docker Engine)
	deploy/fresh-machine.sh

# yosys, if the system has none, comes from PyPI.
test-rtl: $(DEV) ## the core's long suites: networks, swaps and gaps by the hundred, its buses with cocotb, proofs, coverage, 300 mutants of the RTL (hours; the mutants go on where they were)
	$(PIP_LOUD) --no-build-isolation -e 'bpn[fpga]' -e 'services/edge[rtl]' cocotb
	BPN_RTL_SCALE=25 $(BIN)/pytest tests/rtl tests/rtl/protocol/buses.py
	$(BIN)/python services/edge/rtl/formal/prove.py
	$(BIN)/python -m tests.rtl.coverage --out build/rtl-coverage.json
	$(BIN)/python -m tests.rtl.mutation --sample 300

mutants: $(DEV) ## how many faults the tests notice, sampled and aimed ones (hours; goes on where it was; MUTANTS="--sample N --seed S")
	$(BIN)/python -m tests.mutants $(MUTANTS)

# The template of exported C is no C before it is filled in.
NATIVE = $(shell git ls-files '*.c' '*.cpp' '*.h' ':!bpn/bpn/export/policy.c')

lint: $(DEV) check-claims ## ruff, mypy --strict, import-linter, clang-format; prettier, svelte-check and vitest for the web UI; check-claims
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/clang-format --dry-run -Werror $(NATIVE)
	$(BIN)/mypy -p bpn_shared -p bpn_edge -p bpn_learner -p bpn_robot -p bpn_robot_sim -p bpn_tasks -p bpn_dashboard -p bpn_certificates -p bpn
	$(BIN)/mypy bench checks docs/dashboard/screenshots.py docs/learning_picture.py
	$(BIN)/lint-imports --no-logo
	$(BIN)/python services/dashboard/hatch_build.py types check test

check-claims: $(DEV) ## figures in the pages against the results that they are from, links and anchors against what is there
	$(BIN)/python -m checks

# Of those with compiled code, wheels are built for these; PYTHONS="python3.11 python3.12" makes them for all from 3.11 on.
PYTHONS ?= $(PYTHON)
BUILDER := $(VENV)/build
$(BUILDER)/.installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(BUILDER)
	$(BUILDER)/bin/python -m pip install --disable-pip-version-check -q -c constraints.txt pip
	$(BUILDER)/bin/python -m pip install --disable-pip-version-check -q -c constraints.txt --group dist
	touch $@

dist: $(BUILDER)/.installed ## source distributions and wheels of everything into dist/, the web UI built
	sh deploy/check-system.sh $(PYTHON)
	deploy/dist.sh $(BUILDER)/bin/python $(filter-out $(PYTHON),$(PYTHONS))

test-dist: dist $(DEV) ## the wheels in clean environments of all PYTHONS, without compiler and Node: `bpn up` in an empty folder
	BPN_PYTHONS="$(PYTHONS)" $(BIN)/pytest tests/packages

# Its packages are none of ours, and read the sources without importing them.
DOCS := $(VENV)/docs
$(DOCS)/.installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(DOCS)
	$(DOCS)/bin/python -m pip install --disable-pip-version-check -q -c constraints.txt pip
	$(DOCS)/bin/python -m pip install --disable-pip-version-check -q -c constraints.txt --group docs
	touch $@

docs: $(DOCS)/.installed ## the docs site into site/, searchable offline; a warning is an error
	NO_MKDOCS_2_WARNING=1 $(DOCS)/bin/mkdocs build --strict --quiet

test-cross: $(DEV) ## kernels and exported C on aarch64 and armv7: cross-compiled, run in qemu (downloads 500 MB of compilers)
	sh deploy/check-system.sh $(PYTHON) cross
	BPN_CROSS=1 $(BIN)/pytest tests/cross

coverage: $(DEV) ## which lines unit and contract tests run, in htmlcov/
	$(BIN)/coverage run -m pytest -q tests/unit tests/contract
	$(BIN)/coverage html -q
	$(BIN)/coverage report

version:         ## write the version of shared/pyproject.toml wherever it is repeated
	$(PYTHON) -m checks.versions

format: $(DEV) ## write code as ruff, clang-format and prettier want it
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/clang-format -i $(NATIVE)
	$(BIN)/python services/dashboard/hatch_build.py format

bench: $(DEV) ## kernel, learner, loop and dashboard, side by side with what they are measured against
	$(BIN)/bpn bench kernel
	$(BIN)/bpn bench learner
	$(BIN)/bpn bench loop
	$(BIN)/bpn bench dashboard

bench-sweep: $(DEV) ## a sweep with one learner and with two, in containers (any Docker Engine)
	PYTHONPATH=tests/support $(BIN)/python bench/sweep.py

additivity: $(DEV) ## the table of docs/factored-actions.md, by dynamic programming
	$(BIN)/python -m bpn_robot_sim.reaching.additivity

TARGETS := inference averaging reaching latency tracking pan-tilt heatmap
JOBS ?= 1

reproduce: $(DEV) ## every figure and table of the paper into docs/results: days on two cores, resumable
	for target in $(TARGETS); do $(BIN)/bpn reproduce $$target --jobs $(JOBS) || exit; done

reproduce-quick: $(DEV) ## a tiny version of the same, to see that everything works
	for target in $(TARGETS); do $(BIN)/bpn reproduce $$target --jobs $(JOBS) --quick || exit; done

doctor: $(INSTALLED) ## what this machine has, for bug reports
	$(BIN)/bpn doctor

clean:           ## remove what `make` installed and built; runs stay
	rm -rf $(VENV) dist site htmlcov services/dashboard/web/node_modules services/dashboard/bpn_dashboard/static services/*/build services/edge/bpn_edge/kernel/*.so services/learner/bpn_learner/*.so

# The compiled kernels and the web UI are part of the editable installs, so their sources are among the prerequisites.
$(INSTALLED): constraints.txt pyproject.toml $(PACKAGES:%=%/pyproject.toml) \
              $(foreach s,edge learner,services/$(s)/CMakeLists.txt $(wildcard services/$(s)/src/*)) \
              services/dashboard/hatch_build.py $(shell find services/dashboard/web -type f -not -path '*/node_modules/*' -not -path '*/generated/*')
	sh deploy/check-system.sh $(PYTHON)
	$(PYTHON) -m venv $(VENV)
	@echo 'bpn, 1 of 2: build tools (CMake, Ninja, Node) into $(VENV), 100 MB'
	$(PIP_INSTALL) pip
	$(PIP_INSTALL) --group build
	@echo 'bpn, 2 of 2: torch, MuJoCo and the others, 420 MB where torch is for CPUs alone; then kernels and web UI are built'
	$(PIP_LOUD) --no-build-isolation $(PACKAGES:%=-e %)
	touch $@

$(DEV): $(INSTALLED)
	@echo 'bpn: what tests, benchmarks and figures need, 300 MB'
	$(PIP_LOUD) --group dev --no-build-isolation $(PACKAGES:%=-e %) -e 'bpn[bench,data,media]' \
	  -e 'services/robot_sim[gym]' -e 'services/learner[tensorboard]' -e 'services/edge[rtl]'
	touch $@
