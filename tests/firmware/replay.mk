# SPDX-License-Identifier: MIT
# A node's record replayed on every target, and recorded there again: included by firmware.mk.

FIRMWARE_REPLAY_STEPS := 200

# $(1): bits, $(2): -changed for a record with one bit changed: that of x[2] of step 99 (the diffuse, item kind 6, number 99, byte 4 + 2 numbers).
define FIRMWARE_REPLAY
$(FIRMWARE)/replay$(2)-f$(1)/replay_data.h: tests/firmware/replay_data.py tests/firmware/replay.mk $(PROGRAM)
	@mkdir -p $$(@D)
	@$(PROGRAM) scenario projectile --nodes 6 --seed 3 > $$(@D)/scenario.json
	@$(PROGRAM) design $$(@D)/scenario.json --c-header $$(@D) --real float$(1) > $$(@D)/design.txt
	@$(PROGRAM) simulate $$(@D)/scenario.json --filter rkfdnu2 --loss 0.2 --steps $(FIRMWARE_REPLAY_STEPS) --real float$(1) \
	  --record $$(@D)/records > $$(@D)/simulate.txt
	@$(PYTHON) $$< $$(@D)/records/node_00.record $$@.made $(if $(2),6 99 $(if $(filter 32,$(1)),12,20)) && mv $$@.made $$@
endef
FIRMWARE_REPLAY_FLAGS = -DREPLAY_BITS=$(1) -DREPLAY_STEPS=$(FIRMWARE_REPLAY_STEPS) -I$(FIRMWARE)/replay$(2)-f$(1)
$(foreach b,32 64,$(eval $(call FIRMWARE_REPLAY,$(b)))$(eval $(call FIRMWARE_REPLAY,$(b),-changed)))
$(foreach b,32 64,\
  $(eval $(call FIRMWARE_IMAGE,replay-f$(b),tests/firmware/replay.c,$(call FIRMWARE_REPLAY_FLAGS,$(b),),$(FIRMWARE)/replay-f$(b)/replay_data.h))\
  $(eval $(call FIRMWARE_IMAGE,replay-changed-f$(b),tests/firmware/replay.c,$(call FIRMWARE_REPLAY_FLAGS,$(b),-changed),$(FIRMWARE)/replay-changed-f$(b)/replay_data.h,m0 rv32imafc))\
  $(eval $(call FIRMWARE_TEST,replay-f$(b),,0,values agree))\
  $(eval $(call FIRMWARE_TEST,replay-f$(b),$(FIRMWARE)/replay-f$(b).record,0,values agree,\
    cmp $(FIRMWARE)/replay-f$(b).record $(FIRMWARE)/replay-f$(b)/records/node_00.record && $(PROGRAM) replay $(FIRMWARE)/replay-f$(b).record))\
  $(eval $(call FIRMWARE_TEST,replay-changed-f$(b),,1,step 99: x[2] differs)))
