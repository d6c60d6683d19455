# SPDX-License-Identifier: MIT
# CMocka tests of the host side: included by the main Makefile, or alone:  make -f tests/host/host.mk test-host-c
# test-host-c builds and runs all of them, plain and with ASan and UBSan. $(BUILD)/sanitize/meshkal is the sanitized program,
# for the pytest tests (MESHKAL=$(BUILD)/sanitize/meshkal).

ifndef PROGRAM
BUILD ?= build
PROGRAM = $(BUILD)/meshkal
LIBRARY = $(BUILD)/libmeshkal.a
CFLAGS ?= -std=c99 -O2 -g -ffp-contract=off -pedantic -Wall -Wextra -Wconversion -Wdouble-promotion -Wvla -Wmissing-prototypes -Werror
HOST_INCLUDE = -Iinclude -Isrc -Iport/host -Itools/meshkal -D_POSIX_C_SOURCE=200809L
$(PROGRAM) $(LIBRARY) &: host-build
	@true
host-build:
	@$(MAKE) -s BUILD=$(BUILD) all
.PHONY: host-build
.DEFAULT_GOAL := test-host-c
endif

HOST_TEST = tests/host
HOST_TEST_LIBS = -lcmocka -llapacke -ljansson -lcbor -lsodium -lm
HOST_SANITIZE = -O1 -fsanitize=address,undefined -fno-sanitize-recover=all
HOST_FILES = $(wildcard port/host/*.c)
HOST_SANITIZED = $(patsubst %.c,$(BUILD)/sanitize/%.o,$(wildcard port/host/*.c tools/meshkal/*.c) src/meshkal/meshkal.c)

# --- the sanitized program and library -------------------------------------------------------------------------------------

$(BUILD)/sanitize/%.o: %.c
	@mkdir -p $(@D)
	$(CC) $(CFLAGS) $(HOST_SANITIZE) $(HOST_INCLUDE) -MMD -MP -c $< -o $@

$(BUILD)/sanitize/meshkal: $(HOST_SANITIZED)
	$(CC) $(CFLAGS) $(HOST_SANITIZE) $^ $(HOST_TEST_LIBS) -o $@

-include $(HOST_SANITIZED:.o=.d)

# --- test_host and test_dense ----------------------------------------------------------------------------------------------

$(BUILD)/host/test_%: $(HOST_TEST)/test_%.c $(HOST_FILES) $(LIBRARY) $(wildcard port/host/*.h)
	@mkdir -p $(@D)
	$(CC) $(CFLAGS) $(HOST_INCLUDE) $< $(HOST_FILES) $(LIBRARY) $(HOST_TEST_LIBS) -o $@

$(BUILD)/sanitize/host/test_%: $(HOST_TEST)/test_%.c $(HOST_SANITIZED) $(wildcard port/host/*.h)
	@mkdir -p $(@D)
	$(CC) $(CFLAGS) $(HOST_SANITIZE) $(HOST_INCLUDE) $< $(filter $(BUILD)/sanitize/port/% $(BUILD)/sanitize/src/%,$(HOST_SANITIZED)) \
	  $(HOST_TEST_LIBS) -o $@

# --- generated headers -----------------------------------------------------------------------------------------------------

$(BUILD)/host/projectile.json: $(PROGRAM)
	@mkdir -p $(@D)
	$(PROGRAM) scenario projectile --nodes 6 --seed 3 > $@

$(BUILD)/host/mixed.json: $(HOST_TEST)/mixed.json
	@mkdir -p $(@D)
	cp $< $@

# $(1) network, $(2) bits, $(3) folder below BUILD, $(4) program: headers in $(3)/host/$(1)-$(2), the log beside them.
define HOST_NETWORK
$$(BUILD)/$(3)host/$(1)-$(2).cbor: $$(BUILD)/host/$(1).json $(4)
	@rm -rf $$(@:.cbor=) && mkdir -p $$(@D)
	$(4) design $$< --c-header $$(@:.cbor=) --real float$(2) > $$(@:.cbor=.txt)
	$(4) simulate $$< --filter rkfdnu2 --loss 0.25 --steps 200 --real float$(2) --out $$@.made > $$(@:.cbor=.run.txt)
	@mv $$@.made $$@
endef

# $(1) name, $(2) bits, $(3) folder below BUILD, $(4) library files, $(5) flags, $(6) kernel: unrolled or shared.
define HOST_HEADER_TEST
$$(BUILD)/$(3)host/header-$(1)-$(2)-$(6): $(HOST_TEST)/test_header.c $$(BUILD)/$(3)host/$(1)-$(2).cbor $(4)
	$$(CC) $$(CFLAGS) $(5) $$(HOST_INCLUDE) -I$$(BUILD)/$(3)host/$(1)-$(2) -DHEADER_BITS=$(2) $(if $(filter shared,$(6)),-DHEADER_SHARED) \
	  $$< $(4) -lcmocka -lcbor -lm -o $$@
endef

HOST_SANITIZED_LIBRARY = $(BUILD)/sanitize/src/meshkal/meshkal.o
$(foreach n,projectile mixed,$(foreach b,32 64,$(eval $(call HOST_NETWORK,$(n),$(b),,$$(PROGRAM)))))
$(foreach n,projectile mixed,$(foreach b,32 64,$(eval $(call HOST_NETWORK,$(n),$(b),sanitize/,$$(BUILD)/sanitize/meshkal))))
$(foreach n,projectile mixed,$(foreach b,32 64,$(foreach k,unrolled shared,$(eval $(call HOST_HEADER_TEST,$(n),$(b),,$$(LIBRARY),,$(k))))))
$(foreach b,32 64,$(eval $(call HOST_HEADER_TEST,mixed,$(b),sanitize/,$$(HOST_SANITIZED_LIBRARY),$$(HOST_SANITIZE),unrolled)))
$(foreach b,32 64,$(eval $(call HOST_HEADER_TEST,projectile,$(b),sanitize/,$$(HOST_SANITIZED_LIBRARY),$$(HOST_SANITIZE),shared)))

HOST_NETWORKS = $(foreach n,projectile mixed,$(foreach b,32 64,$(n)-$(b)))
HOST_HEADER_TESTS = $(foreach n,$(HOST_NETWORKS),$(BUILD)/host/header-$(n)-unrolled $(BUILD)/host/header-$(n)-shared) \
  $(foreach b,32 64,$(BUILD)/sanitize/host/header-mixed-$(b)-unrolled $(BUILD)/sanitize/host/header-projectile-$(b)-shared)

# Each header alone, as firmware might include it: strict C99 and C++17. A file that includes it stands for the firmware's.
HOST_STRICT = -Wall -Wextra -Wconversion -Wdouble-promotion -Werror -pedantic -fsyntax-only -Iinclude -Isrc
HOST_ALONE = $(HOST_NETWORKS:%=$(BUILD)/host/%.alone)
$(BUILD)/host/%.alone: $(BUILD)/host/%.cbor
	@for f in $(@:.alone=)/node_*.h; do \
	  echo "#include \"$$f\"" | $(CC) $(HOST_STRICT) -std=c99 -x c - && echo "#include \"$$f\"" | $(CXX) $(HOST_STRICT) -std=c++17 -x c++ - || exit 1; \
	done
	@touch $@

# --- run -------------------------------------------------------------------------------------------------------------------

HOST_UNITS = $(foreach d,$(BUILD)/host $(BUILD)/sanitize/host,$(d)/test_host $(d)/test_dense)

.PHONY: test-host-c
test-host-c: $(HOST_UNITS) $(HOST_HEADER_TESTS) $(HOST_ALONE)
	@failed=; \
	run() { if "$$@" > $$1.txt 2>&1; then echo "$${1#$(BUILD)/}: $$(sed -n 's/^\[  PASSED  \] //p' $$1.txt)"; else cat $$1.txt; failed="$$failed $$1"; fi; }; \
	for t in $(HOST_UNITS); do run $$t; done; \
	for t in $(HOST_HEADER_TESTS); do log=$${t%-*}; run $$t $${log%/*}/$${log#*/header-}.cbor; done; \
	if [ -n "$$failed" ]; then echo "failed:$$failed"; exit 1; fi
