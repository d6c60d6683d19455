# SPDX-License-Identifier: MIT
# Installation, amalgamation, release tarball, packages. Included by the main Makefile.

PACKAGE := port/package
.PHONY: install uninstall dist manifests

# --- install ---------------------------------------------------------------------------------------------------------------

HEADERS = $(shell cd include && find meshkal -name '*.h')
KERNELS = $(shell cd src && find meshkal -name '*.h')
INSTALLED = $(DESTDIR)$(PREFIX)

install: all ## library, headers, program, pkg-config and CMake files under DESTDIR and PREFIX
	@for f in $(HEADERS); do install -D -m 644 include/$$f $(INSTALLED)/include/$$f || exit 1; done
	@install -D -m 644 port/host/meshkal/plugin.h $(INSTALLED)/include/meshkal/plugin.h
	@for f in $(KERNELS); do install -D -m 644 src/$$f $(INSTALLED)/include/$$f || exit 1; done
	install -D -m 644 $(LIBRARY) $(INSTALLED)/lib/libmeshkal.a
	install -D -m 755 $(PROGRAM) $(INSTALLED)/bin/meshkal
	@mkdir -p $(INSTALLED)/lib/pkgconfig $(INSTALLED)/lib/cmake/meshkal
# The prefix is named from the file, so that the tree can be moved.
	@printf '%s\n' 'prefix=$${pcfiledir}/../..' 'Name: meshkal' 'Description: State estimators for the nodes of a sensor network' 'Version: $(VERSION)' \
	  'Cflags: -I$${prefix}/include $(ARITHMETIC)' 'Libs: -L$${prefix}/lib -lmeshkal' 'Libs.private: -lm' > $(INSTALLED)/lib/pkgconfig/meshkal.pc
	@install -m 644 $(PACKAGE)/meshkal-config.cmake $(INSTALLED)/lib/cmake/meshkal
	@sed 's/@VERSION@/$(VERSION)/' $(PACKAGE)/meshkal-config-version.cmake.in > $(INSTALLED)/lib/cmake/meshkal/meshkal-config-version.cmake

uninstall: ## what install put there
	rm -rf $(INSTALLED)/include/meshkal $(INSTALLED)/lib/cmake/meshkal
	rm -f $(INSTALLED)/lib/libmeshkal.a $(INSTALLED)/bin/meshkal $(INSTALLED)/lib/pkgconfig/meshkal.pc

# --- release ---------------------------------------------------------------------------------------------------------------

DIST = $(BUILD)/dist
RELEASE = meshkal-$(VERSION)
# A file's time would make two tarballs of the same tree differ.
TAR = tar --sort=name --owner=0 --group=0 --numeric-owner --mtime='2000-01-01 00:00Z'

manifests: ## version and description of the packages in port/, from MK_VERSION
	python3 $(PACKAGE)/manifests.py port

# An unpacked release has no git: there every file belongs to it but what is made.
dist: ## build/dist/: amalgamation meshkal.h and meshkal.c, packages for Zephyr, ESP-IDF, PlatformIO, Arduino, release tarball
	@rm -rf $(DIST) && mkdir -p $(DIST)/$(RELEASE)
	@python3 $(PACKAGE)/amalgamate.py $(DIST)
	@for p in zephyr esp-idf platformio arduino; do \
	  mkdir -p $(DIST)/packages/$$p/src && cp -R $(DIST)/meshkal.h $(DIST)/meshkal.c $(DIST)/meshkal $(DIST)/packages/$$p/src/ && \
	  cp LICENSE $(DIST)/packages/$$p/ && own=$(DIST)/packages/$$p && if [ $$p = zephyr ]; then own=$$own/zephyr && mkdir -p $$own; fi && \
	  cp port/$$p/* $$own/ || exit 1; done
	@{ if [ -e .git ]; then git ls-files -z; \
	  else find . -path ./build -prune -o -path ./.venv -prune -o \( -name __pycache__ -o -name '*.egg-info' \) -prune -o -type f -print0; fi; } | \
	  xargs -0 sh -c 'for f; do test -e "$$f" && printf "%s\0" "$$f"; done' sh | tar -c --null -T - | tar -x -C $(DIST)/$(RELEASE)
	@mkdir -p $(DIST)/$(RELEASE)/build/dist && cp -R $(DIST)/meshkal.h $(DIST)/meshkal.c $(DIST)/meshkal $(DIST)/packages $(DIST)/$(RELEASE)/build/dist/
	@$(TAR) -C $(DIST) -c $(RELEASE) | gzip -9n > $(DIST)/$(RELEASE).tar.gz && rm -rf $(DIST)/$(RELEASE)
	@ls -l $(DIST)/$(RELEASE).tar.gz
