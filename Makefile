# Everything a person or a machine runs here. `make` alone lists the targets.

PYTHON ?= python3
# One more than there are processors: some tests wait for a line to be given up.
JOBS ?= $(shell expr $$(nproc) + 1)

BIN := .venv/bin
READY := .venv/.ready
# What the demo needs is there: a part of what READY stands for.
DEMO_READY := .venv/.demo-ready

.DELETE_ON_ERROR:
.PHONY: help setup demo test test-full test-gpu test-record coverage toggles formal lint lint-host lint-imports lint-house lint-rtl bench docs-tables registers manifests synth bitstream report-bitstream report report-fixed report-link report-depth report-layers report-content report-calibration report-hard peers mutation mutation-host scenes pictures site clean

help: ## list the targets
	@sed -n -E 's/^([a-z-]+):.*## (.*)/  make \1\t\2/p' $(firstword $(MAKEFILE_LIST)) | expand -t 20

setup: $(READY) ## make .venv with all that the project needs (PYTHON=python3)

# rayoptics comes without its dependencies, a GUI stack (see pyproject.toml). setuptools comes
# first, and the build is not isolated, for that would fetch a setuptools that nothing pins.
# pip would compile modules on one processor. Some packages have files that are no Python, which do not compile;
# their tests, pip, and scapy, which cocotb-bus asks for, are not imported here.
# uv takes seconds where pip takes most of a minute, but does not read pip's settings: where these name
# another registry, uv may find nothing, and pip installs.
PIP := $(BIN)/pip install -q --no-compile --disable-pip-version-check --no-warn-conflicts -c constraints.txt
UV := $(BIN)/uv pip install -q --python $(BIN)/python -c constraints.txt
FIRST := --no-deps setuptools
FOR_DEMO := --no-build-isolation -e '.[render,board,live,simulate]'
JUDGE := --no-deps rayoptics
ALL := --no-build-isolation -e '.[all,rtl,test,site,lint]'
$(DEMO_READY): pyproject.toml constraints.txt host/setup.sh
	@PYTHON=$(PYTHON) host/setup.sh system
	@echo "setup: installing the Python packages of the product into .venv (half a minute)"
	@$(PYTHON) -m venv .venv
	@$(PIP) uv
	@{ $(UV) $(FIRST) && $(UV) $(FOR_DEMO); } 2> /dev/null || { $(PIP) $(FIRST) && $(PIP) $(FOR_DEMO); }
	@host/setup.sh check
	@touch $@

$(READY): $(DEMO_READY)
	@host/setup.sh tests
	@echo "setup: installing the Python packages of tests and tools into .venv (half a minute)"
	@{ $(UV) $(JUDGE) && $(UV) $(ALL); } 2> /dev/null || { $(PIP) $(JUDGE) && $(PIP) $(ALL); }
	@$(BIN)/python -m compileall -qq -j 0 -x '/(tests|scapy|pip)/' .venv/lib || true
	@host/setup.sh check-tools
	@touch $@
	@echo "setup: ready"

demo: $(DEMO_READY) ## the whole product on the virtual board, into out/demo/
	$(BIN)/lippmann demo

# Workers and processes of the tests read modules that one of them has compiled, whatever this is set to outside.
test test-full test-gpu coverage toggles formal: export PYTHONDONTWRITEBYTECODE =

# Every commit is judged by the same draws, so that what fails has to do with the commit. A bare pytest, and
# test-full, draw anew each time and print the seed.
test: export LIPPMANN_SEED ?= 1908
test: lint ## lint, then the tests that take minutes at most (JOBS=3)
	$(BIN)/pytest -n $(JOBS) --dist loadfile --no-loadscope-reorder -m "not full"

test-full: lint ## lint, then every test (one to two hours)
	$(BIN)/pytest -n $(JOBS) --junitxml=build/test-full.xml

# Those that trace or render with Dr.Jit; they fail without a GPU.
GPU_TESTS := fast_engine recorded renderer pixel_filter golden_pictures converged panel observer capture_rays capture_lens mitsuba_sensor models_nest viewing parallax shared_light live
test-gpu: $(READY) ## the fast engine and the renderer on an NVIDIA GPU (minutes)
	LIPPMANN_TEST_DEVICE=cuda $(BIN)/pytest -n $(JOBS) --dist loadfile -m "not full" $(GPU_TESTS:%=tests/host/test_%.py)

test-record: $(READY) ## the results of the last make test-full, into build/reports
	$(BIN)/python -m tools.test_record build/test-full.xml

coverage: $(READY) ## lines that the tests of make test execute, into build/reports (twenty minutes)
	$(BIN)/python -m tools.code_coverage --jobs $(JOBS)

toggles: $(READY) ## bits of the RTL that its quick benches toggle, into build/reports (an hour, and tens of GB in build)
	$(BIN)/python -m tools.code_coverage --jobs $(JOBS) --toggles

formal: $(READY) ## every formal proof of the RTL, its covers and its broken designs
	$(BIN)/pytest -n $(JOBS) tests/rtl/test_formal.py

lint: $(READY) ## style, format, types, import layers, bounds of size; every RTL module alone
	@$(MAKE) --no-print-directory -k -j2 lint-host lint-imports lint-house lint-rtl

lint-host:
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy -n 2

