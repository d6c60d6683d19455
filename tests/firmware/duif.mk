# SPDX-License-Identifier: MIT
# A network of information filters in one image: its vectors, and beside the simulator. Included by firmware.mk.

$(call FIRMWARE_VECTORS,duif,tests/firmware/vectors_duif.c,$(MONOCYPHER_INCLUDE),\
  tests/firmware/vectors_seal_host.c port/host/aead_sodium.c port/host/error.c -Iport/host -D_POSIX_C_SOURCE=200809L -lsodium,\
  tests/firmware/vectors_seal_target.c $(MONOCYPHER_SOURCES),tests/firmware/duif_nodes.h tests/firmware/vectors_seal.h $(MONOCYPHER)/monocypher.h)

define FIRMWARE_DUIF
$(FIRMWARE)/simulated-f$(1)/duif_data.h: tests/firmware/duif_data.py tests/firmware/duif.json tests/host/logs.py tests/firmware/duif.mk $(PROGRAM)
	@mkdir -p $$(@D)
	@$(PROGRAM) simulate tests/firmware/duif.json --filter duif --real float$(1) --out $$(@D)/run.cbor > $$(@D)/simulate.txt
	@$(PYTHON) $$< $$(@D)/run.cbor $$@.made && mv $$@.made $$@
endef
$(foreach b,32 64,$(eval $(call FIRMWARE_DUIF,$(b)))\
  $(eval $(call FIRMWARE_IMAGE,simulated-f$(b),tests/firmware/duif.c,-DDUIF_BITS=$(b) -I$(FIRMWARE)/simulated-f$(b),$(FIRMWARE)/simulated-f$(b)/duif_data.h))\
  $(eval $(call FIRMWARE_TEST,simulated-f$(b),,0,agree with the simulator))\
  $(eval $(call FIRMWARE_TEST,simulated-f$(b),altered,1,differs)))
