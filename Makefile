# Everything a person types. `make help` lists it.

SHELL := /bin/bash
PYTHON ?= $(shell command -v python3.11 || command -v python3.12 || command -v python3)
BIN := .venv/bin
READY := .venv/.ready
CLUSTERS := build/clusters/bin
# All that the program and its server import: in an environment that tells Python to write nothing, as many containers
# are, it would be compiled with each start, which is five seconds of ten. Prefect makes its folder as it is imported.
COMPILE := import importlib, pkgutil, prefect.server.api.server; [importlib.import_module(module.name) \
	for package in ("dcap", "solver", "tasks", "flows") for module in pkgutil.walk_packages([package], package + ".") \
	if not module.name.endswith("__main__")]
PACKAGES := import sysconfig; print(sysconfig.get_path('purelib'))
DATA := $(or $(DCAP_DATA),data)
OUT ?= $(DATA)/runs/demo
# Two tests at a time; a third would only fight with the kernels' own threads.
PARALLEL := -n 2 --dist worksteal
COUNTED := flows tasks solver dcap/scene dcap/geometry dcap/knowledge dcap/language dcap/evaluation dcap/synthetic tests
# What `make check` runs; `make test` runs this and what is slow or needs third-party data.
FAST := not slow and not long and not sweep and not third_party and not gpu

# A variable counts if it was typed: desktops have LANGUAGE in their environment.
said = $(filter command,$(origin $(1)))
option = $(if $(call said,$(2)),--$(1) "$($(2))")

.DEFAULT_GOAL := help
.PHONY: setup node-tools test test-all types count fast clusters sweep check benchmark paper demo ui worker perf perf-peers docs docs-serve docs-pictures clean help lock system-libraries

help: ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-18s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: $(READY) ## create .venv from the lock file, with dcap and all development tools

# The lock is whole, so pip resolves nothing: a resolver may fall over a release newer than the lock. It compiles
# nothing either, since what is imported is a fifth of it. Type checkers see an editable installation only in the
# compatible mode, which puts the folder itself on the path.
$(READY): requirements.lock pyproject.toml
	@$(MAKE) --no-print-directory system-libraries
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 13))' \
		|| { echo "dcap needs Python 3.11 or 3.12, found $$($(PYTHON) --version 2>&1); run: make setup PYTHON=/path/to/python3.11"; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv \
		|| { rm -rf .venv; echo "cannot create .venv; on Debian: apt-get install python3-venv"; exit 1; }
	$(BIN)/python -m pip install --quiet --no-deps --no-compile --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --config-settings editable_mode=compat --editable .
	$(BIN)/python -m pip --quiet check
	@mkdir -p build
	PYTHONDONTWRITEBYTECODE= PREFECT_HOME=build/prefect $(BIN)/python -c '$(COMPILE)' >/dev/null
	@touch $(READY)

system-libraries: ## install the few system libraries that Open3D loads, or print the command
	@.ci/system-libraries

node-tools: ## install Khronos' glTF validator into build/node, for the tests marked `node`
	npm install --silent --no-audit --no-fund --prefix build/node gltf-validator@2.0.0-dev.3.10

test: $(READY) ## what protects the product; twelve minutes on two cores
	$(BIN)/pytest $(PARALLEL) -m "not long and not sweep"

test-all: $(READY) clusters ## the rest, each test ten seconds or more: long physics, browsers, killed programs, damage
	@if command -v npm >/dev/null; then $(MAKE) --no-print-directory node-tools || echo "no npm registry: tests marked node are skipped"; fi
	$(BIN)/pytest $(PARALLEL) -m "long and not sweep"

clusters: $(READY) ## the tests with clusters of Dask and Ray, which it installs into build/clusters, beside what .venv has
	test -x $(CLUSTERS)/python || $(BIN)/python -m venv build/clusters
	echo "import site; site.addsitedir('$$($(BIN)/python -c "$(PACKAGES)")')" > "$$($(CLUSTERS)/python -c "$(PACKAGES)")/dcap.pth"
	$(CLUSTERS)/python -m pip install --quiet prefect-dask prefect-ray
	$(CLUSTERS)/python -m pytest tests/flows/test_pool.py -k test_a_cluster

