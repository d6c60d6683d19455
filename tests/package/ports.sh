#!/bin/sh
# SPDX-License-Identifier: MIT
# The packages for PlatformIO, ESP-IDF, Zephyr and Arduino as make dist lays them out: manifests, and a program that uses each. PlatformIO,
# the component manager of ESP-IDF and Kconfig are the real ones; ESP-IDF's and Zephyr's CMake functions and Arduino's builder are stood in for
# (ports/). Usage: ports.sh BUILD
. tests/package/check.sh
ports=tests/package/ports
tools=$root/$build/package-tools/bin

check "builders of the packages" make -s "$build/package-tools/done" BUILD="$build"
check "make dist" make -s dist BUILD="$build"
packages=$root/$build/dist/packages
expect
version=$(sed -n '1s/Meshkal //p' "$out/expected")
m4f="-mcpu=cortex-m4 -mfpu=fpv4-sp-d16 -mfloat-abi=hard"
contraction_off() { # compile_commands.json, units
    test "$(grep -c '"command".*-ffp-contract=off' "$1")" -eq "$2" && test "$(grep -c '"command"' "$1")" -eq "$2"
}

# PlatformIO: its own program, with SCons of the package registry in place of the one it would download.
core=$here/pio-core project=$out/pio
mkdir -p "$core/packages/tool-scons" "$core/platforms" "$project/src" "$project/lib"
scons=$("$tools/python" -c "import platformio.dependencies as d; print(d.get_core_dependencies()['tool-scons'].lstrip('~'))")
echo "{\"name\": \"tool-scons\", \"version\": \"$scons\", \"description\": \"SCons\"}" >"$core/packages/tool-scons/package.json"
echo "{\"type\": \"tool\", \"name\": \"tool-scons\", \"version\": \"$scons\"," \
    "\"spec\": {\"owner\": \"platformio\", \"id\": 8192, \"name\": \"tool-scons\", \"requirements\": null, \"uri\": null}}" >"$core/packages/tool-scons/.piopm"
echo 'import SCons.Script; SCons.Script.main()' >"$core/packages/tool-scons/scons.py"
cp -R "$ports/pio-platform" "$core/platforms/here"
cp "$ports/platformio.ini" "$project/"
cp tests/package/consumer.c "$project/src/main.c"
cp -R "$packages/platformio" "$project/lib/meshkal"
pio() { # options of pio run
    PLATFORMIO_CORE_DIR=$core PLATFORMIO_SETTING_ENABLE_TELEMETRY=no PLATFORMIO_DISABLE_UPGRADE_CHECK=true timeout 120 "$tools/pio" run -d "$project" "$@"
}
if pio -v >"$out/pio.log" 2>&1; then built=yes; else built=no; fi
check "PlatformIO: pio run, host and Cortex-M4F" sh -c "test $built = yes || { tail -n 30 $out/pio.log; exit 1; }"
check "PlatformIO knows the library's version" grep -q "meshkal @ $version" "$out/pio.log"
check "PlatformIO: the program prints the same bits" sh -c "$project/.pio/build/host/program | cmp - $out/expected"
check "PlatformIO: no fused operation in the project's units and the library" test "$(fused "$project/.pio/build/cortex-m4f/program")" = 0

# ESP-IDF: the component manager packs it; its build functions are stood in for, with the compiler of the C3's instruction set.
check "ESP-IDF: the component manager packs it" sh -c "cp -R $packages/esp-idf $out/meshkal && cd $out/meshkal && \
    IDF_TOOLS_PATH=$here/idf-tools timeout 300 $tools/compote component pack --name meshkal --dest-dir $here/idf && \
    test -s $here/idf/meshkal_$version.tgz"
check "ESP-IDF: the component manager refuses a false version" sh -c "cd $out/meshkal && sed -i 's/^version:.*/version: \"one\"/' idf_component.yml && \
    ! IDF_TOOLS_PATH=$here/idf-tools timeout 300 $tools/compote component pack --name meshkal --dest-dir $here/idf-refused"
