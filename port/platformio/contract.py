# SPDX-License-Identifier: MIT
# Run by PlatformIO for this library: the project's own units, where unrolled kernels are compiled, get the flag as well.
Import("projenv")  # noqa: F821
projenv.Append(CCFLAGS=["-ffp-contract=off"])  # noqa: F821
