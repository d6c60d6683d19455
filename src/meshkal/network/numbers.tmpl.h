/* SPDX-License-Identifier: MIT */
/* Numbers of a frame from and into this precision. */

mk_status_t MK_F(mk_numbers_put)(int numbers, int count, const MK_REAL *values, uint8_t *bytes) {
    const mk_format_t own = mk_numbers_format(MK_BITS == 32 ? MK_NUMBERS_F32 : MK_NUMBERS_F64), format = mk_numbers_format(numbers);
    const int size = (int)MK_NUMBERS_BYTES(numbers, 1);
    for (int i = 0; i < count; i++) {
        MK_UINT own_bits;
        memcpy(&own_bits, values + i, sizeof own_bits);
        const uint64_t bits = own.fraction == format.fraction ? own_bits : mk_convert_bits(own_bits, own, format);
        if (!mk_bits_finite(bits, format)) return MK_ERROR_NOT_FINITE;
        mk_put_bytes(bytes + i * size, size, bits);
    }
    return MK_OK;
}

mk_status_t MK_F(mk_numbers_get)(int numbers, int count, const uint8_t *bytes, MK_REAL *values) {
    const mk_format_t own = mk_numbers_format(MK_BITS == 32 ? MK_NUMBERS_F32 : MK_NUMBERS_F64), format = mk_numbers_format(numbers);
    const int size = (int)MK_NUMBERS_BYTES(numbers, 1);
    for (int i = 0; i < count; i++) {
        const uint64_t bits = mk_get_bytes(bytes + i * size, size);
        const MK_UINT own_bits = (MK_UINT)(own.fraction == format.fraction ? bits : mk_convert_bits(bits, format, own));
        if (!mk_bits_finite(own_bits, own)) return MK_ERROR_NOT_FINITE;
        memcpy(values + i, &own_bits, sizeof own_bits);
    }
    return MK_OK;
}