generic="-DCMAKE_SYSTEM_NAME=Generic -DCMAKE_TRY_COMPILE_TARGET_TYPE=STATIC_LIBRARY -DCMAKE_EXPORT_COMPILE_COMMANDS=ON"
riscv="$generic -DCMAKE_C_COMPILER=riscv64-unknown-elf-gcc -DCMAKE_CXX_COMPILER=riscv64-unknown-elf-g++"
arm="$generic -DCMAKE_C_COMPILER=arm-none-eabi-gcc -DCMAKE_CXX_COMPILER=arm-none-eabi-g++"
flash="-Wl,--defsym=__flash_size=0x80000"
check "ESP-IDF: component and a program that requires it, rv32imc" sh -c "cmake -S $ports/esp-idf \
    -B $out/idf-build $riscv '-DCMAKE_C_FLAGS=--specs=picolibc.specs -march=rv32imc -mabi=ilp32' \
    '-DCMAKE_CXX_FLAGS=--specs=picolibc.specs -march=rv32imc -mabi=ilp32' '-DCMAKE_EXE_LINKER_FLAGS=$flash' -DCOMPONENT=$packages/esp-idf -DCONSUMER=$root/tests/package/consumer.c && \
    cmake --build $out/idf-build -j2"
check "ESP-IDF: contraction is off in the component and in what requires it" contraction_off "$out/idf-build/compile_commands.json" 3

# Zephyr: Kconfig reads the options; its build functions are stood in for.
check "Zephyr: module.yml" "$tools/python" "$ports/manifest_rules.py" zephyr "$packages/zephyr"
mkdir "$out/zephyr"
printf 'menu "meshkal"\nosource "%s/zephyr/Kconfig"\nconfig ZEPHYR_MESHKAL_MODULE\n\tbool\n\tdefault y\nendmenu\n' "$packages/zephyr" >"$out/zephyr/Kconfig"
for answer in y n; do
    check "Zephyr: Kconfig, CONFIG_MESHKAL=$answer" "$tools/python" -c "import kconfiglib, sys
options = kconfiglib.Kconfig('$out/zephyr/Kconfig', warn_to_stderr=False)
options.syms['MESHKAL'].set_value('$answer') or sys.exit('no such option')
options.write_config('$out/zephyr/config-$answer')
options.warnings and sys.exit(str(options.warnings))
sys.exit(('CONFIG_MESHKAL=y' in open('$out/zephyr/config-$answer').read().splitlines()) != ('$answer' == 'y'))"
    check "Zephyr: module and application, Cortex-M4F, CONFIG_MESHKAL=$answer" sh -c "cmake -S $ports/zephyr \
        -B $out/zephyr/build-$answer $arm '-DCMAKE_C_FLAGS=--specs=picolibc.specs $m4f' \
        '-DCMAKE_CXX_FLAGS=--specs=picolibc.specs $m4f' '-DCMAKE_EXE_LINKER_FLAGS=$flash' -DMODULE=$packages/zephyr/zephyr -DDOTCONFIG=$here/zephyr/config-$answer \
        -DCONSUMER=$root/tests/package/consumer.c && cmake --build $out/zephyr/build-$answer -j2"
done
check "Zephyr: contraction is off in the module and in the application" contraction_off "$out/zephyr/build-y/compile_commands.json" 3
check "Zephyr: no fused operation in the image" test "$(fused "$out/zephyr/build-y/app-c")" = 0

# Arduino: every source below src/ is compiled with src/ in the path and flags of the board alone.
check "Arduino: library.properties and layout" "$tools/python" "$ports/manifest_rules.py" arduino "$packages/arduino"
arduino() { # name of the board's family, tool prefix, flags
    prefix=$2 && objects=$out/arduino-$1 && mkdir -p "$objects" && shift 2
    board="--specs=picolibc.specs $* -Os -w -ffunction-sections -fdata-sections -DARDUINO=10819 -I$packages/arduino/src"
    for source in $(cd "$packages/arduino/src" && find . -name '*.c'); do
        ${prefix}gcc -std=gnu11 $board -c "$packages/arduino/src/$source" -o "$objects/$(basename "$source").o" || return 1
    done
    ${prefix}g++ -std=gnu++11 -fpermissive -fno-exceptions -fno-rtti -DCONSUMER_SILENT -DCONSUMER_ONE_HEADER $board -x c++ -c tests/package/consumer.c -o "$objects/sketch.cpp.o" &&
        ${prefix}gcc $board $flash -Wl,--gc-sections "$objects"/*.o -lm -o "$objects/sketch.elf"
}
check "Arduino: library and sketch, Cortex-M0+" arduino samd arm-none-eabi- -mcpu=cortex-m0plus -mthumb
check "Arduino: library and sketch, Cortex-M4F" arduino mbed arm-none-eabi- $m4f
check "Arduino: library and sketch, rv32imc" arduino esp32 riscv64-unknown-elf- -march=rv32imc -mabi=ilp32
check "Arduino: no fused operation, although no flag says so" test "$(fused "$out/arduino-mbed/sketch.elf")" = 0
