# SPDX-License-Identifier: MIT
# Benchmark against Eigen and LAPACKE. From the top of the tree:  make -f tests/bench/bench.mk bench [BENCH_ARGS=...]
# As a part of the main Makefile also the cost of analyze against the number of nodes (BENCH_ANALYZE_ARGS=--large: up to 1000)
# and how simulate scales over processes (also alone: make bench-scaling).
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
bench: $(BENCH_DIR)/bench $(PROGRAM)
	$(BENCH_DIR)/bench $(BENCH_ARGS)
	$(if $(PROGRAM),@$(PYTHON) tests/bench/analyze.py $(PROGRAM) $(BENCH_DIR) $(BENCH_ANALYZE_ARGS))
	$(if $(PROGRAM),@$(MAKE) -s --no-print-directory bench-scaling)

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
