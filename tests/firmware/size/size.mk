# SPDX-License-Identifier: MIT
# Flash, RAM, stack and instructions of a node on every target: included by the main Makefile after firmware.mk.
#   make size            the table (Markdown), build/size/size.json
#   make size-limits     takes what is measured as the new limits: tests/firmware/size/limits.json

SIZE := $(BUILD)/size

# The call graph with the frame of each function, beside every object.
FIRMWARE_CFLAGS += -fcallgraph-info=su

# n-m-slots-real-kernels for each target.
SIZE_FLOAT32 := 4-1-4-f32-unrolled 6-2-8-f32-unrolled 9-3-8-f32-shared 17-8-1-f32-shared
SIZE_FLOAT64 := 4-1-4-f64-unrolled 6-2-8-f64-unrolled 9-3-8-f64-shared 17-8-1-f64-shared
$(foreach t,$(FIRMWARE_TARGETS),$(eval SIZE_SHAPES_$(t) := $(SIZE_FLOAT32)))
SIZE_SHAPES_m7 += $(SIZE_FLOAT64)
SIZE_SHAPES_m0 += 6-2-8-f32-shared
SIZE_SHAPES_m4f += 4-1-4-f32-shared 6-2-8-f32-shared 9-3-8-f32-unrolled

size_word = $(word $(2),$(subst -, ,$(1)))
# $(1): target, $(2): shape.
define SIZE_IMAGE
$(call FIRMWARE_IMAGE_FOR,size-$(2),tests/firmware/size/main.c tests/firmware/size/node.c,-DSIZE_N=$(call size_word,$(2),1) \
  -DSIZE_M=$(call size_word,$(2),2) -DSIZE_SLOTS=$(call size_word,$(2),3) -DSIZE_BITS=$(patsubst f%,%,$(call size_word,$(2),4)) \
  -DSIZE_UNROLLED=$(if $(filter unrolled,$(call size_word,$(2),5)),1,0),,$(1))
SIZE_IMAGES += $(FIRMWARE)/$(1)/size-$(2).elf
SIZE_PLAN += '$(1)|$(2)|$(FIRMWARE_PREFIX_$(1))|$(FIRMWARE_QEMU_$(1))'
endef
# Filters of the unscented family, float32, on one target.
SIZE_UNSCENTED := 4-1-3-f32-shared 4-1-3-f32-unrolled 6-3-4-f32-shared
define SIZE_UNSCENTED_IMAGE
$(call FIRMWARE_IMAGE_FOR,size-unscented-$(2),tests/firmware/size/unscented.c tests/firmware/size/unscented_node.c,-DSIZE_N=$(call size_word,$(2),1) \
  -DSIZE_M=$(call size_word,$(2),2) -DSIZE_SLOTS=$(call size_word,$(2),3) -DSIZE_BITS=32 \
  -DSIZE_UNROLLED=$(if $(filter unrolled,$(call size_word,$(2),5)),1,0),,$(1))
SIZE_IMAGES += $(FIRMWARE)/$(1)/size-unscented-$(2).elf
SIZE_PLAN += '$(1)|unscented-$(2)|$(FIRMWARE_PREFIX_$(1))|$(FIRMWARE_QEMU_$(1))'
endef
# A node of the distributed unscented information filter.
define SIZE_DUIF_IMAGE
$(call FIRMWARE_IMAGE_FOR,size-duif-$(2),tests/firmware/size/duif.c tests/firmware/size/duif_node.c,-DSIZE_N=$(call size_word,$(2),1) \
  -DSIZE_M=$(call size_word,$(2),2) -DSIZE_SLOTS=$(call size_word,$(2),3),,$(1))
SIZE_IMAGES += $(FIRMWARE)/$(1)/size-duif-$(2).elf
SIZE_PLAN += '$(1)|duif-$(2)|$(FIRMWARE_PREFIX_$(1))|$(FIRMWARE_QEMU_$(1))'
endef
# The integrity monitor, places-m-window, and an extended filter with and without row weights.
SIZE_MONITOR := 6-2-10-f32 8-1-10-f32 16-1-10-f32
define SIZE_MONITOR_IMAGE
$(call FIRMWARE_IMAGE_FOR,size-monitor-$(2),tests/firmware/size/monitor.c tests/firmware/size/monitor_node.c,-DSIZE_PLACES=$(call size_word,$(2),1) \
  -DSIZE_M=$(call size_word,$(2),2) -DSIZE_WINDOW=$(call size_word,$(2),3),,$(1))
SIZE_IMAGES += $(FIRMWARE)/$(1)/size-monitor-$(2).elf
SIZE_PLAN += '$(1)|monitor-$(2)|$(FIRMWARE_PREFIX_$(1))|$(FIRMWARE_QEMU_$(1))'
endef
define SIZE_WEIGHTED_IMAGE
$(call FIRMWARE_IMAGE_FOR,size-weighted-$(2),tests/firmware/size/weighted.c tests/firmware/size/unscented_node.c,-DSIZE_N=$(call size_word,$(2),1) \
  -DSIZE_M=$(call size_word,$(2),2) -DSIZE_SLOTS=$(call size_word,$(2),3) -DSIZE_BITS=32 -DSIZE_UNROLLED=0,,$(1))
SIZE_IMAGES += $(FIRMWARE)/$(1)/size-weighted-$(2).elf
SIZE_PLAN += '$(1)|weighted-$(2)|$(FIRMWARE_PREFIX_$(1))|$(FIRMWARE_QEMU_$(1))'
endef
# Not among the images of make firmware.
SIZE_OTHERS := $(FIRMWARE_IMAGES)
$(foreach t,$(FIRMWARE_TARGETS),$(foreach s,$(SIZE_SHAPES_$(t)),$(eval $(call SIZE_IMAGE,$(t),$(s)))))
$(foreach s,$(SIZE_UNSCENTED),$(eval $(call SIZE_UNSCENTED_IMAGE,m4f,$(s))))
$(eval $(call SIZE_DUIF_IMAGE,m4f,4-1-4-f32-shared))
$(foreach s,$(SIZE_MONITOR),$(eval $(call SIZE_MONITOR_IMAGE,m4f,$(s))))
$(eval $(call SIZE_WEIGHTED_IMAGE,m4f,17-1-8-f32-shared))
FIRMWARE_IMAGES := $(SIZE_OTHERS)

$(SIZE)/count.so: tests/firmware/size/count.c Makefile | $(SETUP)
	@mkdir -p $(@D)
	@$(CC) $(CFLAGS) -fPIC -shared $< -o $@

TEST_ITEMS += sh:tests/firmware/size/size.sh
TEST_NEEDS += size-images
.PHONY: size size-limits size-images
size-images: $(SIZE_IMAGES) $(SIZE)/count.so
	@printf '%s\n' $(SIZE_PLAN) > $(SIZE)/plan

size: ## flash, RAM, stack and instructions of a node on six targets: a table, build/size/size.json
	@$(MAKE) -s --no-print-directory -j2 size-images
	@$(PYTHON) tests/firmware/size/size.py $(BUILD)

size-limits: size ## takes what is measured as the new limits of flash, RAM, stack and instructions
	@$(PYTHON) tests/firmware/size/size.py $(BUILD) --set-limits
