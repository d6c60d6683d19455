# SPDX-License-Identifier: MIT
# A network of emulated boards: included by the main Makefile, after firmware.mk.
#   make demo-firmware        200 steps; table, build/demo/run.cbor. DEMO_OPTIONS="--reboot", "--help" for the others
#   make test-demo-firmware   its tests alone; `make test` has them, too

DEMO := $(BUILD)/demo
DEMO_SOURCE := tests/firmware/demo
DEMO_NODES := 00 01 02 03 04 05
DEMO_HEADERS := $(DEMO)/headers/made
DEMO_HOST_NODES := $(DEMO_NODES:%=$(DEMO)/host/node-%)
DEMO_IMAGES := $(DEMO_NODES:%=$(FIRMWARE)/m4f/demo-%-f32.elf)

$(DEMO)/scenario.json: $(PROGRAM)
	@mkdir -p $(@D)
	@$(PROGRAM) scenario projectile --nodes $(words $(DEMO_NODES)) --seed 3 > $@.made && mv $@.made $@

$(DEMO_HEADERS): $(DEMO)/scenario.json
	@rm -rf $(@D) && $(PROGRAM) design $< --real float32 --c-header $(@D) > $(DEMO)/design.txt && touch $@

DEMO_COMMON := $(DEMO_SOURCE)/main.c $(DEMO_SOURCE)/radio.c
$(foreach k,$(DEMO_NODES),$(eval $(call FIRMWARE_IMAGE,demo-$(k)-f32,$(DEMO_COMMON) $(DEMO_SOURCE)/link_mps2.c port/cortex-m/mps2/lan9118.c,\
  -Iport/cortex-m/mps2 -I$(DEMO)/headers -DNODE=$(k),$(DEMO_HEADERS),m4f)))

# The same nodes on the host.
$(DEMO)/host/node-%: $(DEMO_COMMON) $(DEMO_SOURCE)/link_host.c $(wildcard $(DEMO_SOURCE)/*.h) $(DEMO_HEADERS) $(LIBRARY)
	@mkdir -p $(@D)
	@echo "  LD $@"
	@$(CC) $(CFLAGS) $(INCLUDE) -I$(DEMO)/headers -DNODE=$* $(filter %.c,$^) $(LIBRARY) -lm -o $@

.PHONY: demo-firmware demo-firmware-parts test-demo-firmware
demo-firmware-parts: $(PROGRAM) $(DEMO_IMAGES) $(DEMO_HOST_NODES)
	@echo "$(FIRMWARE_QEMU_m4f)" > $(DEMO)/emulator

demo-firmware: demo-firmware-parts ## six emulated boards on lossy links, bit for bit the simulator: table, build/demo/run.cbor
	@$(PYTHON) $(DEMO_SOURCE) --build $(BUILD) $(DEMO_OPTIONS)

test-demo-firmware: demo-firmware-parts
	@sh $(DEMO_SOURCE)/demo.sh $(BUILD) | tee $(DEMO)/results
	@! grep -q '^not ok' $(DEMO)/results
