#!/bin/sh
# SPDX-License-Identifier: MIT
# Runs the images under emulation and looks at their symbols; one line "ok" or "not ok" for each test. Usage: firmware.sh BUILD
# Reads BUILD/firmware/targets and BUILD/firmware/plan, which make writes; logs in BUILD/firmware/TARGET/.
dir=$1/firmware
limit=60 # seconds: an image needs less than two

[ -s "$dir/plan" ] && [ -s "$dir/targets" ] || { echo "not ok: there are no images: make firmware" && exit 1; }
column() { sed -n "s/^$1|//p" "$dir/targets" | cut -d'|' -f"$2"; } # target, number

while IFS='|' read -r target image arguments status text after; do
    title="$target $image${arguments:+ $arguments}"
    log=$dir/$target/$image.log
    # shellcheck disable=SC2046
    timeout -k 1 $limit $(column "$target" 1)$(printf ',arg=%s' "$image" $arguments) -kernel "$dir/$target/$image.elf" </dev/null >"$log" 2>&1
    got=$?
    if [ $got -eq 124 ]; then echo "not ok: $title: still running after $limit s"
    elif [ $got -ne "$status" ]; then echo "not ok: $title: exit status $got, expected $status"
    elif [ -n "$text" ] && ! grep -qF "$text" "$log"; then echo "not ok: $title: did not write '$text'"
    elif [ -n "$after" ] && ! sh -c "$after" </dev/null >>"$log" 2>&1; then echo "not ok: $title: $after"
    else echo "ok: $title" && continue; fi
    sed 's/^/    /' "$log" | head -n 20
done <"$dir/plan"

# --- symbols: no heap, no stdio, no errno, no writable data in the library; no software floating point where the hardware has it ------------
check() { # title, what may not be: symbols found
    if [ -z "$2" ]; then echo "ok: $1"; else echo "not ok: $1: $(echo "$2" | tr '\n' ' ')"; fi
}
library='memcpy|memset|memmove|memcmp|sqrtf?|__(aeabi_|gnu_thumb1_case_|riscv_)[a-z0-9_]+|__[a-z]+[sd][fi]([sd][fi])?[0-9]?'
forbidden='malloc|free|calloc|realloc|_?sbrk|.*(printf|scanf)|f?put[cs]|putchar|f(open|close|read|write)|stdin|stdout|stderr|__errno|errno|_impure_ptr|abort|exit'
double='__aeabi_c?d[a-z0-9]+|__aeabi_[a-z]+2d|__[a-z]+df[a-z]*[0-9]?|sqrt'
while IFS='|' read -r target _ prefix hardware; do
    objects=$dir/$target
    "${prefix}nm" "$objects/meshkal.o" >"$objects/symbols"
    check "$target library: nothing writable" "$(grep -E ' [bBdDgGsScC] ' "$objects/symbols")"
    check "$target library: needs memory functions, square roots and arithmetic only" "$(awk '$1 == "U" {print $2}' "$objects/symbols" | grep -vxE "$library")"
    for image in "$objects"/*.elf; do
        name=$target\ $(basename "$image" .elf)
        "${prefix}nm" "$image" | awk '{print $NF}' >"$objects/symbols"
        check "$name: no heap, stdio or errno" "$(grep -xE "$forbidden" "$objects/symbols")"
        case $hardware-$name in single-*-f32 | double-*) check "$name: no double in software" "$(grep -xE "$double" "$objects/symbols")" ;; esac
    done
done <"$dir/targets"
