#!/bin/sh
# SPDX-License-Identifier: MIT
# Licence and manifests: every source file says its licence in its first lines; port/ is what the version makes. Usage: sources.sh BUILD
. tests/package/check.sh

# Source files are those that have comments: data (JSON, CSV, logs, pictures) and prose have none; a licence is no source. The generated
# manifest of Arduino has a fixed list of lines.
find . -path ./build -prune -o -path ./.git -prune -o -path ./.venv -prune -o -name __pycache__ -prune -o -name .pytest_cache -prune -o -name '*.egg-info' -prune -o -type f -print | sed 's,^\./,,' | sort >"$out/files"
grep -vE '(^|/)LICENSE$|\.(md|json|csv|cbor|rrd|png|svg|txt|gitignore|properties)$|^\.gitignore$' "$out/files" >"$out/sources"
[ -e .git ] && git ls-files -o --exclude-standard >"$out/untracked" && grep -vxFf "$out/untracked" "$out/sources" >"$out/tracked" && mv "$out/tracked" "$out/sources"
check "there are sources to look at" test "$(wc -l <"$out/sources")" -gt 100
check "every source file has its SPDX line" sh -c "while read -r f; do head -n 3 \"\$f\" | grep -qE '^(/\*|//|#|;) SPDX-License-Identifier: MIT( \*/)?$' || echo \"no SPDX line: \$f\"; done <$out/sources >$out/bare; \
    test ! -s $out/bare || { cat $out/bare; exit 1; }"
check "no other licence is named" sh -c "! grep -v 'package/sources.sh' $out/sources | xargs grep -n 'SPDX-License-Identifier' | grep -v 'SPDX-License-Identifier: MIT'"
check "LICENSE is the MIT licence" sh -c "head -n 1 LICENSE | grep -qx 'MIT License' && grep -q '^Copyright (c) [0-9]* Meshkal contributors$' LICENSE && \
    grep -q 'THE SOFTWARE IS PROVIDED \"AS IS\"' LICENSE"

python3 port/package/manifests.py "$out/port"
check "manifests are what the version makes (else: make manifests)" sh -c "cd $out/port && for f in \$(find . -type f); do cmp \$f $root/port/\$f || exit 1; done"
version=$(sed -n 's/^#define MK_VERSION "\(.*\)"/\1/p' include/meshkal/base.h)
for f in tools/rerun/pyproject.toml port/*/idf_component.yml port/*/library.json port/*/library.properties port/*/module.yml; do
    check "$f says version $version" grep -qE "(version|Meshkal)[\"' :=]* ?\"?$version(\"|\. |,|$)" "$f"
done
