#!/bin/sh
# SPDX-License-Identifier: MIT
# The network of emulated boards: bit for bit the simulator, and what is wrong is found. One line "ok" or "not ok" for each test.
# Usage: demo.sh BUILD
build=$1
out=$build/test-demo
limit=40 # seconds for one run, which needs about two
rm -rf "$out" && mkdir -p "$out"
# What a killed demonstration leaves there goes with the folder. Names of sockets are short.
TMPDIR=$(mktemp -d)
export TMPDIR
trap 'rm -rf "$TMPDIR"' EXIT

demo() { # folder, options...: output in folder.log
    folder=$out/$1
    shift
    timeout -k 5 $limit .venv/bin/python tests/firmware/demo --build "$build" --out "$folder" "$@" >"$folder.log" 2>&1 </dev/null
}
show() { sed 's/^/    /' "$1" | head -n 30; }
equal() { # title, folder, options...
    title=$1
    shift
    if demo "$@"; then echo "ok: $title"; else echo "not ok: $title: exit status $?" && show "$out/$1.log"; fi
}
found() { # title, text, folder, options...: must end with status 1 and say so
    title=$1 text=$2
    shift 2
    demo "$@"
    status=$?
    if [ $status -eq 1 ] && grep -q "$text" "$out/$1.log"; then echo "ok: $title"
    else echo "not ok: $title: exit status $status" && show "$out/$1.log"; fi
}
check() { # title, command...
    title=$1
    shift
    if "$@" >"$out/check.log" 2>&1; then echo "ok: $title"; else echo "not ok: $title" && show "$out/check.log"; fi
}

equal "six boards, 80 steps" plain --steps 80
equal "again" again --steps 80
check "the same seed, the same arrivals" cmp "$out/plain/arrivals.csv" "$out/again/arrivals.csv"
check "and the same log" cmp "$out/plain/run.cbor" "$out/again/run.cbor"
check "the log becomes a recording" .venv/bin/meshkal-rerun "$out/plain/run.cbor" -o "$out/run.rrd"
equal "another seed" other --steps 60 --seed 7
check "is another run" sh -c "cmp -s $out/plain/arrivals.csv $out/other/arrivals.csv; test \$? -eq 1"
equal "a board is reset and makes up for the steps it missed" near --steps 60 --reboot
equal "a board is reset too late for that and starts again" far --steps 80 --reboot
check "which of both, by its counters" grep -q ", 1 restarts" "$out/far.log"

# The comparisons notice what they are for.
found "a bit of one delivered estimate" "DIFFERENT: node" frame --steps 20 --spoil frame
found "an arrival that is left out" "DIFFERENT: node" arrivals --steps 20 --spoil arrivals
found "a board that ends" "node .: ended with status 1" ends --steps 8 --emulator false
found "a board that says nothing" "node 0: no hello within 1 s" silent --steps 8 --limit 1 --emulator "sh -c 'exec sleep 30'"

# However the demonstration ends, no emulator stays.
check "ended runs leave no temporary files" rmdir "$TMPDIR" && mkdir "$TMPDIR"
for signal in TERM KILL; do
    setsid .venv/bin/python tests/firmware/demo --build "$build" --out "$out/$signal" --steps 4000 >"$out/$signal.log" 2>&1 </dev/null &
    leader=$!
    for _ in 1 2 3 4 5 6 7 8 9 10; do
        running=$(pgrep -c -s $leader qemu)
        [ "$running" -eq 6 ] && break
        sleep 0.3
    done
    sleep 0.5
    kill -$signal $leader
    wait $leader 2>/dev/null
    # An ended process whose new parent has not looked yet is still in the list: state Z.
    for _ in 1 2 3 4 5 6 7 8 9 10; do
        left=$(pgrep -c -r D,R,S,T -s $leader)
        [ "$left" -eq 0 ] && break
        sleep 0.5
    done
    if [ "$running" -eq 6 ] && [ "$left" -eq 0 ]; then echo "ok: SIG$signal leaves nothing running"
    else echo "not ok: SIG$signal: $running emulators ran, $left processes are left" && show "$out/$signal.log"; fi
done