lint-imports:
	@said=$$($(BIN)/lint-imports --no-logo --no-cache) || { echo "$$said"; exit 1; }

lint-house:
	@$(BIN)/python -m tools.house

lint-rtl:
	$(BIN)/python -m tools.lint

bench: $(READY) ## measure the figures of docs/generated/measured.md (a quarter of an hour, on a quiet machine)
	@for name in trace render stages live rtl view animate observe; do \
	  $(BIN)/python -m tools.bench $$name --report docs/generated > /dev/null || exit; done

docs-tables: $(READY) ## make the tables of keys, coverage points and promises, and the JSON Schemas again
	$(BIN)/python -m tools.generate_documentation

registers: $(READY) ## make RTL, host constants and documentation of rtl/registers.rdl again
	$(BIN)/python -m tools.generate_registers

manifests: $(READY) ## make the FuseSoC core, Bender.yml and the .f lists of rtl/sources.toml again
	$(BIN)/python -m tools.generate_manifests

synth: $(READY) ## place and route the RTL's named configurations and boards (hours; kept in build/synth)
	$(BIN)/python -m tools.synthesis

# X11 has a variable DISPLAY too: only what is given to make counts, unless it is empty.
given = $(if $(filter command line,$(origin $(1))),$(if $(strip $($(1))),--$(2) '$(subst ','\'',$($(1)))'))
bitstream: $(READY) ## the file for an FPGA board (BOARD=ulx3s DISPLAY=scenes/displays/vga-square.toml SEEDS=1,2 PATIENCE=240 LAYERS=4 BILINEAR=)
	$(BIN)/python -m tools.bitstream $(call given,BOARD,board) $(call given,DISPLAY,display) $(call given,SEEDS,seeds) $(call given,PATIENCE,patience) $(call given,LAYERS,layers) $(if $(filter-out 0 no false,$(BILINEAR)),--bilinear)

report-bitstream: $(READY) ## clocks and cells of the ULX3S's bitstreams, into docs/generated/reports (hours; kept in build/bitstream)
	$(BIN)/python -m tools.bitstream --display scenes/displays/vga-square.toml --display scenes/displays/hd-square.toml --seeds 1,2,3 --seeds 1,2,4 --report docs/generated/reports

report: $(READY) ## measure speed against error of everything, into docs/generated/reports (a quarter of an hour)
	$(BIN)/python -m tools.full_report -o docs/generated/reports

report-fixed: $(READY) ## the fixed-point pipeline's error and its budget, into docs/generated/reports
	$(BIN)/python -m tools.bench fixed --report docs/generated/reports > /dev/null

report-link: $(READY) ## the link's efficiency and whole frames on the virtual board, into docs/generated/reports
	$(BIN)/python -m tools.bench link --report docs/generated/reports > /dev/null

report-depth: $(READY) ## depths and views of the founding paper's set-ups, into docs/generated/reports
	$(BIN)/python -m tools.bench depth --report docs/generated/reports > /dev/null

report-layers: $(READY) ## drawn layers and the streamed frame against the full render, into docs/generated/reports
	$(BIN)/python -m tools.bench layers --report docs/generated/reports > /dev/null

report-shading: $(READY) ## time against error of light that rays share, into docs/generated/reports
	$(BIN)/python -m tools.bench shading --report docs/generated/reports > /dev/null

report-content: $(READY) ## the gallery of other tools' content, and its views against the scene, into docs/generated/reports
	$(BIN)/python -m tools.bench content --report docs/generated/reports > /dev/null

report-calibration: $(READY) ## random displays calibrated by simulated photographs, into docs/generated/reports
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tools.bench calibration --displays 50 --solids 6 --bowed 3 --large \
	  --jobs $(JOBS) --seed 10 --report docs/generated/reports > /dev/null

peers: $(READY) ## compare with POV-Ray, and repeat the founding paper's benchmark, into docs/generated/reports
	$(BIN)/python -m tools.bench peers --report docs/generated/reports > /dev/null
	$(BIN)/python -m tools.bench seed --report build/reports > /dev/null

report-hard: $(READY) ## every engine and the formulas on the hard cases, into docs/generated/reports
	$(BIN)/python -m tools.bench hard --report docs/generated/reports > /dev/null

mutation: $(READY) ## put faults into the RTL and report how many are caught (two hours)
	$(BIN)/python -m tools.mutation

mutation-host: $(READY) ## put faults into the host's Python and report how many the quick tests catch (half an hour)
	$(BIN)/python -m tools.host_mutation --jobs $(JOBS)

scenes: $(READY) ## make the shipped scenes' assets again
	@for script in scenes/*/make_*.py; do echo $$script; $(BIN)/python $$script || exit; done

site: $(READY) ## the documentation as a site, into out/site/; a link that leads nowhere fails
	$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going -b html -c docs/site -d build/site . out/site
	@echo "site: open out/site/index.html"

pictures: $(READY) ## make the documentation's pictures again
	@for script in docs/pictures/make_*.py; do echo $$script; $(BIN)/python $$script || exit; done

clean: ## remove what was made, save .venv
	rm -rf out build dist host/*.egg-info .hypothesis .mypy_cache .pytest_cache .ruff_cache
	find . -path ./.venv -prune -o -name __pycache__ -type d -exec rm -rf {} +
