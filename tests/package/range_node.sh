#!/bin/sh
# SPDX-License-Identifier: MIT
# The example for firmware: a node that tracks a target by ranges (range_node.c), among neighbours that the host plays. Usage: range_node.sh BUILD
. tests/package/check.sh

for cc in gcc clang; do
    check "range node, $cc" sh -c "$cc -std=c99 $strict -Wmissing-prototypes -O2 -Iinclude tests/package/range_node.c tests/package/range_board.c $build/libmeshkal.a -lm -o $out/node-$cc"
    check "range node runs ($cc)" "$out/node-$cc"
done
check "both compilers print the same" sh -c "$out/node-gcc >$out/a && $out/node-clang >$out/b && cmp $out/a $out/b"
# All of its memory is one static object; it calls the library, the board and memory functions.
code="-mthumb -mcpu=cortex-m4 -mfpu=fpv4-sp-d16 -mfloat-abi=hard --specs=picolibc.specs"
check "range node, Cortex-M4F" sh -c "arm-none-eabi-gcc $code -std=c99 -Os $strict -Wmissing-prototypes -Iinclude -c tests/package/range_node.c -o $out/node.o"
check "its only variable is the node" sh -c "! arm-none-eabi-nm $out/node.o | grep -E ' [bBdDC] ' | grep -v ' node$'"
check "it needs no heap, no stdio" sh -c "! arm-none-eabi-nm -u $out/node.o | awk '{print \$2}' | grep -vxE 'mk_[a-z0-9_]+|range_read|radio_send|radio_listen|report|mem(cpy|set|move)'"
