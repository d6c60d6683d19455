# SPDX-License-Identifier: MIT
# The pictures of the README, by the commands that users have. Views need a Vulkan driver: Debian's mesa-vulkan-drivers.

.PHONY: pictures
PICTURES = $(BUILD)/pictures
TO_PNG = .venv/bin/meshkal-rerun
NO_DRIVER = pictures: no picture of the views without a Vulkan driver (Debian: mesa-vulkan-drivers)

# $(call picture,NAME,VIEW,LOGS and options): tools/rerun/NAME.png
define picture
	@$(TO_PNG) $(3) --view $(2) --png $(PICTURES)/$(1)
	@test -f $(PICTURES)/$(1)/$(2).png || { echo "$(NO_DRIVER)" >&2; exit 1; }
	@cp $(PICTURES)/$(1)/$(2).png tools/rerun/$(1).png
	@echo "  PNG tools/rerun/$(1).png"
endef

pictures: all ## the pictures of the README, in tools/rerun/ (needs a Vulkan driver)
	@rm -rf $(PICTURES) && mkdir -p $(PICTURES)
	@$(PROGRAM) scenario projectile --nodes 20 --seed 1 > $(PICTURES)/net.json
	@$(PROGRAM) scenario projectile --nodes 1000 --seed 1 > $(PICTURES)/thousand.json
	@$(PROGRAM) scenario gnss-ins > $(PICTURES)/nav.json
	@cd $(PICTURES) && run() { $(abspath $(PROGRAM)) simulate "$$@" >/dev/null; } && \
	  run net.json --loss 0.1 --out run.cbor && \
	  run net.json --truth least-favourable --filter rkfdu --out robust.cbor && \
	  run net.json --truth least-favourable --filter kfd --out plain.cbor && \
	  run thousand.json --loss 0.1 --out thousand.cbor && \
	  run $(abspath tools/rerun/tracking.json) --filter duif --loss 0.1 --out track.cbor && \
	  run nav.json --filter rekf-t --monitor exclude --out nav.cbor
	$(call picture,recording,overview,$(PICTURES)/run.cbor)
	$(call picture,node,node,$(PICTURES)/run.cbor)
	$(call picture,consensus,consensus,$(PICTURES)/run.cbor)
	$(call picture,compare,compare,$(PICTURES)/robust.cbor $(PICTURES)/plain.cbor)
	$(call picture,thousand,overview,$(PICTURES)/thousand.cbor)
	$(call picture,tracking,overview,$(PICTURES)/track.cbor --time 45)
	$(call picture,integrity,overview,$(PICTURES)/nav.cbor --time 250)
