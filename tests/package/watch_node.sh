#!/bin/sh
# SPDX-License-Identifier: MIT
# The example of a node with an integrity monitor (watch_node.c), over the header that the designer makes. Usage: watch_node.sh BUILD
. tests/package/check.sh

# Three nodes that all hear each other.
"$build/meshkal" scenario projectile --nodes 3 --seed 1 >"$out/net.json" &&
    "$build/meshkal" design "$out/net.json" --c-header "$out/nodes" --real float32 >/dev/null
headers="-Iinclude -Isrc -Itests/firmware/demo -I$out/nodes"
code="-mthumb -mcpu=cortex-m4 -mfpu=fpv4-sp-d16 -mfloat-abi=hard --specs=picolibc.specs"
for cc in "gcc -std=c99" "clang -std=c99" "g++ -std=c++17 -x c++" "arm-none-eabi-gcc $code -std=c99 -Os"; do
    check "watch node, ${cc%% *}" sh -c "$cc $strict $headers -c tests/package/watch_node.c -o $out/node.o"
done
check "it needs no heap, no stdio" sh -c "test -s $out/node.o && ! arm-none-eabi-nm -u $out/node.o | awk '{print \$2}' | \
    grep -vxE 'mk_[a-z0-9_]+|radio_(start|send|listen)|sensor_read|report|sqrtf|mem(cpy|set|move)'"