sweep: $(READY) ## the long physics tests: whole ranges of mass, stiffness and resolution; hours
	$(BIN)/pytest -m sweep

# Types take one core for three minutes where nothing is known of the libraries yet.
check: $(READY) ## format, lint, types, imports and fast tests
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/lint-imports --no-logo
	@$(MAKE) --no-print-directory count
	@$(MAKE) --no-print-directory --jobs 2 types fast

types: $(READY)
	$(BIN)/mypy

count: ## lines and files of Python per folder, and words of documentation: a report, not a limit
	@for folder in $(COUNTED); do \
		printf '%-16s %7d lines %5d files\n' $$folder $$(find $$folder -name '*.py' -exec cat {} + | wc -l) $$(find $$folder -name '*.py' | wc -l); \
	done
	@printf '%-16s %7d words\n' docs $$(find docs README.md CONTRIBUTING.md -name '*.md' -exec cat {} + | wc -w)

fast: $(READY)
	$(BIN)/pytest $(PARALLEL) -m "$(FAST)"

BENCHMARK = $(call option,dataset,DATASET) $(call option,objects,OBJECTS) $(call option,methods,METHODS) $(call option,language,LANGUAGE) \
	$(call option,model,MODEL) $(call option,judge,JUDGE) $(call option,judge-model,JUDGE_MODEL) $(call option,workers,WORKERS) \
	$(call option,limit,LIMIT) $(call option,sugar,SUGAR)

benchmark: $(READY) ## place the embedded dataset, or DATASET=samples.yaml or DATASET=scenes/ OBJECTS=meshes/; also METHODS, LANGUAGE, MODEL, JUDGE, JUDGE_MODEL, WORKERS, LIMIT
	$(BIN)/dcap benchmark $(BENCHMARK)

paper: $(READY) ## the paper's whole evaluation of the embedded rooms (six samples), or of a DATASET as above; also SUGAR=folder
	$(BIN)/dcap paper $(BENCHMARK)

demo: $(READY) ## one placement: a ball on a bed
	$(BIN)/dcap dataset make
	$(BIN)/dcap place "$(DATA)/rooms/bedroom_01" "$(DATA)/objects/ball.glb" "put the ball at the center of the bed" --out "$(OUT)"

ui: $(READY) ## Prefect's pages over all runs, on http://127.0.0.1:4200
	$(BIN)/dcap ui

worker: $(READY) ## serve the pool of a Prefect server (PREFECT_API_URL, or our own); on any number of machines
	$(BIN)/dcap worker

perf: $(READY) ## measure the parts that take the time
	$(BIN)/python -m perf

perf-peers: $(READY) ## the reference drops beside Genesis, Newton and MuJoCo, if installed (docs/peers.md); half an hour or more
	$(BIN)/python -m perf.peers $(if $(PEERS_PYTHON),--python "$(PEERS_PYTHON)")

# The theme prints an advertisement for its successor at every build otherwise.
docs: $(READY) ## build the documentation site into build/site; a broken link fails
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build

docs-serve: $(READY) ## serve it on http://127.0.0.1:8000, built again at each change
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs serve --dev-addr 127.0.0.1:8000

docs-pictures: $(READY) ## make the pictures of the documentation again, from placements in an embedded room; minutes
	$(BIN)/python docs/make_pictures.py

clean: ## remove what can be computed again and Prefect's history; the results of runs stay
	rm -rf "$(DATA)/cache" build dist .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis *.egg-info
	find . -name __pycache__ -not -path './.venv/*' -prune -exec rm -rf {} +

lock: $(READY) ## renew requirements.lock from pyproject.toml
	$(BIN)/python -m pip install --quiet pip-tools
	echo 'setuptools>=77' | $(BIN)/pip-compile --quiet --generate-hashes --allow-unsafe --strip-extras --extra dev --no-header \
		--no-annotate --no-emit-index-url --no-emit-find-links --no-emit-trusted-host --output-file .lock.tmp pyproject.toml -
	{ head -2 requirements.lock; grep -v '^#' .lock.tmp; } > .lock.new && mv .lock.new requirements.lock && rm .lock.tmp
