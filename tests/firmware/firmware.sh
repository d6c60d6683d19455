#!/bin/sh
# SPDX-License-Identifier: MIT
# Runs the images under emulation and looks at their symbols; one line "ok" or "not ok" for each test. Usage: firmware.sh BUILD
# Reads BUILD/firmware/targets and BUILD/firmware/plan, which make writes; logs in BUILD/firmware/TARGET/.
dir=$1/firmware
limit=60 # seconds: an image needs less than two

column() { sed -n "s/^$1|//p" "$dir/targets" | cut -d'|' -f"$2"; } # target, number

while IFS='|' read -r target image arguments status text; do
    title="$target $image${arguments:+ $arguments}"
    log=$dir/$target/$image.log
    # shellcheck disable=SC2046
    timeout -k 1 $limit $(column "$target" 1)$(printf ',arg=%s' "$image" $arguments) -kernel "$dir/$target/$image.elf" </dev/null >"$log" 2>&1
    got=$?
    if [ $got -eq 124 ]; then echo "not ok: $title: still running after $limit s"
    elif [ $got -ne "$status" ]; then echo "not ok: $title: exit status $got, expected $status"
    elif [ -n "$text" ] && ! grep -qF "$text" "$log"; then echo "not ok: $title: did not write '$text'"
    else echo "ok: $title" && continue; fi
    sed 's/^/    /' "$log" | head -n 20
done <"$dir/plan"
