# Everything runs in .venv, made on first use from the hashed pins in requirements/ (see README.md there).
#
#   PYTHON=...   the interpreter that makes .venv (default: the first of python3, python3.14 ... that is new enough)
#   ARGS=...     passed on to `sagnac demo`, pytest or benchmarks/run.py
#   DEPS=...     pinned (default), lowest or latest: which versions go into .venv; CI tries all three

DEPS ?= pinned
ARGS ?=
UV ?= uv
PINS ?=

ifeq ($(origin PYTHON),undefined)
PYTHONS := python3 python3.14 python3.13 python3.12 python3.11 python
else
PYTHONS := "$(PYTHON)"
endif

VENV := .venv
PY := $(VENV)/bin/python
# Paths stay relative: the checkout may lie in a folder with spaces in its name.

.PHONY: help demo test bench lint types layers docs check clean pins
.NOTPARALLEL:
.DELETE_ON_ERROR:

help:  ## list the targets
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/  make \1	\2/p' Makefile

demo: $(VENV)/.package  ## install what is needed and run `sagnac demo`
	@$(VENV)/bin/sagnac demo $(ARGS)

test: $(VENV)/.dev  ## run the tests
	@OPENBLAS_NUM_THREADS=1 $(PY) -m pytest -n auto --dist worksteal $(ARGS)

bench: $(VENV)/.dev  ## run the benchmarks
	@$(PY) benchmarks/run.py $(ARGS)

lint: $(VENV)/.dev  ## ruff
	@$(PY) -m ruff check .

types: $(VENV)/.dev  ## mypy, strict
	@$(PY) -m mypy

layers: $(VENV)/.dev  ## which module may import which
	@$(VENV)/bin/lint-imports --no-cache --no-logo

docs: $(VENV)/.docs  ## build the documentation into docs/_build/html
	@$(PY) -m sphinx -W --keep-going -q -b html docs docs/_build/html
	@echo "docs: docs/_build/html/index.html"

check: lint types layers docs test  ## all of lint, types, layers, docs and test

clean:  ## remove all that was built, .venv too
	rm -rf $(VENV) build dist docs/_build .pytest_cache .ruff_cache .mypy_cache .hypothesis .import_linter_cache
	find src tests benchmarks docs -name __pycache__ -type d -prune -exec rm -rf {} + 2>/dev/null || true

# ---- pins: uv is the only tool needed; it asks the ordinary index, whatever this machine's settings say

PIN := env -u UV_INDEX -u UV_DEFAULT_INDEX -u UV_INDEX_URL -u UV_EXTRA_INDEX_URL -u UV_FIND_LINKS \
	$(UV) pip compile -q --no-config --universal --python-version 3.11 --fork-strategy fewest \
	--generate-hashes --no-header $(PINS) pyproject.toml requirements/build.in

# what users add by themselves, pip install 'sagnac[pdf]', is all there where the demo and the tests run
EXTRAS := --extra cluster --extra matlab --extra pdf --extra registry

pins:  ## write requirements/*.txt anew from pyproject.toml (needs uv)
	$(PIN) $(EXTRAS) --extra dev --extra docs -o requirements/docs.txt
	$(PIN) $(EXTRAS) --extra dev -c requirements/docs.txt -o requirements/dev.txt
	$(PIN) $(EXTRAS) -c requirements/docs.txt -o requirements/run.txt

# ---- .venv: one stamp for each step, each step on top of the one before

# While something is being installed a marker lies in .venv. If it is still there, the install was cut off: .venv is
# thrown away and made anew. The same if the checkout was moved (scripts in .venv/bin hold its path) or DEPS changed.
MADE := $(CURDIR) $(DEPS)
ifneq ($(shell cat $(VENV)/.made 2>/dev/null),$(MADE))
.PHONY: $(VENV)/.made
else ifneq ($(wildcard $(VENV)/.unfinished),)
.PHONY: $(VENV)/.made
endif

# The pins have wheels up to this Python; unpinned versions may serve a newer one.
ifeq ($(DEPS),pinned)
FITS := (3, 11) <= sys.version_info[:2] <= (3, 14)
NEEDED := Python 3.11 to 3.14 (or a newer one and DEPS=latest)
else
FITS := (3, 11) <= sys.version_info[:2]
NEEDED := Python 3.11 or newer
endif

$(VENV)/.made:
	@rm -rf $(VENV)
	@for python in $(PYTHONS); do \
		if "$$python" -c 'import sys; sys.exit(not $(FITS))' 2>/dev/null; then \
			echo "sagnac: making $(VENV) with $$("$$python" -V)"; \
			"$$python" -m venv $(VENV) && printf '%s\n' "$(MADE)" > $@; exit; \
		fi; \
		seen="$$seen $$python: $$("$$python" -V 2>/dev/null || echo not there)."; \
	done; \
	echo "sagnac needs $(NEEDED).$$seen" >&2; \
	echo "Say where one is: make PYTHON=/path/to/python3.11 ..." >&2; exit 1

PIP := $(PY) -m pip --disable-pip-version-check --no-input install -qq
ifeq ($(DEPS),pinned)
PREPARE = :
INSTALL = $(PIP) --require-hashes --only-binary :all: -r requirements/$(1).txt
FROM = requirements/$(1).txt
else ifneq ($(filter $(DEPS),lowest latest),)
RESOLUTION_lowest := lowest-direct
RESOLUTION_latest := highest
PREPARE = $(PIP) uv
INSTALL = $(VENV)/bin/uv pip install -q --python $(PY) --resolution $(RESOLUTION_$(DEPS)) \
	-r pyproject.toml $(2) -r requirements/build.in
FROM = pyproject.toml requirements/build.in
else
$(error DEPS is one of pinned, lowest, latest, not '$(DEPS)')
endif

define step
	@echo "sagnac: installing $(1) ..."
	@touch $(VENV)/.unfinished
	@$(2)
	@touch $@ && rm -f $(VENV)/.unfinished
endef

$(VENV)/.run: $(VENV)/.made $(call FROM,run)
	$(call step,what it needs to run ($(DEPS) versions),$(PREPARE) && $(call INSTALL,run,$(EXTRAS)))

$(VENV)/.package: $(VENV)/.run pyproject.toml src/sagnac/_version.py
	@echo "sagnac: installing the package itself ..."
	@$(PIP) --no-deps --no-build-isolation -e . && touch $@

$(VENV)/.dev: $(VENV)/.package $(call FROM,dev)
	$(call step,what the tests need ($(DEPS) versions),$(call INSTALL,dev,$(EXTRAS) --extra dev))

$(VENV)/.docs: $(VENV)/.dev $(call FROM,docs)
	$(call step,what the documentation needs ($(DEPS) versions),$(call INSTALL,docs,$(EXTRAS) --extra dev --extra docs))
