# SPDX-License-Identifier: MIT
# A node that seals and opens frames on every target: included by the main Makefile after firmware.mk, monocypher.mk and size.mk.
#   make sealed-size     what sealing costs on every target: a table

SEALED := $(FIRMWARE)/sealed
SEALED_SOURCE := tests/firmware/sealed

$(SEALED)/node_00.h: $(SEALED_SOURCE)/sealed.mk $(PROGRAM)
	@mkdir -p $(@D)
	@$(PROGRAM) scenario projectile --nodes 2 --seed 3 > $(@D)/scenario.json
	@$(PROGRAM) design $(@D)/scenario.json --c-header $(@D) --real float32 > $(@D)/design.txt
$(SEALED)/sealed_write $(SEALED)/sealed_write-sanitize: $(SEALED_SOURCE)/write.c port/host/aead_sodium.c port/host/error.c \
		src/meshkal/meshkal.c $(SEALED_SOURCE)/sealed.h port/host/aead_sodium.h $(SEALED)/node_00.h \
		$(wildcard include/meshkal/*.h src/meshkal/*.h src/meshkal/*/*.h) Makefile
	@$(CC) $(CFLAGS) $(if $(filter %-sanitize,$@),$(SANITIZE)) $(HOST_INCLUDE) -I$(SEALED) $(filter %.c,$^) -lsodium -lm -o $@
$(SEALED)/sealed.bin: $(SEALED)/sealed_write $(SEALED)/sealed_write-sanitize
	@$< > $@.made && $<-sanitize | cmp - $@.made && mv $@.made $@
# One bit of the last frame, which node 0 has to send: that the image must see.
$(SEALED)/sealed-altered.bin: $(SEALED)/sealed.bin
	@$(PYTHON) -c 'import sys; b = bytearray(sys.stdin.buffer.read()); b[-4] ^= 1; sys.stdout.buffer.write(b)' < $< > $@
FIRMWARE_DATA += $(SEALED)/sealed.bin $(SEALED)/sealed-altered.bin

$(eval $(call FIRMWARE_IMAGE,sealed-f32,$(SEALED_SOURCE)/main.c $(MONOCYPHER_SOURCES),-I$(SEALED) $(MONOCYPHER_INCLUDE),\
  $(SEALED)/node_00.h $(MONOCYPHER)/monocypher.h))
$(eval $(call FIRMWARE_TEST,sealed-f32,$(SEALED)/sealed.bin,0,frames agree))
$(eval $(call FIRMWARE_TEST,sealed-f32,$(SEALED)/sealed-altered.bin,1,frame differs))

TEST_ITEMS += sh:$(SEALED_SOURCE)/sealed.sh
.PHONY: sealed-size
sealed-size: firmware $(SIZE)/count.so ## what sealing a frame costs on six targets: a table
	@$(PYTHON) $(SEALED_SOURCE)/size.py $(BUILD)
