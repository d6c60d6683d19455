#!/bin/sh
# SPDX-License-Identifier: MIT
# What a user meets first: the README's example, the installed package, the object code's promises. Usage: package.sh BUILD
. tests/package/check.sh

# The first C block of the README, and its promised length.
awk '/^```c$/ {on = 1; next} /^```$/ {if (on) exit} on' README.md >"$out/example.c"
check "README example has at most 30 lines" test "$(wc -l <"$out/example.c")" -le 30 -a -s "$out/example.c"

# The application under "Put it on your node" is the one of the demo.
awk '/^## Put it on your node/ {here = 1} here && /^```c$/ {on = 1; next} /^```$/ {if (on) exit} on' README.md >"$out/application.c"
check "README shows the demo's application" sh -c "tail -n +3 tests/firmware/demo/main.c | cmp - $out/application.c"

# The loop under "On a node" is the one of that file.
awk '/^### On a node/ {here = 1} here && /^```c$/ {on = 1; next} /^```$/ {if (on) exit} on' README.md >"$out/loop.c"
check "README shows the loop of range_node.c" sh -c "awk '/once a second/ {on = 1; next} /report\\(/ {exit} on' tests/package/range_node.c | cmp - $out/loop.c"

stage=$PWD/$out/stage
check "make install" make -s install BUILD="$build" DESTDIR="$stage" PREFIX=/usr
export PKG_CONFIG_PATH="$stage/usr/lib/pkgconfig" PKG_CONFIG_SYSROOT_DIR="$stage"
for cc in gcc clang; do
    check "README example, $cc, pkg-config" sh -c "$cc -std=c99 $strict \$(pkg-config --cflags meshkal) -O2 $out/example.c \$(pkg-config --libs --static meshkal) -o $out/example-$cc"
    check "README example runs ($cc)" "$out/example-$cc"
done
check "README example says what the README says" sh -c "$out/example-gcc | tail -n 1 | xargs -0 printf '%s' | grep -qF -f - README.md"
check "both compilers print the same" sh -c "$out/example-gcc >$out/a && $out/example-clang >$out/b && cmp $out/a $out/b"
check "make uninstall leaves no file" sh -c "make -s uninstall BUILD=$build DESTDIR=$stage PREFIX=/usr && test -z \"\$(find $stage -type f)\""

# No heap, no stdio, no libm but sqrt, no writable data.
nm "$build/libmeshkal.a" >"$out/symbols"
check "undefined symbols are of memory copies, fills and compares and of sqrt only" sh -c "! awk '\$1 == \"U\" {print \$2}' $out/symbols | grep -vxE 'memcpy|memset|memmove|memcmp|sqrtf?|_GLOBAL_OFFSET_TABLE_|__stack_chk_fail'"
check "no writable data" sh -c "! grep -E ' [bBdDgGsSC] ' $out/symbols"
check "fast math is refused" sh -c "! gcc -std=c99 -ffast-math -Iinclude -Isrc -c src/meshkal/meshkal.c -o $out/fast.o"
check "every C source compiles with clang" sh -c "for f in src/meshkal/*.c port/host/*.c tools/meshkal/*.c tools/meshkal/*/*.c; do clang -std=c99 $strict -Wmissing-prototypes -D_POSIX_C_SOURCE=200809L -Iinclude -Isrc -Iport/host -Itools/meshkal -fsyntax-only \$f || exit 1; done"
