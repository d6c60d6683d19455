# SPDX-License-Identifier: MIT
# Benchmark against Eigen and LAPACKE. From the top of the tree:  make -f tests/bench/bench.mk bench [BENCH_ARGS=...]
# As a part of the main Makefile also the cost of analyze against the number of nodes (BENCH_ANALYZE_ARGS=--large: up to 1000)
# and how simulate scales over processes, and how late live mode of the rerun tool is (also alone: make bench-scaling, make bench-live).
# Needs Eigen 3 (eigen3 by pkg-config or /usr/include/eigen3), LAPACKE and CBLAS.
CC ?= cc
CXX ?= c++
BUILD ?= build
BENCH_TUNE ?= -march=native
BENCH_ARGS ?= --json $(BENCH_DIR)/bench.json
BENCH_DIR := $(BUILD)/bench
BENCH_FLAGS := -O3 $(BENCH_TUNE) -ffp-contract=off -Wall -Wextra -Iinclude -Isrc
BENCH_EIGEN := -isystem $(or $(patsubst -I%,%,$(shell pkg-config --cflags-only-I eigen3 2>/dev/null)),/usr/include/eigen3)
BENCH_LIBS ?= -llapacke -llapack -lblas -lm
BENCH_OBJECTS := $(addprefix $(BENCH_DIR)/,bench.o workload.o peak.o meshkal.o lapacke.o eigen.o library.o)
# gcc 12 warns of its own AVX-512 headers when Eigen uses them.
$(BENCH_DIR)/eigen.o: BENCH_FLAGS += -w
BENCH_HEADERS := $(wildcard include/meshkal/*.h src/meshkal/*.h src/meshkal/*/*.h tests/bench/*.h)

.PHONY: bench
bench: $(BENCH_DIR)/bench $(BENCH_DIR)/unscented $(PROGRAM)
	$(BENCH_DIR)/bench $(BENCH_ARGS)
	@$(MAKE) -s --no-print-directory $(if $(PROGRAM),,-f tests/bench/bench.mk) bench-unscented bench-monitor
	$(if $(PROGRAM),@$(PYTHON) tests/bench/analyze.py $(PROGRAM) $(BENCH_DIR) $(BENCH_ANALYZE_ARGS))
	$(if $(PROGRAM),@$(MAKE) -s --no-print-directory bench-scaling bench-live)

# Unscented and extended filters beside Eigen, the Python packages of requirements.txt and the Rust crates of rust/Cargo.lock. Those that cannot be had
# are named, and the others go on.
.PHONY: bench-unscented
PYTHON ?= python3
bench-unscented: $(BENCH_DIR)/unscented $(BENCH_DIR)/weights
	@echo && $(BENCH_DIR)/unscented $(BENCH_DIR)
	@echo && $(BENCH_DIR)/weights
	@rm -f $(BENCH_DIR)/unscented-rust.txt
	@if RUSTFLAGS="-C target-cpu=native" cargo build --quiet --release --locked --manifest-path tests/bench/rust/Cargo.toml --target-dir $(BENCH_DIR)/rust; \
	  then $(BENCH_DIR)/rust/release/unscented $(BENCH_DIR) > $(BENCH_DIR)/unscented-rust.txt; \
	  else echo "bench: no comparison with Rust: cargo or the crates of tests/bench/rust/Cargo.lock cannot be had (above)"; fi
	@if test -f $(BENCH_DIR)/python/complete || { $(PYTHON) -m pip install --quiet --disable-pip-version-check --no-deps --require-hashes --upgrade \
	    --target $(BENCH_DIR)/python -r tests/bench/requirements.txt && touch $(BENCH_DIR)/python/complete; }; \
	  then PYTHONPATH=$(BENCH_DIR)/python $(PYTHON) tests/bench/unscented.py $(BENCH_DIR); \
	  else echo "bench: no comparison with FilterPy and Stone Soup: the packages of tests/bench/requirements.txt cannot be had (above)"; fi

$(BENCH_DIR)/unscented: $(addprefix $(BENCH_DIR)/,unscented.o unscented_meshkal.o unscented_eigen.o library.o)
	$(CXX) -o $@ $^ -lm
$(BENCH_DIR)/weights: $(addprefix $(BENCH_DIR)/,weights.o library.o)
	$(CXX) -o $@ $^ -lm
$(BENCH_DIR)/unscented_eigen.o $(BENCH_DIR)/weights.o: BENCH_FLAGS += -w
$(BENCH_DIR)/unscented_meshkal.o: tests/bench/unscented_meshkal.tmpl.h

# The integrity monitor beside Eigen.
.PHONY: bench-monitor
bench-monitor: $(BENCH_DIR)/monitor
	@echo && $(BENCH_DIR)/monitor
$(BENCH_DIR)/monitor: $(addprefix $(BENCH_DIR)/,monitor.o monitor_eigen.o library.o)
	$(CXX) -o $@ $^ -lm
$(BENCH_DIR)/monitor_eigen.o: BENCH_FLAGS += -w
$(BENCH_DIR)/monitor.o: tests/bench/monitor.tmpl.h

# Processes and threads: needs Open MPI and METIS. BENCH_SCALING_ARGS=--full divides a million nodes.
ifdef PROGRAM
.PHONY: bench-scaling
bench-scaling: $(PROGRAM) $(MPI_PROGRAM) $(BENCH_DIR)/cuts
	@$(PYTHON) tests/bench/scaling.py $^ $(BENCH_DIR) $(BENCH_SCALING_ARGS)

$(BENCH_DIR)/cuts: tests/bench/cuts.c $(BUILD)/tools/meshkal-mpi/partition.o $(filter-out %/main.o,$(HOST_OBJECTS)) $(LIBRARY)
	@mkdir -p $(@D)
	@echo "  LD $@"
	@$(CC) $(CFLAGS) $(HOST_INCLUDE) -Itools/meshkal-mpi $^ -lmetis $(HOST_LIBS) -o $@
endif

# Latency of meshkal-rerun --live, from the pipe to a viewer: needs the Python environment of the rerun tool.
ifdef PROGRAM
.PHONY: bench-live
bench-live:
	@$(PYTHON) tests/bench/live.py $(BENCH_DIR) $(BENCH_LIVE_ARGS)
endif

$(BENCH_DIR)/bench: $(BENCH_OBJECTS)
	$(CXX) -o $@ $^ $(BENCH_LIBS)

$(BENCH_DIR)/library.o: src/meshkal/meshkal.c $(BENCH_HEADERS)
	@mkdir -p $(@D)
	$(CC) $(BENCH_FLAGS) -std=c99 -c -o $@ $<

# The yardstick stays scalar.
$(BENCH_DIR)/peak.o: BENCH_FLAGS += -fno-tree-vectorize -fno-tree-slp-vectorize

$(BENCH_DIR)/%.o: tests/bench/%.c $(BENCH_HEADERS)
	@mkdir -p $(@D)
	$(CC) $(BENCH_FLAGS) -std=c99 -c -o $@ $<

$(BENCH_DIR)/%.o: tests/bench/%.cpp $(BENCH_HEADERS)
	@mkdir -p $(@D)
	$(CXX) $(BENCH_FLAGS) $(BENCH_EIGEN) -std=c++17 -c -o $@ $<
