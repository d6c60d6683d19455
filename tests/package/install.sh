#!/bin/sh
# SPDX-License-Identifier: MIT
# make install as a consumer meets it: pkg-config and CMake, staged, at its place and moved elsewhere; uninstall. Usage: install.sh BUILD
. tests/package/check.sh

# What the tree itself builds says what every consumer must print.
expect
check "the consumer runs on the tree itself" test "$(wc -l <"$out/expected")" -eq 101
version=$(sed -n '1s/Meshkal //p' "$out/expected")

mkdir -p "$out/project"
cp tests/package/consumer.c "$out/project"
cp tests/package/consumer.c "$out/project/consumer.cpp"
cat >"$out/project/CMakeLists.txt" <<'END'
cmake_minimum_required(VERSION 3.10)
project(consumer C CXX)
find_package(meshkal ${WANTED} REQUIRED CONFIG)
message(STATUS "version ${meshkal_VERSION}")
foreach(language c cpp)
  add_executable(consumer-${language} consumer.${language})
  target_link_libraries(consumer-${language} PRIVATE meshkal::meshkal)
endforeach()
END

by_pkg_config() { # title, prefix directory
    for compiler in gcc "g++ -x c++"; do
        check "$1: pkg-config, ${compiler%% *}" sh -c "export PKG_CONFIG_PATH=$2/lib/pkgconfig && \
            pkg-config --cflags meshkal | grep -qe '-ffp-contract=off' && \
            $compiler -O1 $warnings \$(pkg-config --cflags meshkal) tests/package/consumer.c -x none \$(pkg-config --libs --static meshkal) -o $out/program && \
            $out/program | cmp - $out/expected"
    done
    check "$1: pkg-config says the version" sh -c "test \"\$(PKG_CONFIG_PATH=$2/lib/pkgconfig pkg-config --modversion meshkal)\" = $version"
}
by_cmake() { # title, prefix directory
    rm -rf "$out/cmake"
    check "$1: CMake, C and C++" sh -c "cmake -S $out/project -B $out/cmake -DCMAKE_PREFIX_PATH=$2 -DWANTED=${version%.*} \
        -DCMAKE_C_FLAGS=-O1 -DCMAKE_CXX_FLAGS=-O1 -DCMAKE_EXPORT_COMPILE_COMMANDS=ON && \
        cmake --build $out/cmake && $out/cmake/consumer-c | cmp - $out/expected && $out/cmake/consumer-cpp | cmp - $out/expected && \
        test \$(grep -c '\"command\".*-ffp-contract=off' $out/cmake/compile_commands.json) -eq 2"
    check "$1: CMake names no other directory" sh -c "grep -q 'I$2/include\|isystem $2/include' $out/cmake/compile_commands.json"
}

stage=$here/stage
check "make install, staged" make -s install BUILD="$build" DESTDIR="$stage" PREFIX=/opt/meshkal
by_pkg_config staged "$stage/opt/meshkal"
by_cmake staged "$stage/opt/meshkal"
for wanted in "0.0.1" "9.0" "${version%.*}.999"; do
    check "CMake refuses version $wanted" sh -c "! cmake -S $out/project -B $out/cmake-refused \
        -DCMAKE_PREFIX_PATH=$stage/opt/meshkal -DWANTED=$wanted >$out/refused 2>&1 && \
        grep -q 'compatible with requested version' $out/refused"
done
check "CMake accepts the exact version" cmake -S "$out/project" -B "$out/cmake-exact" -DCMAKE_PREFIX_PATH="$stage/opt/meshkal" "-DWANTED=$version;EXACT"
check "no file names where it was installed" sh -c "! grep -rlE '$stage|/opt/meshkal' $stage --include=*.cmake --include=*.pc"

mkdir -p "$out/elsewhere" && mv "$stage/opt/meshkal" "$here/elsewhere/moved"
by_pkg_config moved "$here/elsewhere/moved"
by_cmake moved "$here/elsewhere/moved"
check "a half installation is named by CMake" sh -c "rm $out/elsewhere/moved/lib/libmeshkal.a && \
    ! cmake -S $out/project -B $out/cmake-half -DCMAKE_PREFIX_PATH=$here/elsewhere/moved >$out/refused 2>&1 && \
    grep -q 'installation is not' $out/refused"

prefix=$here/prefix
check "make install, at its place" make -s install BUILD="$build" PREFIX="$prefix"
by_pkg_config "in place" "$prefix"
check "make uninstall leaves nothing named meshkal" sh -c "echo other >$prefix/lib/other && make -s uninstall BUILD=$build PREFIX=$prefix && \
    test -z \"\$(find $prefix -name '*meshkal*')\" && test \"\$(find $prefix -type f)\" = $prefix/lib/other"
