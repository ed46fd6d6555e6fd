# make install | make wheels | make demo | make demo-policy | make bench-mini | make test-fast | make test | make lint | make docs
ifeq ($(OS),Windows_NT)
$(error make needs bash and .venv/bin, which Windows has not: docs/install.md says what to type there instead)
endif
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Python compiles what it imports, a quarter of all that is installed
PIP := $(BIN)/pip --disable-pip-version-check install --quiet --no-compile --constraint constraints.txt

# packages of plugins/ that are tested beside the core, in one environment
PACKAGES := arrays bench datasets depth episodes export inspect labels lerobot live markers policies published rosbags sim

.PHONY: install wheels demo demo-policy bench-mini test tests test-fast lint style types docs clean

# fine-tunes the zoo's weights; from random weights, twice as long: make demo SCALE=demo
SCALE ?= finetune
START := $(if $(filter finetune,$(SCALE)),init=anytouch2.tiny,"objective=[pixel,diff,align,match,force,surface]")
# one unit of each sensor: forty touches are too few to tell a soft gel from a strong push; validation is on three
# indenters that this training has not
demo: $(VENV)/.installed
	rm -rf runs/demo
	$(BIN)/tactileforge train scale=$(SCALE) $(START) data.randomise=none data.indenters=bench hydra.run.dir=runs/demo
	@echo "open runs/demo/report.html"

# the core and all packages of plugins/ into .venv, but the camera of LeRobot, which needs LeRobot
install: $(VENV)/.installed-all

# all wheels into dist/, built and checked
wheels: $(VENV)/.installed-dev
	$(BIN)/python scripts/wheels.py dist

# a scripted expert, a policy on a frozen touch encoder that imitates it, and its rollouts; another task: TASK=wipe
TASK ?= chip
demo-policy: $(VENV)/.installed-policies
	rm -rf runs/demo-policy
	$(BIN)/tactileforge demos task=$(TASK) n=40 out=runs/demo-policy/demonstrations
	$(BIN)/tactileforge train recipe=imitation scale=tiny data=demonstrations data.image_size=32 \
	  data.root=runs/demo-policy/demonstrations hydra.run.dir=runs/demo-policy/policy
	$(BIN)/tactileforge rollout task=$(TASK) policy=runs/demo-policy/policy n=20 out=runs/demo-policy/rollouts
	@echo "open runs/demo-policy/rollouts/report.html"

# the paper in miniature; TACTILEFORGE_REALDATA is the folder of the public samples, where they are at hand
bench-mini: $(VENV)/.installed-bench
	$(BIN)/tactileforge bench "suite=[sim,public_samples]" pretrain=miniature out=runs/bench-mini
	@echo "open runs/bench-mini/report.html"

# while writing: nothing that builds a wheel, installs by pip, trains for long or runs the docs; of the core, or of a
# package: make test-fast IN=plugins/tactileforge-sim
IN ?= tests
test-fast: $(VENV)/.installed-dev
	$(BIN)/pytest $(IN) -n 3 --dist worksteal -m "not slow"

# types are checked beside the tests: mypy has one thread, and pytest starts with one
test: style
	$(MAKE) --jobs=2 types tests

# worksteal: a file with many long tests, as the commands of the docs, does not hang on one worker
tests: $(VENV)/.installed-dev
	$(BIN)/pytest -n 3 --dist worksteal

lint: style types

style: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.installed-dev
	$(BIN)/mypy

docs: $(VENV)/.installed-dev
	$(BIN)/mkdocs build --strict

# torch first: its version is pinned, so that no other package chooses a build
$(VENV)/.installed: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(PIP) torch
	$(PIP) --editable . $(foreach name,depth markers sim bench live,--editable plugins/tactileforge-$(name))
	touch $@

$(VENV)/.installed-bench: $(VENV)/.installed
	$(PIP) --editable plugins/tactileforge-datasets
	touch $@

$(VENV)/.installed-policies: $(VENV)/.installed
	$(PIP) --editable plugins/tactileforge-policies
	touch $@

$(VENV)/.installed-dev: $(VENV)/.installed
	$(PIP) --editable '.[dev]' $(foreach name,$(PACKAGES),--editable plugins/tactileforge-$(name))
	touch $@

$(VENV)/.installed-all: $(VENV)/.installed
	$(PIP) --editable . $(foreach path,$(wildcard plugins/tactileforge-*),$(if $(findstring example,$(path)),,--editable $(path)))
	touch $@

clean:
	rm -rf $(VENV) build dist site runs *.egg-info src/*.egg-info
