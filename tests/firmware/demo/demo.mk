# SPDX-License-Identifier: MIT
# A network of emulated boards: included by the main Makefile, after firmware.mk.
#   make demo-firmware        200 steps; table, build/demo/run.cbor. DEMO_OPTIONS="--reboot", "--help" for the others
#   make test-demo-firmware   its tests alone; `make test` has them, too

DEMO := $(BUILD)/demo
DEMO_SOURCE := tests/firmware/demo
DEMO_COMMON := $(DEMO_SOURCE)/main.c $(DEMO_SOURCE)/radio.c
DEMO_NODES := 00 01 02 03 04 05
DEMO_HEADERS := $(DEMO_NODES:%=$(DEMO)/headers/node_%.h)
DEMO_HOST_NODES := $(DEMO_NODES:%=$(DEMO)/host/node-%)
DEMO_IMAGES := $(DEMO_NODES:%=$(FIRMWARE)/m4f/demo-%-f32.elf)

# Scenario and headers are made again with every change of the program; one that comes out as before keeps its date.
$(DEMO)/checked: $(PROGRAM)
	@mkdir -p $(DEMO)/headers $(DEMO)/new
	@$(PROGRAM) scenario projectile --nodes $(words $(DEMO_NODES)) --seed 3 > $(DEMO)/new/scenario.json
	@$(PROGRAM) design $(DEMO)/new/scenario.json --real float32 --c-header $(DEMO)/new/headers > $(DEMO)/design.txt
	@cd $(DEMO)/new && for f in scenario.json headers/*; do cmp -s $$f ../$$f || mv $$f ../$$f || exit 1; done
	@rm -rf $(DEMO)/new && touch $@
$(DEMO_HEADERS): $(DEMO)/checked
	@:

$(foreach k,$(DEMO_NODES),$(eval $(call FIRMWARE_IMAGE,demo-$(k)-f32,$(DEMO_COMMON) $(DEMO_SOURCE)/link_mps2.c port/cortex-m/mps2/lan9118.c,\
  -Iport/cortex-m/mps2 -I$(DEMO)/headers -DNODE=$(k),$(DEMO)/headers/node_$(k).h,m4f)))

# The same nodes on the host.
$(DEMO)/host/node-%: $(DEMO)/headers/node_%.h $(DEMO_COMMON) $(DEMO_SOURCE)/link_host.c $(wildcard $(DEMO_SOURCE)/*.h) $(LIBRARY)
	@mkdir -p $(@D)
	@echo "  LD $@"
	@$(CC) $(CFLAGS) $(INCLUDE) -I$(DEMO)/headers -DNODE=$* $(filter %.c,$^) $(LIBRARY) -lm -o $@

TEST_ITEMS += sh:$(DEMO_SOURCE)/demo.sh
TEST_NEEDS += demo-firmware-parts
.PHONY: demo-firmware demo-firmware-parts test-demo-firmware
demo-firmware-parts: $(PROGRAM) $(DEMO_IMAGES) $(DEMO_HOST_NODES)
	@echo "$(FIRMWARE_QEMU_m4f)" > $(DEMO)/emulator

demo-firmware: demo-firmware-parts ## six emulated boards on lossy links, bit for bit the simulator: table, build/demo/run.cbor
	@$(PYTHON) $(DEMO_SOURCE) --build $(BUILD) $(DEMO_OPTIONS)

test-demo-firmware: demo-firmware-parts ## the tests of the emulated boards
	@sh $(DEMO_SOURCE)/demo.sh $(BUILD) | tee $(DEMO)/results
	@! grep -q '^not ok' $(DEMO)/results
