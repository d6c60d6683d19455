# SPDX-License-Identifier: MIT
# CMocka tests of the host side: included by the main Makefile, or alone:  make -f tests/host/host.mk test-host-c
# HOST_TEST_PROGRAMS need no arguments and run from the top of the tree; `test-host-c` builds and runs them, half of them with ASan
# and UBSan. The pytest tests of this folder run with MESHKAL=$(BUILD)/meshkal or $(BUILD)/sanitize/meshkal.

ifndef PROGRAM
BUILD ?= build
.PHONY: test-host-c
test-host-c:
	@$(MAKE) --no-print-directory -f Makefile BUILD=$(BUILD) $@
else

HOST_TEST := tests/host
HOST_PLAIN := $(BUILD)/test-host
HOST_SANE := $(BUILD)/test-host-sanitize
HOST_TEST_LIBS := -pthread -lcmocka -llapacke -ljansson -lcbor -lsodium -lm
SANITIZE ?= -O1 -fsanitize=address,undefined -fno-sanitize-recover=all

# Objects of port/host, of the program without its main, and the library, plain and sanitized.
HOST_PORT := $(patsubst %.c,%.o,$(filter-out %/main.c,$(wildcard port/host/*.c tools/meshkal/*.c tools/meshkal/*/*.c)))
HOST_PARTS := $(HOST_PORT:%=$(BUILD)/%) $(LIBRARY)
HOST_SANE_PARTS := $(HOST_PORT:%=$(BUILD)/sanitize/%) $(BUILD)/sanitize/libmeshkal.a

# The sanitized program is the main Makefile's own, in another place.
.PHONY: host-sanitize
host-sanitize:
	@$(MAKE) --no-print-directory BUILD=$(BUILD)/sanitize OPTIMISE="$(SANITIZE)" all
$(BUILD)/sanitize/meshkal $(HOST_SANE_PARTS): host-sanitize
	@true

# --- tests of C functions --------------------------------------------------------------------------------------------------

$(HOST_PLAIN)/test_%: $(HOST_TEST)/test_%.c $(HOST_PARTS) $(wildcard $(HOST_TEST)/*.h port/host/*.h tools/meshkal/*.h tools/meshkal/*/*.h)
	@mkdir -p $(@D)
	@echo "  LD $@"
	@$(CC) $(CFLAGS) $(HOST_INCLUDE) $< $(HOST_PARTS) $(HOST_TEST_LIBS) -o $@

$(HOST_SANE)/test_%: $(HOST_TEST)/test_%.c $(HOST_SANE_PARTS) $(wildcard $(HOST_TEST)/*.h port/host/*.h tools/meshkal/*.h tools/meshkal/*/*.h)
	@mkdir -p $(@D)
	@echo "  LD $@"
	@$(CC) $(CFLAGS) $(SANITIZE) $(HOST_INCLUDE) $< $(HOST_SANE_PARTS) $(HOST_TEST_LIBS) -o $@

# Both seals: that for targets, too.
HOST_SANITIZE = $(if $(filter $(HOST_SANE)/%,$@),$(SANITIZE))
HOST_AEAD_SOURCES := $(HOST_TEST)/test_aead.c port/monocypher/aead_monocypher.c port/host/aead_sodium.c port/host/error.c src/meshkal/meshkal.c
$(HOST_PLAIN)/monocypher.o $(HOST_SANE)/monocypher.o: $(MONOCYPHER)/monocypher.c Makefile
	@mkdir -p $(@D)
	@$(CC) $(CFLAGS) $(HOST_SANITIZE) -c $< -o $@
$(HOST_PLAIN)/test_aead $(HOST_SANE)/test_aead: %/test_aead: $(HOST_AEAD_SOURCES) %/monocypher.o \
		port/monocypher/aead_monocypher.h port/host/aead_sodium.h $(wildcard include/meshkal/*.h src/meshkal/*.h src/meshkal/*/*.h)
	@echo "  LD $@"
	@$(CC) $(CFLAGS) $(HOST_SANITIZE) $(HOST_INCLUDE) $(MONOCYPHER_INCLUDE) $(filter %.c %.o,$^) -lcmocka -lsodium -lm -o $@

# --- generated headers -----------------------------------------------------------------------------------------------------

$(HOST_PLAIN)/projectile.json: $(PROGRAM)
	@mkdir -p $(@D)
	@$(PROGRAM) scenario projectile --nodes 6 --seed 3 > $@.made
	@mv $@.made $@

$(HOST_PLAIN)/mixed.json: $(HOST_TEST)/mixed.json
	@mkdir -p $(@D)
	@cp $< $@

# $(1) network, $(2) bits, $(3) folder, $(4) program: headers in $(3)/$(1)-$(2), the log beside them.
define HOST_NETWORK
$(3)/$(1)-$(2).cbor: $(HOST_PLAIN)/$(1).json $(4)
	@rm -rf $(3)/$(1)-$(2) && mkdir -p $(3)
	@$(4) design $$< --c-header $(3)/$(1)-$(2) --real float$(2) > $(3)/$(1)-$(2).txt
	@$(4) simulate $$< --filter rkfdnu2 --loss 0.25 --steps 200 --real float$(2) --out $$@.made >> $(3)/$(1)-$(2).txt
	@mv $$@.made $$@
endef

# $(1) network, $(2) bits, $(3) folder, $(4) library, $(5) flags, $(6) kernels: unrolled or shared.
define HOST_HEADER
$(3)/header-$(1)-$(2)-$(6): $(HOST_TEST)/test_header.c $(3)/$(1)-$(2).cbor $(4)
	@echo "  LD $$@"
	@$(CC) $(CFLAGS) $(5) $(HOST_INCLUDE) -I$(3)/$(1)-$(2) -DHEADER_BITS=$(2) -DHEADER_LOG='"$(abspath $(3)/$(1)-$(2).cbor)"' \
	  $(if $(filter shared,$(6)),-DHEADER_SHARED) $$< $(4) -lcmocka -lcbor -lm -o $$@
