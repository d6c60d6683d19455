# SPDX-License-Identifier: MIT
# Tests of what users are handed: included by the main Makefile.

TEST_ITEMS += $(filter-out sh:%/check.sh,$(patsubst %,sh:%,$(sort $(wildcard tests/package/*.sh))))
TEST_NEEDS += package-tools

# Made once; the scripts ask for it by name.
package-tools: $(BUILD)/package-tools/done
.PHONY: package-tools
$(BUILD)/package-tools/done: tests/package/requirements.txt | $(SETUP)
	@rm -rf $(@D) && python3 -m venv $(@D)
	@$(@D)/bin/python -m pip install --quiet --disable-pip-version-check -r $<
	@touch $@
