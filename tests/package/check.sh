# SPDX-License-Identifier: MIT
# Sourced by the scripts beside it, each called as  NAME.sh BUILD : check() prints "ok" or "not ok" lines, which tests/run.sh counts.
build=$1
name=$(basename "$0" .sh)
out=$build/test-package/$name
rm -rf "$out" && mkdir -p "$out"
# Where commands change the directory.
root=$PWD here=$PWD/$out
warnings="-pedantic -Wall -Wextra -Wconversion -Wdouble-promotion -Wvla -Werror"
strict="$warnings -ffp-contract=off"
check() { # title, command...
    title=$1
    shift
    if "$@" >"$out/log" 2>&1; then echo "ok: $title"; else echo "not ok: $title" && cat "$out/log"; fi
}
expect() { # what the tree itself prints, and every consumer must
    # shellcheck disable=SC2086
    gcc -std=c99 -O1 $strict -Iinclude -Isrc tests/package/consumer.c "$build/libmeshkal.a" -lm -o "$out/expected-program" &&
        "$out/expected-program" >"$out/expected"
}
fused() { # file of a Cortex-M4F: its fused operations; nothing if it has no floating-point code at all
    arm-none-eabi-objdump -d "$1" >"$out/listing" && grep -q 'vmul.f32' "$out/listing" && grep -cE 'vfn?m[as]' "$out/listing"
}
