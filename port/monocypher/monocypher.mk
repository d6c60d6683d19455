# SPDX-License-Identifier: MIT
# The sources of Monocypher, fetched once and checked against their hash: included by the main Makefile.

MONOCYPHER := $(BUILD)/monocypher
MONOCYPHER_SOURCES := $(MONOCYPHER)/monocypher.c port/monocypher/aead_monocypher.c
# It is not written for our warnings.
$(BUILD)/%/monocypher.o: WARNINGS :=
MONOCYPHER_INCLUDE := -Iport/monocypher -isystem $(MONOCYPHER)

# pip asks a source package for its name, which takes the setuptools of the environment.
$(MONOCYPHER)/monocypher.c: port/monocypher/requirements.txt | $(SETUP)
	@rm -rf $(@D) && mkdir -p $(@D)
	@echo "  GET $@"
	@$(PYTHON) -m pip download --quiet --disable-pip-version-check --no-deps --no-build-isolation --no-binary pymonocypher \
	  --require-hashes --dest $(@D) -r $<
	@tar -xzf $(@D)/*.tar.gz -C $(@D) --strip-components=1 --no-same-owner --wildcards '*/monocypher.[ch]'
	@touch $@
$(MONOCYPHER)/monocypher.h: $(MONOCYPHER)/monocypher.c
