# SPDX-License-Identifier: MIT
# CMocka test of the division of networks, which needs METIS but no MPI: included by the main Makefile after host.mk, whose names it uses.
# MPI_TEST_PROGRAMS need no arguments. The pytest tests of this folder run with MESHKAL=$(BUILD)/meshkal and use meshkal-mpi beside it.

MPI_TEST_PROGRAMS := $(HOST_PLAIN)/test_partition $(HOST_SANE)/test_partition
TEST_ITEMS += $(MPI_TEST_PROGRAMS)
MPI_TEST_SOURCES := tests/mpi/test_partition.c tools/meshkal-mpi/partition.c

$(MPI_TEST_PROGRAMS): tools/meshkal-mpi/partition.h tools/meshkal/simulation/division.h
$(HOST_PLAIN)/test_partition: $(MPI_TEST_SOURCES) $(HOST_PARTS)
	@mkdir -p $(@D)
	@echo "  LD $@"
	@$(CC) $(CFLAGS) $(HOST_INCLUDE) -Itools/meshkal-mpi $(MPI_TEST_SOURCES) $(HOST_PARTS) -lmetis $(HOST_TEST_LIBS) -o $@

$(HOST_SANE)/test_partition: $(MPI_TEST_SOURCES) $(HOST_SANE_PARTS)
	@mkdir -p $(@D)
	@echo "  LD $@"
	@$(CC) $(CFLAGS) $(SANITIZE) $(HOST_INCLUDE) -Itools/meshkal-mpi $(MPI_TEST_SOURCES) $(HOST_SANE_PARTS) -lmetis $(HOST_TEST_LIBS) -o $@
