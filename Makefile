# DART-HAL: every job of this checkout by one word. `make` alone lists them.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
ARGS ?=
export PYTHONDONTWRITEBYTECODE := # else each process compiles every file again

# All paths below are relative, so the checkout may lie in a folder with spaces, quotes, &, # or %.
# These characters break the virtual environment: venv refuses ":", and a shell takes the
# others apart in the first line of .venv/bin/dart-hal.
BAD_CHARACTERS := $(foreach one,: $$ " ` \,$(if $(findstring $(one),$(CURDIR)),$(one)))
ifneq ($(strip $(BAD_CHARACTERS)),)
$(error The path of this checkout contains $(strip $(BAD_CHARACTERS)), found: $(CURDIR). \
A Python environment cannot be made there. Try: move the checkout to a folder without : $$ " ` \ )
endif

.DEFAULT_GOAL := help
.PHONY: help setup demo test test-more test-long faults fuzz soak mutants lint bench campaign coverage docs guide release firmware native hardware clean

help: ## list the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## (.*)/  make \1\t\2/' | expand -t 20

demo: $(VENV)/.demo toolchain ## drive, calibrate and check the emulated car; writes demo/index.html
	@rm -rf demo/cars # each demo begins with a car that was never calibrated
	@$(BIN)/dart-hal demo --out demo $(ARGS)

# Real time comes behind the tests that keep the processors busy, from the files that name it:
# collecting all of them takes as long as running these. They mostly wait: four run at a time,
# and one where each is several programs.
# 5: none of it was asked for.
REALTIME := $(if $(filter tests/%,$(ARGS)),,$(shell grep -rl --include='test_*.py' realtime tests))
test: $(VENV)/.dev toolchain ## the quick run: every behaviour that counts (four minutes on two cores)
	@$(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile -m "not (slow or long or realtime)" --durations 5 --durations-min 5 $(ARGS)
	@$(BIN)/python -m pytest -n 4 --dist loadfile -m "realtime and not (slow or long)" $(ARGS) $(REALTIME) || test $$? -eq 5
	@echo "All good: tests, style and layers hold. Types: make lint. The other cases: make test-more."

test-more: $(VENV)/.dev toolchain browser ros ## the other cases of it, and more examples of each law
	@$(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile --hypothesis-profile ci -rs -m "(slow or hypothesis) and not (long or realtime)" --durations 10 --durations-min 30 $(ARGS)
	@$(BIN)/python -m pytest -m "slow and realtime and not long" $(ARGS) $(REALTIME) || test $$? -eq 5

test-long: $(VENV)/.dev toolchain ## the long suites: 40 hidden cars, faults by the million, flashing
	@$(BIN)/python -m pytest -m long $(ARGS)

faults: $(VENV)/.dev toolchain ## every fault stopped at the ESC pin, with its negative control (half an hour)
	@$(BIN)/python tests/faults/run.py $(ARGS)

fuzz: $(VENV)/.dev ## libFuzzer on the Nano's decoder, commands and parameters: 1e7 inputs each
	@$(MAKE) -s -C firmware fuzz PYTHON=../$(BIN)/python ARGS="$(ARGS)"

soak: $(VENV)/.dev toolchain ## a fault a second for two simulated hours; nothing drives, leaks or gets lost
	@$(BIN)/python tests/soak/soak.py $(ARGS)

mutants: $(VENV)/.mutants toolchain ## break the safety parts in 200 small ways: do the tests notice? (an hour)
	@$(BIN)/python tests/mutation/mutation_run.py $(ARGS)

lint: $(VENV)/.dev ## style, types, import layers and the language's budgets
	@$(BIN)/ruff check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports
	@$(BIN)/python -m pytest -q -m slow tests/language

bench: $(VENV)/.dev toolchain ## every figure of docs/results/benchmarks.md, measured here
	@$(BIN)/python benchmarks/run.py $(ARGS)

campaign: $(VENV)/.dev ## hide every cause in drives and see whether it is found (some hours)
	@$(BIN)/python -m studies.diagnosis.campaign --picture docs/pictures/diagnose_confusion.png $(ARGS)

coverage: $(VENV)/.dev ## calibrate and identify 100 hidden cars: do the 90 % intervals hold the truth? (four hours)
	@$(BIN)/python -m studies.calibration.coverage all joint --jobs 2 --plot docs/pictures/calibration_coverage.png $(ARGS)

docs: $(VENV)/.docs ## regenerate the generated pages and build the handbook (docs/build/index.html)
	@$(BIN)/dart-hal wire --write
	@$(BIN)/python -m sphinx -q -W -b html docs docs/build
	@echo "open docs/build/index.html"

guide: $(VENV)/.guide ## the build guide with log, bill of materials and full-size sheets as one PDF
	@$(BIN)/python docs/guide_pdf.py docs/build/guide.pdf

release: $(VENV)/.dev $(VENV)/.guide $(VENV)/.release ## wheels, sources, SBOM, handbook, guide, firmware and parts with checksums in dist/
	@$(BIN)/python release.py $(ARGS)

firmware: $(VENV)/.demo toolchain ## build firmware, emulator bridge and native core, print the budgets
	@if command -v avr-gcc >/dev/null; then \
	    $(MAKE) -s -C firmware hex native size PYTHON=../$(BIN)/python; fi

native: $(VENV)/.demo ## regenerate and compile the kernels of the vehicle equations
	@$(BIN)/python -m dart_hal.vehicle.native.committed

hardware: .venv-hardware/.ready ## rebuild parts, drawings and pictures and compare (ARGS=--write replaces them)
	@.venv-hardware/bin/python hardware/cad/build.py $(ARGS)

# CAD kernel and renderer take 1.7 GB: an environment of their own. Debian: libGL for the renderer.
.venv-hardware/.ready: hardware/cad/requirements.txt
	@echo "-- making .venv-hardware: CAD kernel and renderer, about 1.7 GB (once)"
	@ldconfig -p 2>/dev/null | grep -q libGL.so.1 || sh firmware/toolchain.sh --apt libgl1 libegl1
	@$(PYTHON) -m venv .venv-hardware || { rm -rf .venv-hardware; sh firmware/toolchain.sh --apt python3-venv && $(PYTHON) -m venv .venv-hardware; }
	@.venv-hardware/bin/python -m pip install --quiet --disable-pip-version-check -r hardware/cad/requirements.txt
	@touch $@

# Compiler for the Nano and the emulator. Without them the mock takes over, visibly.
.PHONY: toolchain
toolchain:
	@sh firmware/toolchain.sh

# The live page is tested in a real browser; without one those tests are skipped, and say so.
.PHONY: browser
browser:
	@command -v chromium >/dev/null && command -v chromedriver >/dev/null || sh firmware/toolchain.sh --apt chromium chromium-driver || echo "-- no chromium: no tests in a browser"

# The bridge to ROS 1 is tested by a real master and rospy, which Debian and Ubuntu have.
.PHONY: ros
ros:
	@command -v rosmaster >/dev/null && [ -d /usr/lib/python3/dist-packages/sensor_msgs ] || sh firmware/toolchain.sh --apt python3-rosmaster python3-rospy python3-nav-msgs python3-sensor-msgs python3-tf2-ros || echo "-- no rospy: no tests by ROS 1"

setup: $(VENV)/.dev toolchain ## install everything without running anything

$(BIN)/python:
	@echo "-- making a virtual environment in $(VENV)"
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(0 if v >= (3, 10) else "DART-HAL needs Python 3.10 or newer, found %d.%d; try: make PYTHON=python3.11" % v[:2])'
	@$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); sh firmware/toolchain.sh --apt python3-venv && $(PYTHON) -m venv $(VENV); }

$(VENV)/.demo: pyproject.toml | $(BIN)/python
	@echo "-- installing dart-hal and its Python packages (once)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[lab]'
	@touch $@

$(VENV)/.dev: pyproject.toml | $(BIN)/python
	@echo "-- installing dart-hal and the tools that test it (once)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	@touch $@ $(VENV)/.demo

$(VENV)/.mutants: pyproject.toml | $(BIN)/python
	@echo "-- installing cosmic-ray, which makes the mutants of Python files (once)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev,mutants]'
	@touch $@ $(VENV)/.dev $(VENV)/.demo

$(VENV)/.docs: pyproject.toml | $(BIN)/python
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[lab,docs]'
	@touch $@

# Debian: WeasyPrint prints with Pango.
$(VENV)/.guide: pyproject.toml | $(BIN)/python
	@ldconfig -p 2>/dev/null | grep -q libpangoft2-1.0 || sh firmware/toolchain.sh --apt libpangoft2-1.0-0
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[lab,docs,guide]'
	@touch $@

$(VENV)/.release: pyproject.toml | $(BIN)/python
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[release]'
	@touch $@

clean: ## remove what was built (not the environment)
	@rm -rf demo docs/build docs/jupyter_execute firmware/build
