# SPDX-License-Identifier: MIT
# Bare-metal images for six targets and their tests under emulation: included by the main Makefile.
#   make firmware        every image, build/firmware/TARGET/NAME.elf
#   make test-firmware   runs them, checks their symbols; last line: N passed, N failed
#
# To add an image, anywhere after this file is included:
#   $(eval $(call FIRMWARE_IMAGE,NAME,SOURCES,FLAGS,PREREQUISITES,TARGETS))
# NAME.elf is SOURCES (C files), the library and the port, for TARGETS (default: all six). FLAGS (-I, -D) are for its own sources only,
# which are compiled after PREREQUISITES (generated headers) are made; FIRMWARE_LINK_NAME, set before, is for the linker. An image named
# *-f32 promises single precision: where the hardware has no other, its symbols are checked for that. To run it as a test:
#   $(eval $(call FIRMWARE_TEST,NAME,ARGUMENTS,STATUS,TEXT,AFTER))
# (add files that it reads to FIRMWARE_DATA) passes on every target of the image if it exits with STATUS (default 0) and, where given, writes
# TEXT and then the host's command AFTER succeeds. ARGUMENTS: words of its command line, no commas. Arguments of FIRMWARE_ macros contain no vertical bars.

FIRMWARE := $(BUILD)/firmware

# --- the targets: compiler, code, port, board, emulator --------------------------------------------------------------------

FIRMWARE_TARGETS := m0 m4f m7 m33 rv32imac rv32imafc
# What the hardware calculates: float, or float and double; the others neither.
FIRMWARE_SINGLE := m4f m33 rv32imafc
FIRMWARE_DOUBLE := m7

FIRMWARE_ARM := m0 m4f m7 m33
FIRMWARE_RISCV := rv32imac rv32imafc
$(foreach t,$(FIRMWARE_ARM),$(eval FIRMWARE_PORT_$(t) := cortex-m)$(eval FIRMWARE_PREFIX_$(t) := arm-none-eabi-))
$(foreach t,$(FIRMWARE_RISCV),$(eval FIRMWARE_PORT_$(t) := riscv)$(eval FIRMWARE_PREFIX_$(t) := riscv64-unknown-elf-))

FIRMWARE_CODE_m0        := -mthumb -mcpu=cortex-m0 -mfloat-abi=soft
FIRMWARE_CODE_m4f       := -mthumb -mcpu=cortex-m4 -mfpu=fpv4-sp-d16 -mfloat-abi=hard
FIRMWARE_CODE_m7        := -mthumb -mcpu=cortex-m7 -mfpu=fpv5-d16 -mfloat-abi=hard
FIRMWARE_CODE_m33       := -mthumb -mcpu=cortex-m33 -mfpu=fpv5-sp-d16 -mfloat-abi=hard
FIRMWARE_CODE_rv32imac  := -march=rv32imac -mabi=ilp32
FIRMWARE_CODE_rv32imafc := -march=rv32imafc -mabi=ilp32f

FIRMWARE_BOARD_m0  := microbit
FIRMWARE_BOARD_m4f := mps2-an386
FIRMWARE_BOARD_m7  := mps2-an500
FIRMWARE_BOARD_m33 := mps2-an505
$(foreach t,$(FIRMWARE_RISCV),$(eval FIRMWARE_BOARD_$(t) := virt))

# Append ",arg=NAME,arg=..." for a command line, then -kernel IMAGE. The image's console is the emulator's standard error.
FIRMWARE_SEMIHOST := -nographic -monitor none -serial none -semihosting-config enable=on,target=native
$(foreach t,$(FIRMWARE_ARM),$(eval FIRMWARE_QEMU_$(t) := qemu-system-arm -M $(FIRMWARE_BOARD_$(t)) $(FIRMWARE_SEMIHOST)))
$(foreach t,$(FIRMWARE_RISCV),$(eval FIRMWARE_QEMU_$(t) := qemu-system-riscv32 -M virt -bios none $(FIRMWARE_SEMIHOST)))

# --- objects and images ----------------------------------------------------------------------------------------------------