endef

# The same with gains that freeze, as often as few losses let them.
$(HOST_PLAIN)/frozen.json: $(HOST_PLAIN)/projectile.json
	@cp $< $@
define HOST_FROZEN
$(3)/$(1)-$(2).cbor: $(HOST_PLAIN)/$(1).json $(4)
	@rm -rf $(3)/$(1)-$(2) && mkdir -p $(3)
	@$(4) design $$< --c-header $(3)/$(1)-$(2) --real float$(2) --frozen 0.01 > $(3)/$(1)-$(2).txt
	@$(4) simulate $$< --filter rkfdnu2 --loss 0.01 --steps 900 --real float$(2) --frozen 0.01 --out $$@.made >> $(3)/$(1)-$(2).txt
	@mv $$@.made $$@
endef

HOST_NETWORKS := frozen-32 frozen-64 projectile-32 projectile-64 mixed-32 mixed-64
HOST_EACH = $(foreach b,32 64,$(eval $(call $(1),$(2),$(b),$(3),$(4),$(5),$(6))))
HOST_BOTH = $(foreach n,projectile mixed,$(foreach b,32 64,$(eval $(call $(1),$(n),$(b),$(2),$(3),$(4),$(5)))))
$(call HOST_BOTH,HOST_NETWORK,$(HOST_PLAIN),$(PROGRAM))
$(call HOST_BOTH,HOST_NETWORK,$(HOST_SANE),$(BUILD)/sanitize/meshkal)
$(call HOST_BOTH,HOST_HEADER,$(HOST_PLAIN),$(LIBRARY),,unrolled)
$(call HOST_BOTH,HOST_HEADER,$(HOST_PLAIN),$(LIBRARY),,shared)
$(call HOST_BOTH,HOST_HEADER,$(HOST_SANE),$(BUILD)/sanitize/libmeshkal.a,$(SANITIZE),shared)
$(call HOST_EACH,HOST_FROZEN,frozen,$(HOST_PLAIN),$(PROGRAM))
$(call HOST_EACH,HOST_FROZEN,frozen,$(HOST_SANE),$(BUILD)/sanitize/meshkal)
$(call HOST_EACH,HOST_HEADER,frozen,$(HOST_PLAIN),$(LIBRARY),-DHEADER_FROZEN,unrolled)
$(call HOST_EACH,HOST_HEADER,frozen,$(HOST_PLAIN),$(LIBRARY),-DHEADER_FROZEN,shared)
$(call HOST_EACH,HOST_HEADER,frozen,$(HOST_SANE),$(BUILD)/sanitize/libmeshkal.a,$(SANITIZE) -DHEADER_FROZEN,shared)

# The other compiler, against the log of the first.
HOST_CLANG := $(HOST_PLAIN)/header-frozen-32-clang $(HOST_PLAIN)/header-frozen-64-clang
$(HOST_CLANG): $(HOST_PLAIN)/header-%-clang: $(HOST_TEST)/test_header.c $(HOST_PLAIN)/%.cbor src/meshkal/meshkal.c
	@echo "  LD $@"
	@clang $(CFLAGS) $(HOST_INCLUDE) -I$(HOST_PLAIN)/$* -DHEADER_BITS=$(*:frozen-%=%) -DHEADER_LOG='"$(abspath $(HOST_PLAIN)/$*.cbor)"' \
	  -DHEADER_FROZEN $< src/meshkal/meshkal.c -lcmocka -lcbor -lm -o $@

# Each header alone, as firmware includes it: strict C99 and C++17.
HOST_STRICT := -Wall -Wextra -Wconversion -Wdouble-promotion -Werror -pedantic -fsyntax-only $(INCLUDE)
$(HOST_PLAIN)/%.alone: $(HOST_PLAIN)/%.cbor $(wildcard include/meshkal/*.h src/meshkal/*.h src/meshkal/*/*.h)
	@for f in $(HOST_PLAIN)/$*/node_*.h; do \
	  echo "#include \"$$f\"" | $(CC) $(HOST_STRICT) -std=c99 -x c - && echo "#include \"$$f\"" | $(CXX) $(HOST_STRICT) -std=c++17 -x c++ - || exit 1; \
	done
	@touch $@
$(HOST_NETWORKS:%=$(HOST_PLAIN)/header-%-shared): $(HOST_PLAIN)/header-%-shared: $(HOST_PLAIN)/%.alone

# --- run -------------------------------------------------------------------------------------------------------------------

HOST_C_TESTS := $(patsubst $(HOST_TEST)/%.c,%,$(filter-out %/test_header.c,$(wildcard $(HOST_TEST)/test_*.c)))
HOST_TEST_PROGRAMS := $(foreach d,$(HOST_PLAIN) $(HOST_SANE),$(HOST_C_TESTS:%=$(d)/%) $(HOST_NETWORKS:%=$(d)/header-%-shared)) \
  $(HOST_NETWORKS:%=$(HOST_PLAIN)/header-%-unrolled) $(HOST_CLANG)
TEST_ITEMS += $(HOST_TEST_PROGRAMS)

.PHONY: test-host-c
test-host-c: $(HOST_TEST_PROGRAMS)
	@failed=; for t in $^; do \
	  if $$t > $$t.log 2>&1; then sed -n "s,^\[  PASSED  \],$${t#$(BUILD)/}:,p" $$t.log; else cat $$t.log; failed="$$failed $$t"; fi; \
	done; if [ -n "$$failed" ]; then echo "failed:$$failed"; exit 1; fi

endif
