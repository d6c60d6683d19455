# SPDX-License-Identifier: MIT
# make help lists the targets.

BUILD   ?= build
PREFIX  ?= /usr/local
VERSION := $(shell sed -n 's/^.define MK_VERSION "\(.*\)"/\1/p' include/meshkal/base.h)
PYTHON  := .venv/bin/python

CC       = gcc
OPTIMISE = -O2
# Fused multiply-add would give other bits than targets without it.
ARITHMETIC = -ffp-contract=off
WARNINGS = -pedantic -Wall -Wextra -Wconversion -Wdouble-promotion -Wvla -Wmissing-prototypes -Werror
CFLAGS   = -std=c99 $(OPTIMISE) -g $(ARITHMETIC) $(WARNINGS)
INCLUDE  = -Iinclude -Isrc
HOST_INCLUDE = $(INCLUDE) -Iport/host -Itools/meshkal -D_POSIX_C_SOURCE=200809L
# Own models, loaded, may call the library.
HOST_LIBS = -rdynamic -pthread -ldl -llapacke -ljansson -lcbor -lsodium -lm

LIBRARY  = $(BUILD)/libmeshkal.a
PROGRAM  = $(BUILD)/meshkal
HOST_SOURCES = $(wildcard port/host/*.c tools/meshkal/*.c tools/meshkal/*/*.c)
HOST_OBJECTS = $(HOST_SOURCES:%.c=$(BUILD)/%.o)

.DEFAULT_GOAL := help
.PHONY: help setup all mpi run reproduce network-monitor test bench clean

help: ## this list
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' $(MAKEFILE_LIST) | expand -t 27

# --- what the machine needs ------------------------------------------------------------------------------------------------

PACKAGES = gcc g++ clang libclang-rt-14-dev make pkgconf liblapacke-dev libjansson-dev libcbor-dev libsodium-dev libcmocka-dev libeigen3-dev \
           openmpi-bin libopenmpi-dev libmetis-dev \
           gcc-arm-none-eabi picolibc-arm-none-eabi qemu-system-arm gcc-riscv64-unknown-elf picolibc-riscv64-unknown-elf qemu-system-misc \
           cmake iproute2 python3-venv
# What only pictures of recordings need, and not every machine has: set-up goes on without it, and their tests are left out.
PICTURE_PACKAGES = mesa-vulkan-drivers
SETUP = .venv/setup-done
# Other users than root need sudo.
ROOT := $(if $(filter 0,$(shell id -u)),,sudo)

setup: $(SETUP) ## install Debian packages and the pinned Python environment (does nothing the second time)

$(SETUP): tools/requirements.txt tools/rerun/pyproject.toml
	@missing=$$(for p in $(PACKAGES); do dpkg-query -W -f '$${Status}' $$p 2>/dev/null | grep -q 'ok installed' || echo $$p; done); \
	if [ -n "$$missing" ]; then echo "setup: Debian packages" $$missing; \
	  $(ROOT) apt-get -o DPkg::Lock::Timeout=400 -qq update && \
	  DEBIAN_FRONTEND=noninteractive $(ROOT) apt-get -o DPkg::Lock::Timeout=400 -qq -y --no-install-recommends install $$missing >/dev/null; fi
	@missing=$$(for p in $(PICTURE_PACKAGES); do dpkg-query -W -f '$${Status}' $$p 2>/dev/null | grep -q 'ok installed' || echo $$p; done); \
	install="$(ROOT) apt-get -o DPkg::Lock::Timeout=400 -qq -y --no-install-recommends install $$missing"; export DEBIAN_FRONTEND=noninteractive; \
	if [ -n "$$missing" ]; then { $$install || { $(ROOT) apt-get -qq update && $$install; }; } >/dev/null 2>&1 || \
	  echo "setup:" $$missing "cannot be installed here; the viewer will make no pictures"; fi
	@echo "setup: Python packages of tools/requirements.txt"
	@test -x $(PYTHON) || python3 -m venv .venv
	@$(PYTHON) -m pip install --quiet --disable-pip-version-check -r tools/requirements.txt
	@$(PYTHON) -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e tools/rerun
	@touch $@

# --- library and program ---------------------------------------------------------------------------------------------------

all: $(LIBRARY) $(PROGRAM) ## the node library, the host program and the node daemon, in build/

# Objects are made anew when the rules change; everything compiled waits for the packages.
$(BUILD)/%.o: %.c Makefile | $(SETUP)
	@mkdir -p $(@D)
	@echo "  CC $@"
	@$(CC) $(CFLAGS) $(if $(filter src/%,$<),$(INCLUDE),$(HOST_INCLUDE)) -MMD -MP -c $< -o $@

$(LIBRARY): $(BUILD)/src/meshkal/meshkal.o
	@echo "  AR $@"
	@rm -f $@ && ar rcs $@ $^

$(PROGRAM): $(HOST_OBJECTS) $(LIBRARY)
	@echo "  LD $@"
	@$(CC) $(CFLAGS) $^ $(HOST_LIBS) -o $@

