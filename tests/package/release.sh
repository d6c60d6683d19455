#!/bin/sh
# SPDX-License-Identifier: MIT
# The release tarball, unpacked in a clean directory: unit tests of its sources and of its amalgamation; it makes itself again; what its
# making must refuse. Usage: release.sh BUILD
. tests/package/check.sh

check "make dist" make -s dist BUILD="$build"
version=$(sed -n 's/^#define MK_VERSION "\(.*\)"/\1/p' include/meshkal/base.h)
tarball=$build/dist/meshkal-$version.tar.gz
check "the tarball unpacks into one directory" sh -c "tar -xzf $tarball -C $out && test \"\$(ls $out | grep -v log)\" = meshkal-$version"
tree=$out/meshkal-$version
check "it holds every file of the tree" sh -c "if [ -e .git ]; then git ls-files; else find . -path ./build -prune -o -path ./.venv -prune -o -name __pycache__ -prune -o -type f -print; fi | \
    while read -r f; do test ! -f \"\$f\" || cmp \"\$f\" \"$tree/\$f\" || exit 1; done"
check "it holds nothing made or private" sh -c "! tar -tzf $tarball | grep -E '\.(o|a|d|pyc)$|/\.git/|/\.venv|/build/' | grep -vE '/build/(dist/.*)?$'"

unit() { # title, C and C++ compiler, programs that pass, options of unit.mk: the long run is shortened, it looks for drift
    check "unit tests: $1" sh -c "make -s -j2 -C $tree -f tests/unit/unit.mk BUILD=build/$2 CC=$2 CXX=$3 CFLAGS='-O0 -DUNIT_LONG_RUN=2000' $5 test-unit-plain >$out/unit 2>&1 || \
        { tail -n 20 $out/unit; exit 1; }; test \$(grep -c 'PASSED' $out/unit) -eq $4"
}
# The sources are the tree's, whose tests run elsewhere: two programs show that they build here.
unit "sources, gcc" gcc g++ 2 "UNIT_TESTS='step contract'"
rm -rf "$tree/build/gcc"
programs=$(($(ls tests/unit/test_*.c | wc -l) + 1)) # one of them is compiled in two ways
# Nothing else to be found: include/ and src/ are out of the way.
mkdir "$out/away" && mv "$tree/include" "$tree/src" "$out/away/"
for pair in "gcc g++" "clang clang++"; do
    unit "amalgamation, ${pair% *}" ${pair% *} ${pair#* } "$programs" "UNIT_NUMERIC='-Ibuild/dist -ffp-contract=off' UNIT_LIBRARY=build/dist/meshkal.c"
done
mv "$out/away/include" "$out/away/src" "$tree/"

# The wildcards of a tree without git find the same files.
rm -rf "$tree/build"
check "the unpacked tree makes the same tarball" sh -c "make -s -C $tree dist && cmp $tree/build/dist/meshkal-$version.tar.gz $tarball"

amalgamate="python3 $tree/port/package/amalgamate.py $out/refused"
kernels=$tree/src/meshkal/kernels.h
cp "$kernels" "$out/kernels.h"
refused() { # title, line put into kernels.h, what the message says
    { echo "$2" && cat "$out/kernels.h"; } >"$kernels"
    check "amalgamation refuses $1" sh -c "! $amalgamate 2>$out/message && grep -q 'src/meshkal/kernels.h:1: .*$3' $out/message"
    cp "$out/kernels.h" "$kernels"
}
refused "a host header" '#include <stdio.h>' 'stdio.h'
refused "a header that is not there" '#include "missing.h"' 'missing.h'
refused "a header named by a macro" '#include MK_WHICH' 'macro'
