#!/bin/sh
# SPDX-License-Identifier: MIT
# Runs test programs and pytest suites, shows what fails, adds up. Usage: tests/run.sh BUILD ITEM ...
#   ITEM: a CMocka program; sh:SCRIPT, which prints "ok" or "not ok" lines; py:NAME:MESHKAL:PATH,..., a pytest run in the background with
#   that program, NAME naming its report; wait: for those runs, so that what follows has the machine to itself. Two pytest runs at
#   once suit the two cores this is meant for.
set -u
build=$1
shift
logs=$build/test-logs
mkdir -p "$logs"
passed=0 failed=0 waiting=

add() { # passed, failed, title, log
    passed=$((passed + $1)) failed=$((failed + $2))
    if [ "$2" -gt 0 ]; then printf '%s: %s passed, %s FAILED\n' "$3" "$1" "$2" && tail -n 60 "$4"; else printf '%s: %s passed\n' "$3" "$1"; fi
}
count() { grep -oE "[0-9]+ $1\b" "$2" | tail -n 1 | cut -d' ' -f1; }

collect() { # the pytest runs in the background
    wait
    for name in $waiting; do
        log=$logs/$name.log good=$(count passed "$log") bad=$(count failed "$log") errors=$(count 'errors?' "$log")
        bad=$((${bad:-0} + ${errors:-0}))
        grep -q '^exit status 0' "$log" || [ "$bad" -gt 0 ] || bad=1
        add "${good:-0}" "$bad" "$name" "$log"
    done
    waiting=
}

for item in "$@"; do
    case $item in
    wait) collect ;;
    py:*)
        rest=${item#py:} name=${rest%%:*} rest=${rest#*:}
        program=${rest%%:*} paths=$(printf '%s' "${rest#*:}" | tr ',' ' ')
        # shellcheck disable=SC2086
        (MESHKAL=$PWD/$program MESHKAL_REQUIRED=1 RERUN_STRICT=1 .venv/bin/python -m pytest -q -p no:cacheprovider $paths >"$logs/$name.log" 2>&1
            echo "exit status $?" >>"$logs/$name.log") &
        waiting="$waiting $name"
        ;;
    sh:*)
        name=$(basename "${item#sh:}" .sh)
        sh "${item#sh:}" "$build" >"$logs/$name.log" 2>&1 || echo "not ok: exit status $?" >>"$logs/$name.log"
        add "$(grep -c '^ok' "$logs/$name.log")" "$(grep -c '^not ok' "$logs/$name.log")" "$name" "$logs/$name.log"
        ;;
    *)
        name=$(basename "$(dirname "$item")")-$(basename "$item")
        "$item" >"$logs/$name.log" 2>&1
        status=$?
        good=$(sed -n 's/^\[  PASSED  \] \([0-9]*\) test.*/\1/p' "$logs/$name.log") bad=$(sed -n 's/^\[  FAILED  \] \([0-9]*\) test.*/\1/p' "$logs/$name.log")
        # A program that dies says neither; one without groups counts as one test.
        [ "$status" -ne 0 ] && [ -z "$bad" ] && bad=1
        [ "$status" -eq 0 ] && [ -z "$good" ] && good=1
        add "${good:-0}" "${bad:-0}" "$name" "$logs/$name.log"
        ;;
    esac
done
collect
printf '%s passed, %s failed\n' "$passed" "$failed"
[ "$failed" -eq 0 ] && [ "$passed" -gt 0 ]