# -fno-math-errno: square roots are one instruction where there is one, without the library's call for errno. No other difference.
FIRMWARE_CFLAGS = --specs=picolibc.specs -std=c99 -Os -g $(ARITHMETIC) -fno-math-errno -ffunction-sections -fdata-sections $(WARNINGS)
FIRMWARE_INCLUDE = $(INCLUDE) -Iport/bare -Iport/$(FIRMWARE_PORT_$(1))
FIRMWARE_PORT_SOURCES = $(wildcard port/bare/*.c port/$(FIRMWARE_PORT_$(1))/*.c port/$(FIRMWARE_PORT_$(1))/*.S)
FIRMWARE_PORT_OBJECTS = $(patsubst %,$(FIRMWARE)/$(1)/%.o,$(basename $(call FIRMWARE_PORT_SOURCES,$(1))))
FIRMWARE_RULES := Makefile tests/firmware/firmware.mk

# $(1): target. Port and library, once for all images.
define FIRMWARE_TARGET
$(FIRMWARE)/$(1)/port/%.o: port/%.c $(FIRMWARE_RULES) | $(SETUP)
	@mkdir -p $$(@D)
	@$(FIRMWARE_PREFIX_$(1))gcc $(FIRMWARE_CODE_$(1)) $$(FIRMWARE_CFLAGS) $(call FIRMWARE_INCLUDE,$(1)) -MMD -MP -c $$< -o $$@
$(FIRMWARE)/$(1)/port/%.o: port/%.S $(FIRMWARE_RULES) | $(SETUP)
	@mkdir -p $$(@D)
	@$(FIRMWARE_PREFIX_$(1))gcc $(FIRMWARE_CODE_$(1)) -c $$< -o $$@
$(FIRMWARE)/$(1)/meshkal.o: src/meshkal/meshkal.c $(FIRMWARE_RULES) | $(SETUP)
	@mkdir -p $$(@D)
	@echo "  CC $$@"
	@$(FIRMWARE_PREFIX_$(1))gcc $(FIRMWARE_CODE_$(1)) $$(FIRMWARE_CFLAGS) $(INCLUDE) -MMD -MP -c $$< -o $$@
-include $(FIRMWARE)/$(1)/meshkal.d $(patsubst %.o,%.d,$(call FIRMWARE_PORT_OBJECTS,$(1)))
endef
$(foreach t,$(FIRMWARE_TARGETS),$(eval $(call FIRMWARE_TARGET,$(t))))

# $(1): name, $(2): sources, $(3): flags, $(4): prerequisites, $(5): target.
define FIRMWARE_IMAGE_FOR
$(patsubst %.c,$(FIRMWARE)/$(5)/$(1)/%.o,$(2)): $(FIRMWARE)/$(5)/$(1)/%.o: %.c $(FIRMWARE_RULES) $(4) | $(SETUP)
	@mkdir -p $$(@D)
	@$(FIRMWARE_PREFIX_$(5))gcc $(FIRMWARE_CODE_$(5)) $$(FIRMWARE_CFLAGS) $(call FIRMWARE_INCLUDE,$(5)) $(3) -MMD -MP -c $$< -o $$@
$(FIRMWARE)/$(5)/$(1).elf: $(patsubst %.c,$(FIRMWARE)/$(5)/$(1)/%.o,$(2)) $(FIRMWARE)/$(5)/meshkal.o $(call FIRMWARE_PORT_OBJECTS,$(5)) \
		port/bare/image.ld port/$(FIRMWARE_PORT_$(5))/$(FIRMWARE_BOARD_$(5)).ld
	@echo "  LD $$@"
	@$(FIRMWARE_PREFIX_$(5))gcc $(FIRMWARE_CODE_$(5)) --specs=picolibc.specs -nostartfiles -Wl,--gc-sections -Wl,--fatal-warnings -Lport/bare \
	  -Tport/$(FIRMWARE_PORT_$(5))/$(FIRMWARE_BOARD_$(5)).ld -Wl,-Map=$(FIRMWARE)/$(5)/$(1).map $(FIRMWARE_LINK_$(1)) $$(filter %.o,$$^) -o $$@
-include $(patsubst %.c,$(FIRMWARE)/$(5)/$(1)/%.d,$(2))
FIRMWARE_IMAGES += $(FIRMWARE)/$(5)/$(1).elf
endef
define FIRMWARE_IMAGE
FIRMWARE_TARGETS_$(1) := $(or $(strip $(5)),$(FIRMWARE_TARGETS))
$(foreach t,$(or $(strip $(5)),$(FIRMWARE_TARGETS)),$(eval $(call FIRMWARE_IMAGE_FOR,$(1),$(2),$(3),$(4),$(t))))
endef

# A line of the plan for each target: target, image, arguments, status, text.
define FIRMWARE_TEST
FIRMWARE_PLAN += $(foreach t,$(FIRMWARE_TARGETS_$(1)),'$(t)|$(1)|$(strip $(2))|$(or $(strip $(3)),0)|$(strip $(4))|$(strip $(5))')
endef

# --- the images ------------------------------------------------------------------------------------------------------------

# The port itself, and that an image in trouble ends with a failure.
$(eval $(call FIRMWARE_IMAGE,startup,tests/firmware/startup.c))
$(eval $(call FIRMWARE_TEST,startup,file $(FIRMWARE)/startup.txt))
$(eval $(call FIRMWARE_TEST,startup,status,7))
$(eval $(call FIRMWARE_TEST,startup,instruction,99,fault: ))
$(eval $(call FIRMWARE_TEST,startup,overflow,99,stack overflow))
$(eval $(call FIRMWARE_TEST,startup,below-ram,99,fault: ))

# The library's test vectors: the host's program writes what it found, the image reads that and finds the same.
# Both builds of the host must agree, one of them with the sanitizers. $(1): NAME, of images NAME-f32 and NAME-f64, $(2): sources, $(3): flags, $(4): more
# sources, flags and libraries of the host's, $(5): more sources of the image, $(6): prerequisites, $(7): bits.
FIRMWARE_VECTORS_SOURCES := tests/firmware/vectors_draw.c
define FIRMWARE_VECTORS_FOR
$(FIRMWARE)/$(1)_write-$(7) $(FIRMWARE)/$(1)_write-$(7)-sanitize: $(2) $(filter %.c,$(4)) $(FIRMWARE_VECTORS_SOURCES) tests/firmware/vectors_write.c \
		src/meshkal/meshkal.c tests/firmware/vectors.h $(wildcard include/meshkal/*.h src/meshkal/*.h src/meshkal/*/*.h) Makefile $(6) | $(SETUP)
	@mkdir -p $$(@D)
	@$$(CC) $$(CFLAGS) $$(if $$(filter %-sanitize,$$@),$$(SANITIZE)) $(INCLUDE) -DVECTOR_BITS=$(7) $$(filter %.c,$$^) $(filter-out %.c,$(3) $(4)) -lm -o $$@
