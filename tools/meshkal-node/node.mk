# SPDX-License-Identifier: MIT
# build/meshkal-node: one node of a network over UDP. Included by the main Makefile, whose names it uses.

NODE_PROGRAM = $(BUILD)/meshkal-node
NODE_OBJECTS = $(patsubst %.c,$(BUILD)/%.o,$(wildcard tools/meshkal-node/*.c))
all: $(NODE_PROGRAM)
$(NODE_PROGRAM): $(NODE_OBJECTS) $(filter-out %/main.o,$(HOST_OBJECTS)) $(LIBRARY)
	@echo "  LD $@"
	@$(CC) $(CFLAGS) $^ $(HOST_LIBS) -o $@

-include $(NODE_OBJECTS:.o=.d)
