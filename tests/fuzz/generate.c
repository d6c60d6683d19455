/* SPDX-License-Identifier: MIT */
/* Drives tests/fuzz/target.c without libFuzzer: programs of mostly good calls from a seeded generator, then with bytes changed.

       generate [PROGRAMS [SEED]]     default 20000 programs, seed 1
       generate FILE                  one program, for example one that libFuzzer found; a file's name has a letter or a dot in it */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "generator.h"
#include "target.h"

static uint8_t program[1 << 16];

/* Numbers of a payload: mostly small ones, now and then anything. */
static size_t draw_numbers(generator_t *g, int format, int count, uint8_t *bytes) {
    const size_t size = format == 1 ? 8 : format == 0 ? 4 : 2;
    const double scale = draw_chance(g, 0.1) ? 40.0 : 1.0;
    for (int i = 0; i < count; i++) {
        const double wide = scale * draw_normal(g);
        const float single = (float)wide;
        const uint16_t two = (uint16_t)(draw_bits(g) & 0xbfffu);
        if (draw_chance(g, 0.01)) {
            const uint64_t any = draw_chance(g, 0.5) ? draw_bits(g) : ~UINT64_C(0) << 52;
            memcpy(bytes, &any, size);
        } else {
            memcpy(bytes, format == 1 ? (const void *)&wide : format == 0 ? (const void *)&single : (const void *)&two, size);
        }
        bytes += size;
    }
    return (size_t)count * size;
}

static size_t draw_call(generator_t *g, unsigned settings, uint8_t *bytes) {
    static const uint8_t often[] = {CALL_FRAME, CALL_FRAME, CALL_FRAME, CALL_FRAME, CALL_FRAME, CALL_STEP, CALL_STEP, CALL_MEASURE};
    int kind = draw_chance(g, 0.9) ? often[draw_below(g, 8)] : draw_below(g, CALL_COUNT);
    if (kind == CALL_STEP && settings & SETTING_STEADY && draw_chance(g, 0.7)) kind = CALL_WHOLE;
    size_t length = (size_t)draw_below(g, 60);
    bytes[0] = (uint8_t)kind;
    for (size_t i = 0; i < length; i++) bytes[2 + i] = (uint8_t)draw_bits(g);
    if (kind == CALL_FRAME) {
        const int stage = 1 + draw_below(g, 2), slot = 1 + draw_below(g, 3), format = draw_below(g, 3);
        const int model = stage == 1 && settings & SETTING_FOREIGN && slot != 2;
        bytes[2] = (uint8_t)(stage | format << 2 | (model ? 16 : 0) | (settings & SETTING_SEALED ? 32 : 0));
        bytes[3] = (uint8_t)(slot | (draw_chance(g, 0.05) ? 128 | draw_below(g, 32) << 2 : 0));
        bytes[4] = draw_chance(g, 0.8) ? (uint8_t)draw_below(g, 32) : (uint8_t)draw_bits(g);
        length = 3 + draw_numbers(g, format, stage == 2 ? 3 : (slot == 2 ? 1 : 2) * (model ? 4 : 1), bytes + 5);
    } else if (kind == CALL_MEASURE) {
        length = draw_numbers(g, settings & SETTING_WIDE ? 1 : 0, 2, bytes + 2);
    } else if (kind == CALL_SAVE) {
        length = draw_chance(g, 0.5) ? 0 : 3;
        if (draw_chance(g, 0.3)) bytes[4] = 0;
    }
    bytes[1] = (uint8_t)length;
    return 2 + length;
}

static int run_file(const char *path) {
    FILE *file = fopen(path, "rb");
    if (!file) {
        fprintf(stderr, "generate: %s cannot be read\n", path);
        return 2;
    }
    const size_t size = fread(program, 1, sizeof program, file);
    (void)fclose(file);
    return LLVMFuzzerTestOneInput(program, size);
}

int main(int count, char **arguments) {
    char *end = NULL;
    const long programs = count > 1 ? strtol(arguments[1], &end, 10) : 20000;
    if (end && *end) return run_file(arguments[1]);
    generator_t g = {count > 2 ? strtoull(arguments[2], NULL, 10) : 1};
    for (long i = 0; i < programs; i++) {
        size_t size = 1;
        program[0] = (uint8_t)draw_bits(&g);
        for (int calls = draw_below(&g, 60); calls > 0; calls--) size += draw_call(&g, program[0], program + size);
        (void)LLVMFuzzerTestOneInput(program, size);
        for (int changes = draw_below(&g, 8); changes > 0; changes--) program[draw_below(&g, (int)size)] = (uint8_t)draw_bits(&g);
        (void)LLVMFuzzerTestOneInput(program, size);
    }
    if (programs >= 1000 && frozen_steps < programs / 4) {
        fprintf(stderr, "generate: only %ld steps with a frozen gain in %ld programs: its code is not fuzzed\n", frozen_steps, programs);
        return 1;
    }
    printf("[  PASSED  ] 1 test: %ld programs, and as many with bytes changed; %ld steps with a frozen gain\n", programs, frozen_steps);
    return 0;
}