$(FIRMWARE)/$(1)-f$(7).bin: $(FIRMWARE)/$(1)_write-$(7) $(FIRMWARE)/$(1)_write-$(7)-sanitize
	@$$< > $$@.made && $$<-sanitize | cmp - $$@.made && mv $$@.made $$@
# The last number of all, one bit of it changed: that the image must see.
$(FIRMWARE)/$(1)-f$(7)-altered.bin: $(FIRMWARE)/$(1)-f$(7).bin
	@$(PYTHON) -c 'import sys; b = bytearray(sys.stdin.buffer.read()); b[-4] ^= 1; sys.stdout.buffer.write(b)' < $$< > $$@
FIRMWARE_DATA += $(FIRMWARE)/$(1)-f$(7).bin $(FIRMWARE)/$(1)-f$(7)-altered.bin
$(eval $(call FIRMWARE_IMAGE,$(1)-f$(7),$(2) $(5) $(FIRMWARE_VECTORS_SOURCES) tests/firmware/vectors_compare.c,$(3) -DVECTOR_BITS=$(7),$(6)))
$(eval $(call FIRMWARE_TEST,$(1)-f$(7),$(FIRMWARE)/$(1)-f$(7).bin,0,words agree))
$(eval $(call FIRMWARE_TEST,$(1)-f$(7),$(FIRMWARE)/$(1)-f$(7)-altered.bin,1,differs))
endef
FIRMWARE_VECTORS = $(foreach b,32 64,$(eval $(call FIRMWARE_VECTORS_FOR,$(1),$(2),$(3),$(4),$(5),$(6),$(b))))
$(call FIRMWARE_VECTORS,vectors,tests/firmware/vectors.c tests/firmware/vectors_models.c)
$(call FIRMWARE_VECTORS,unscented,tests/firmware/vectors_unscented.c)
$(call FIRMWARE_VECTORS,monitor,tests/firmware/vectors_monitor.c)
# 17 states in float64: all of the smallest target's memory, less what these filters leave of the stack.
FIRMWARE_LINK_weighted-f64 := -Wl,--defsym=mk_stack_size=0x0a00
$(call FIRMWARE_VECTORS,weighted,tests/firmware/vectors_weighted.c)

