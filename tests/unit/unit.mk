# SPDX-License-Identifier: MIT
# The CMocka tests of the node library: included by the main Makefile, or alone:  make -f tests/unit/unit.mk test-unit
# Given from outside: CC, CXX, BUILD, CFLAGS (optimisation). `test-unit` runs every test, plain and sanitized, to the end and
# fails if one did; `test-unit-plain` and `test-unit-sanitize` run one half.

BUILD ?= build
CFLAGS ?= -O2

UNIT_DIR := tests/unit
# Another build of the library: with UNIT_NUMERIC for its headers, the amalgamation is tested so.
UNIT_LIBRARY := src/meshkal/meshkal.c
# narrow: test_unrolled as processors without vector registers compile it.
UNIT_TESTS := $(patsubst $(UNIT_DIR)/test_%.c,%,$(wildcard $(UNIT_DIR)/test_*.c)) narrow
UNIT_HELPERS := reference generator node wire
UNIT_LIBS := -lcmocka -llapacke -llapack -lblas -lsodium -lm
UNIT_NUMERIC := -Iinclude -Isrc -ffp-contract=off
UNIT_STRICT := -std=c99 -pedantic -Wall -Wextra -Wconversion -Wdouble-promotion -Wvla -Wmissing-prototypes -Werror
UNIT_STRICT_CXX := -std=c++17 -pedantic -Wall -Wextra -Werror

# The sanitized long run is shortened: it looks for other things than drift.
UNIT_SANITIZE := -O1 -g -fsanitize=address,undefined -fno-sanitize-recover=all -DUNIT_LONG_RUN=4000

UNIT_PLAIN_PROGRAMS := $(UNIT_TESTS:%=$(BUILD)/test/unit_%) $(BUILD)/test/unit_include_all
UNIT_SANITIZE_PROGRAMS := $(UNIT_TESTS:%=$(BUILD)/test-sanitize/unit_%) $(BUILD)/test-sanitize/unit_include_all
TEST_ITEMS += $(UNIT_PLAIN_PROGRAMS) $(UNIT_SANITIZE_PROGRAMS)

# $(1): directory below BUILD, $(2): flags after CFLAGS
define UNIT_RULES
$$(BUILD)/$(1)/unit-objects/meshkal.o: $$(UNIT_LIBRARY)
	@mkdir -p $$(@D)
	$$(CC) -std=c99 $$(UNIT_NUMERIC) $$(CFLAGS) $(2) -MMD -MP -c -o $$@ $$<

$$(BUILD)/$(1)/unit-objects/%.o: $$(UNIT_DIR)/%.c
	@mkdir -p $$(@D)
	$$(CC) $$(UNIT_NUMERIC) $$(CFLAGS) $$(UNIT_STRICT) $(2) -MMD -MP -c -o $$@ $$<

# The unrolled kernels as processors without vector registers compile them.
$$(BUILD)/$(1)/unit-objects/test_narrow.o: $$(UNIT_DIR)/test_unrolled.c
	@mkdir -p $$(@D)
	$$(CC) $$(UNIT_NUMERIC) $$(CFLAGS) $$(UNIT_STRICT) $(2) -DMK_NARROW -MMD -MP -c -o $$@ $$<

$$(BUILD)/$(1)/unit-objects/include_all.o: $$(UNIT_DIR)/include_all.cpp
	@mkdir -p $$(@D)
	$$(CXX) $$(UNIT_NUMERIC) -O1 $$(UNIT_STRICT_CXX) $(2) -MMD -MP -c -o $$@ $$<

$$(BUILD)/$(1)/unit_include_all: $$(BUILD)/$(1)/unit-objects/include_all.o $$(BUILD)/$(1)/unit-objects/meshkal.o
	$$(CXX) $(2) -o $$@ $$^ -lm

$$(UNIT_TESTS:%=$$(BUILD)/$(1)/unit_%): $$(BUILD)/$(1)/unit_%: $$(BUILD)/$(1)/unit-objects/test_%.o \
		$$(UNIT_HELPERS:%=$$(BUILD)/$(1)/unit-objects/%.o) $$(BUILD)/$(1)/unit-objects/meshkal.o
	$$(CC) $(2) -o $$@ $$^ $$(UNIT_LIBS)

-include $$(wildcard $$(BUILD)/$(1)/unit-objects/*.d)
endef

$(eval $(call UNIT_RULES,test,))
$(eval $(call UNIT_RULES,test-sanitize,$(UNIT_SANITIZE)))

# Each program's output goes to a log beside it; shown are its remarks and closing line, or all of it when it fails.
define UNIT_RUN
@failed=; for program in $^; do \
	if $$program > $$program.log 2>&1; then grep -h '^- \|PASSED' $$program.log | sed "s,^,$${program##*/}: ,"; \
	else cat $$program.log; failed="$$failed $$program"; fi; \
done; \
if [ -n "$$failed" ]; then echo "failed:$$failed"; exit 1; fi
endef

.PHONY: test-unit test-unit-plain test-unit-sanitize
test-unit-plain: $(UNIT_PLAIN_PROGRAMS)
	$(UNIT_RUN)
test-unit-sanitize: $(UNIT_SANITIZE_PROGRAMS)
	$(UNIT_RUN)
test-unit: $(UNIT_PLAIN_PROGRAMS) $(UNIT_SANITIZE_PROGRAMS)
	$(UNIT_RUN)
