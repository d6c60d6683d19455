# SPDX-License-Identifier: MIT
# Fuzzing of what a node is handed: included by the main Makefile, or alone:  make -f tests/fuzz/fuzz.mk fuzz
# FUZZ_TEST_PROGRAMS are the short seeded run of the test suite, plain and sanitized. `fuzz` runs FUZZ_SECONDS: with libFuzzer, which
# learns from coverage, where clang has it, otherwise with seeds that nobody chose. What fails is left in $(BUILD)/fuzz.

BUILD ?= build
CFLAGS ?= -O2
FUZZ_SECONDS ?= 600
FUZZ_CLANG ?= clang

FUZZ_DIR := tests/fuzz
FUZZ_SANITIZE := -O1 -g -fsanitize=address,undefined -fno-sanitize-recover=all
FUZZ_STRICT := -std=c99 -pedantic -Wall -Wextra -Wconversion -Wdouble-promotion -Wvla -Wmissing-prototypes -Werror -ffp-contract=off
FUZZ_INCLUDE := -Iinclude -Isrc -Itests/unit -I$(FUZZ_DIR)
FUZZ_SOURCES := $(FUZZ_DIR)/target.c tests/unit/wire.c src/meshkal/meshkal.c
FUZZ_DRIVER := $(FUZZ_DIR)/generate.c tests/unit/generator.c
FUZZ_NEEDS := $(FUZZ_SOURCES) $(FUZZ_DRIVER) $(wildcard $(FUZZ_DIR)/*.h tests/unit/*.h include/meshkal/*.h src/meshkal/*.h src/meshkal/*/*.h)
FUZZ_LIBS := -llapacke -lsodium -lm
FUZZ_TEST_PROGRAMS := $(BUILD)/fuzz/generate $(BUILD)/fuzz/generate-sanitized
TEST_ITEMS += $(FUZZ_TEST_PROGRAMS)

$(BUILD)/fuzz/generate: $(FUZZ_NEEDS)
	@mkdir -p $(@D)
	$(CC) $(CFLAGS) $(FUZZ_STRICT) $(FUZZ_INCLUDE) $(FUZZ_SOURCES) $(FUZZ_DRIVER) $(FUZZ_LIBS) -o $@

$(BUILD)/fuzz/generate-sanitized: $(FUZZ_NEEDS)
	@mkdir -p $(@D)
	$(CC) $(CFLAGS) $(FUZZ_STRICT) $(FUZZ_SANITIZE) $(FUZZ_INCLUDE) $(FUZZ_SOURCES) $(FUZZ_DRIVER) $(FUZZ_LIBS) -o $@

.PHONY: fuzz test-fuzz
test-fuzz: $(FUZZ_TEST_PROGRAMS)
	@for p in $^; do $$p || exit 1; done

fuzz: $(BUILD)/fuzz/generate-sanitized ## fuzz what a node is handed for FUZZ_SECONDS=600
	@mkdir -p $(BUILD)/fuzz/corpus
	@if $(FUZZ_CLANG) -std=c99 -O1 -g -ffp-contract=off -fsanitize=fuzzer,address,undefined -fno-sanitize-recover=all $(FUZZ_INCLUDE) $(FUZZ_SOURCES) \
	  $(FUZZ_LIBS) -o $(BUILD)/fuzz/libfuzzer 2>/dev/null; then \
	  $(BUILD)/fuzz/libfuzzer -max_total_time=$(FUZZ_SECONDS) -max_len=4096 -artifact_prefix=$(BUILD)/fuzz/ $(BUILD)/fuzz/corpus; \
	else \
	  echo "fuzz: $(FUZZ_CLANG) has no libFuzzer here, so seeded programs instead"; \
	  end=$$(($$(date +%s) + $(FUZZ_SECONDS))); seed=$$(date +%s); \
	  while [ "$$(date +%s)" -lt "$$end" ]; do $< 5000 $$seed || { echo "fuzz: fails again with  $< 5000 $$seed"; exit 1; }; seed=$$((seed + 1)); done; \
	fi