# The example of own models, as users compile theirs.
all: $(BUILD)/own_models.so
$(BUILD)/own_models.so: $(wildcard tools/meshkal/examples/*) port/host/meshkal/plugin.h $(wildcard include/meshkal/*.h) | $(SETUP)
	@echo "  LD $@"
	@$(CC) $(CFLAGS) -shared -fPIC $(HOST_INCLUDE) tools/meshkal/examples/own_models.c -o $@

# The library's consensus by itself, for tools/reproduce.
all: $(BUILD)/consensus-run
$(BUILD)/consensus-run: $(BUILD)/tools/reproduce/distributed_unscented/consensus_run.o $(LIBRARY)
	@echo "  LD $@"
	@$(CC) $(CFLAGS) $^ -lm -o $@

# The same program for many processes. The wrapper of Open MPI knows where its headers and libraries are.
MPI_PROGRAM = $(BUILD)/meshkal-mpi
MPI_OBJECTS = $(patsubst %.c,$(BUILD)/%.o,$(wildcard tools/meshkal-mpi/*.c))
$(MPI_OBJECTS): CC := OMPI_CC=$(CC) mpicc
mpi: $(MPI_PROGRAM) ## build/meshkal-mpi: simulate on many processes (Open MPI)
$(MPI_PROGRAM): $(MPI_OBJECTS) $(filter-out %/main.o,$(HOST_OBJECTS)) $(LIBRARY)
	@echo "  LD $@"
	@OMPI_CC=$(CC) mpicc $(CFLAGS) $^ -lmetis $(HOST_LIBS) -o $@

include tools/meshkal-node/node.mk

-include $(MPI_OBJECTS:.o=.d) $(HOST_OBJECTS:.o=.d) $(BUILD)/src/meshkal/meshkal.d

# --- run -------------------------------------------------------------------------------------------------------------------

RUN = $(BUILD)/run

run: all ## design, simulate and record the published example, and the study on real data
	@mkdir -p $(RUN)
	@$(PROGRAM) scenario projectile --nodes 20 --seed 1 > $(RUN)/projectile.json
	@echo "== 1. Design: local tolerances of 20 nodes" && $(PROGRAM) design $(RUN)/projectile.json --json $(RUN)/design.json
	@echo && echo "== 2. One run of RKFDNU2, its log and its recording"
	@$(PROGRAM) simulate $(RUN)/projectile.json --out $(RUN)/run.cbor
	@.venv/bin/meshkal-rerun $(RUN)/run.cbor -o $(RUN)/run.rrd
	@echo && echo "== 3. Real data: 50 motes, two days" && $(PYTHON) tools/lab-temperature/study.py tools/lab-temperature/temperature.csv \
	  --meshkal $(PROGRAM) --out $(BUILD)/lab-temperature
	@echo && echo "== 4. The six filters on the published example, Monte Carlo"
	@$(PROGRAM) simulate $(RUN)/projectile.json --filter all --runs 200 --json $(RUN)/summary.json
	@echo && echo "Open the recording: .venv/bin/rerun $(RUN)/run.rrd   (log: $(RUN)/run.cbor)"

DRAWS = 30

reproduce: all ## four published experiments over 30 random draws (DRAWS=N): tables, figures and recordings in build/reproduce/
	@$(PYTHON) tools/reproduce --meshkal $(PROGRAM) --out $(BUILD)/reproduce --draws $(DRAWS)

network-monitor: all ## monitors on the published network: false alarms, time to alert, error: tables in build/network-monitor/
	@$(PYTHON) tools/network-monitor/study.py --meshkal $(PROGRAM) --out $(BUILD)/network-monitor

# --- test and bench --------------------------------------------------------------------------------------------------------

SANITIZE = -O1 -fsanitize=address,undefined -fno-sanitize-recover=all
include port/monocypher/monocypher.mk tests/unit/unit.mk tests/host/host.mk tests/mpi/mpi.mk tests/bench/bench.mk tests/package/package.mk \
  tests/firmware/firmware.mk tests/firmware/demo/demo.mk tests/firmware/size/size.mk tests/firmware/sealed/sealed.mk tests/fuzz/fuzz.mk

# Every suite runs twice: as users build it, and with the sanitizers. The files above add to TEST_ITEMS what tests/run.sh runs, a program
# or sh:SCRIPT, and to TEST_NEEDS what the scripts need.
test: all mpi $(TEST_NEEDS) ## all tests, plain and under ASan and UBSan; last line: N passed, N failed
	@$(MAKE) -s --no-print-directory BUILD=$(BUILD)/sanitize OPTIMISE="$(SANITIZE)" all mpi
	@$(MAKE) -s --no-print-directory -j2 $(filter-out sh:%,$(TEST_ITEMS))
	@tests/run.sh $(BUILD) \
	  py:pytest:$(PROGRAM):tests/reference,tests/host,tests/mpi,tests/lab,tests/rerun,tests/reproduce \
	  py:pytest-sanitized:$(BUILD)/sanitize/meshkal:tests/reference,tests/host,tests/mpi \
	  $(TEST_ITEMS) wait py:node:$(PROGRAM):tests/node wait py:node-sanitized:$(BUILD)/sanitize/meshkal:tests/node

bench: | $(SETUP) ## a node step beside Eigen and LAPACKE, analyze against nodes, simulate against processes: tables, build/bench/*.json

include port/package/package.mk

clean: ## remove build/ (the Python environment stays)
	rm -rf $(BUILD)