# A network whose nodes all run in one image: headers of meshkal design, readings and losses of meshkal simulate.
define FIRMWARE_NETWORK
$(FIRMWARE)/network-f$(1)/network_data.h: tests/firmware/network_data.py tests/firmware/firmware.mk tools/rerun/meshkal_log/reader.py $(PROGRAM)
	@mkdir -p $$(@D)
	@$(PROGRAM) scenario projectile --nodes 6 --seed 3 > $$(@D)/scenario.json
	@$(PROGRAM) design $$(@D)/scenario.json --c-header $$(@D) --real float$(1) > $$(@D)/design.txt
	@$(PROGRAM) simulate $$(@D)/scenario.json --filter rkfdnu2 --loss 0.2 --steps 200 --real float$(1) --out $$(@D)/run.cbor > $$(@D)/simulate.txt
	@PYTHONPATH=tools/rerun $(PYTHON) $$< $$(@D)/run.cbor $$@.made && mv $$@.made $$@
endef
$(foreach b,32 64,$(eval $(call FIRMWARE_NETWORK,$(b)))\
  $(eval $(call FIRMWARE_IMAGE,network-f$(b),tests/firmware/network.c,-DNETWORK_BITS=$(b) -I$(FIRMWARE)/network-f$(b),$(FIRMWARE)/network-f$(b)/network_data.h))\
  $(eval $(call FIRMWARE_TEST,network-f$(b),,0,numbers agree))\
  $(eval $(call FIRMWARE_TEST,network-f$(b),altered,1,differs)))

include tests/firmware/replay.mk tests/firmware/duif.mk

# --- run -------------------------------------------------------------------------------------------------------------------

# What firmware.sh reads. A table of the targets: name, emulator, prefix of the tools, its floating-point hardware.
FIRMWARE_TABLE = $(foreach t,$(FIRMWARE_TARGETS),'$(t)|$(FIRMWARE_QEMU_$(t))|$(FIRMWARE_PREFIX_$(t))|$(if $(filter $(t),$(FIRMWARE_SINGLE)),single)$(if $(filter $(t),$(FIRMWARE_DOUBLE)),double)')

TEST_ITEMS += sh:tests/firmware/firmware.sh
TEST_NEEDS += firmware
.PHONY: firmware test-firmware
# The list is complete when the recipe runs: images that other files add count too.
firmware: ## bare-metal images for six targets, build/firmware/TARGET/NAME.elf
	@$(MAKE) -s -j2 --no-print-directory $(FIRMWARE_IMAGES) $(FIRMWARE_DATA)
	@printf '%s\n' $(FIRMWARE_TABLE) > $(FIRMWARE)/targets
	@printf '%s\n' $(FIRMWARE_PLAN) > $(FIRMWARE)/plan

test-firmware: firmware ## the images under emulation and their symbols
	@sh tests/firmware/firmware.sh $(BUILD) | tee $(FIRMWARE)/results
	@awk '/^ok/ {good++} /^not ok/ {bad++} END {print good + 0 " passed, " bad + 0 " failed"; exit bad > 0 || good == 0}' $(FIRMWARE)/results
