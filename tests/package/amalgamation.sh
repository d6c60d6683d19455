#!/bin/sh
# SPDX-License-Identifier: MIT
# build/dist/meshkal.h and meshkal.c: alone in a directory, every compiler, C and C++, the same machine code as the tree.
# Usage: amalgamation.sh BUILD
. tests/package/check.sh

check "make dist" make -s dist BUILD="$build"
dist=$build/dist pair=$out/pair
mkdir "$pair" && cp "$dist/meshkal.h" "$dist/meshkal.c" "$pair"

check "the pair names no file but itself and the compiler's" sh -c "gcc -M $pair/meshkal.c >$out/names && \
    tr -s ' \\\\' '\n' <$out/names | grep -vE '^(/usr/.*|meshkal.o:|$pair/meshkal.[ch]|)$' >$out/strangers; test ! -s $out/strangers"
check "standard headers only" sh -c "! grep -hE '^ *# *include' $pair/meshkal.* | grep -vE '<(float|limits|math|stdbool|stddef|stdint|string)\.h>|\"meshkal.h\"'"
check "it has every function of libmeshkal.a and no other" sh -c "gcc -std=c99 -O1 $strict -c $pair/meshkal.c -o $out/pair.o && \
    for f in $out/pair.o $build/libmeshkal.a; do nm \$f | awk '\$2 ~ /[A-Z]/ && NF == 3 {print \$3}' | sort >$out/symbols.\${f##*.}; done; \
    test -s $out/symbols.o && cmp $out/symbols.o $out/symbols.a"

# The tree as one unit, in the order of the pair.
mkdir "$out/tree"
units=$(find src -name '*.c' | sort)
# shellcheck disable=SC2086
{ echo '#define MK_ROLLED' && grep -l '#define MK_ROLLED' $units; grep -L '#define MK_ROLLED' $units; } |
    sed 's/^src.*/#include "&"/' >"$out/tree/meshkal.c"
# Optimised once; the others would only say the same more slowly.
for compiler in "gcc -O1" "clang -O0" "arm-none-eabi-gcc --specs=picolibc.specs -mcpu=cortex-m4 -mfpu=fpv4-sp-d16 -mfloat-abi=hard -O0" \
    "riscv64-unknown-elf-gcc --specs=picolibc.specs -march=rv32imac -mabi=ilp32 -O0"; do
    check "same machine code as the tree: $compiler" sh -c "$compiler -std=c99 $strict -Wmissing-prototypes -c $pair/meshkal.c -o $out/pair.o && \
        $compiler -std=c99 $strict -I. -Iinclude -Isrc -c $out/tree/meshkal.c -o $out/tree.o && cmp $out/pair.o $out/tree.o"
done

expect
gcc -O1 -ffp-contract=off -c "$pair/meshkal.c" -o "$out/c.o"
for compiler in "gcc -std=c99 -x c" "clang -std=c99 -x c" "g++ -std=c++17 -x c++" "clang++ -std=c++11 -x c++"; do
    check "consumer, ${compiler% -x*}, meshkal.h: same bits" sh -c "$compiler -O1 $strict -DCONSUMER_ONE_HEADER -I$pair \
        tests/package/consumer.c -x none $out/c.o -lm -o $out/program && $out/program | cmp - $out/expected"
done
for compiler in gcc clang; do
    check "consumer and library, $compiler, <meshkal/unrolled.h>: same bits" sh -c "$compiler -std=c99 -O1 $strict -I$dist \
        tests/package/consumer.c $dist/meshkal.c -lm -o $out/program && $out/program | cmp - $out/expected"
done

# Every header of the tree alone; then all of them, and the pair, in each language.
compile() { # compiler with options, standard input
    case $1 in *++*) $1 $strict -fsyntax-only -x c++ - ;; *) $1 $strict -Wmissing-prototypes -fsyntax-only -x c - ;; esac
}
headers="$(cd include && find meshkal -name '*.h') meshkal/unrolled.h"
alone() { for h in $headers; do echo "#include <$h>" | compile "$1 -Iinclude -Isrc" || return 1; done; }
together() { for h in $headers; do echo "#include <$h>"; done | compile "$1"; }
check "every header alone: C99" alone "gcc -std=c99"
check "every header alone: C++17" alone "g++ -std=c++17"
for compiler in "g++ -std=c++11" "g++ -std=c++17" "g++ -std=c++20" "clang++ -std=c++11" "clang++ -std=c++17" "clang++ -std=c++20" \
    "gcc -std=c99" "gcc -std=c17" "clang -std=c99"; do
    check "headers of the tree: $compiler" together "$compiler -Iinclude -Isrc"
    check "headers of the pair: $compiler" together "$compiler -I$dist"
done

# Headers that the designer writes compile unchanged. Their hexadecimal constants are C99 and C++17; older C++ has them as an extension.
"$build/meshkal" scenario projectile --nodes 2 --seed 1 >"$out/net.json" &&
    "$build/meshkal" design "$out/net.json" --json "$out/design.json" --c-header "$out/nodes" --real float32 >/dev/null
{
    for header in "$out"/nodes/node_*.h; do echo "#include \"$(basename "$header")\""; done
    echo 'int main(void) {'
    for header in "$out"/nodes/node_*.h; do
        number=$(basename "$header" .h) && number=node${number#node_}
        echo "static ${number}_t $number;"
        echo "if (${number}_start(&$number, &${number}_config) || ${number}_incremental(&$number) || ${number}_diffuse(&$number)) return 1;"
    done
    echo 'return 0; }'
} >"$out/nodes/main.c"
for compiler in "gcc -std=c99 -x c" "g++ -std=gnu++11 -x c++" "clang++ -std=c++17 -x c++"; do
    check "generated node headers, ${compiler% -x*}" sh -c "$compiler -O0 -Wall -Wextra -Werror -Wno-unused-variable -ffp-contract=off -I$dist \
        $out/nodes/main.c -x none $out/c.o -lm -o $out/program && $out/program"
done

# Builders that take no flags from a library: the header itself keeps multiply and add apart.
for d in "" -DARDUINO=10819; do
    arm-none-eabi-g++ --specs=picolibc.specs -std=gnu++17 -Os -mcpu=cortex-m4 -mfpu=fpv4-sp-d16 -mfloat-abi=hard \
        $d -DCONSUMER_SILENT -I"$dist" -x c++ -c tests/package/consumer.c -o "$out/fused$d.o"
done
check "a compiler left alone fuses" test "$(fused "$out/fused.o")" -gt 0
check "under Arduino it does not" test "$(fused "$out/fused-DARDUINO=10819.o")" = 0
