/* SPDX-License-Identifier: MIT */
/*
 * Frames: what nodes send each other. All numbers little-endian.
 *
 *     offset  bytes
 *          0      1   version, 1
 *          1      1   type: bits 0-1 stage (1 measurement, 2 estimate, 3 consensus), bits 2-3 number format (0 float32, 1 float64,
 *                     2 float16), bit 4 (stage 1 only) the sender's model comes with its reading, bit 5 sealed, bits 6-7 zero
 *          2      2   node that sends
 *          4      4   model: both ends must have been configured from the same one
 *          8      4   step, modulo 2^32
 *     plain frame:
 *         12      k   payload
 *     12 + k      4   CRC-32 (IEEE 802.3, as zlib) of all before
 *     sealed frame:
 *         12      8   sequence number of the sender, never used twice with one key
 *         20      k   payload, encrypted
 *     20 + k     16   tag over all before; nonce: node (2), zero (2), sequence (8)
 *
 * Payload: a measurement is the rows of y; an estimate is psi, n numbers. A measurement with model (bit 4) is for receivers that do
 * not hold the sender's C and R: the information pair (S, F y) of spec 1.4 in square-root form, G = R^-1/2 C by rows, then z = R^-1/2 y,
 * so that S = G'G and F y = G'z. It takes rows (n + 1) numbers where the pair takes n (n + 3) / 2, and stays positive semidefinite
 * in any format. A consensus frame (meshkal/duif.h):
 *
 *     offset  bytes
 *          0      2   iteration, 0 .. L-1
 *          2      1   bits 0-2 protocol (MK_CONSENSUS_), bit 3 the sender has a reading of its own in this step, bits 4-7 zero
 *          3      k   numbers: s (n), S (packed lower triangle by rows, n (n + 1) / 2), and, as the protocol says, the mass (1: PERRON without a
 *                     total, RATIO) or the prediction x (n: SUM)
 *
 * Sizes in bytes. An IEEE 802.15.4 frame of 127 bytes leaves 116 with short addresses and 104 with long ones (no link security):
 *
 *     states, rows     measurement     estimate      estimate, sealed     reading with model
 *                      f32             f32   f64     f32   f64            f32     f16
 *      4, 1             20              32    48      52    68             36      26
 *      6, 2             24              40    64      60    84             72      44
 *      9, 3             28              52    88      72   108            136      76
 *     17, 8             48              84   152     104   172            592     304
 *
 *     states     consensus             sealed             with mass          with x
 *                f32   f64   f16       f32   f64   f16    f32   f64   f16    f32   f64   f16
 *      4          75   131    47        95   151    67     79   139    49     91   163    55
 *      6         127   235    73       147   255    93    131   243    75    151   283    85
 *      9         235   451   127       255   471   147    239   459   129    271   523   145
 *
 * Where float64 does not fit the numbers can travel as float32 (MK_NUMBERS_F32); a reading with model fits as float16. What is larger
 * still needs a link that fragments, as 6LoWPAN does. Numbers are rounded to the nearest, ties to even; bits are those of the
 * simulator only where the format is the precision of the filter.
 */
#ifndef MESHKAL_FRAME_H
#define MESHKAL_FRAME_H

#include <meshkal/base.h>
#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

#define MK_FRAME_VERSION 1
#define MK_FRAME_HEADER 12
#define MK_FRAME_SEQUENCE 8
#define MK_FRAME_TAG 16
/* What a frame holds beside its payload. */
#define MK_FRAME_PLAIN (MK_FRAME_HEADER + 4)
#define MK_FRAME_SEALED (MK_FRAME_HEADER + MK_FRAME_SEQUENCE + MK_FRAME_TAG)

enum { MK_STAGE_MEASUREMENT = 1, MK_STAGE_ESTIMATE = 2, MK_STAGE_CONSENSUS = 3 };
/* What a consensus payload holds beside its numbers. */
#define MK_CONSENSUS_HEADER 3
enum { MK_NUMBERS_F32 = 0, MK_NUMBERS_F64 = 1, MK_NUMBERS_F16 = 2 };

/* Header fields, and where the payload stands in the caller's bytes. */
typedef struct {
    uint32_t model, step;
    uint16_t node;
    uint8_t stage, numbers; /* MK_STAGE_, MK_NUMBERS_ */
    uint8_t with_model, sealed;
    uint16_t length; /* bytes of payload */
    const uint8_t *payload;
} mk_frame_t;

/* CRC-32 of IEEE 802.3 (reflected, polynomial 0xedb88320) of `length` bytes. Start with crc = 0; the result continues a longer run. */
uint32_t mk_crc32(uint32_t crc, const uint8_t *bytes, size_t length);

/* Bytes of `count` numbers in a format. */
#define MK_NUMBERS_BYTES(numbers, count) ((size_t)(count) * ((numbers) == MK_NUMBERS_F64 ? 8u : (numbers) == MK_NUMBERS_F16 ? 2u : 4u))

/* Writes numbers as bytes. NOT_FINITE: one is not finite or not within the format; bytes are then undefined. */
mk_status_t mk_numbers_put_f32(int numbers, int count, const float *values, uint8_t *bytes);
mk_status_t mk_numbers_put_f64(int numbers, int count, const double *values, uint8_t *bytes);
/* Reads numbers. NOT_FINITE: one is not finite or not within the type; values are then undefined. */
mk_status_t mk_numbers_get_f32(int numbers, int count, const uint8_t *bytes, float *values);
mk_status_t mk_numbers_get_f64(int numbers, int count, const uint8_t *bytes, double *values);

/* Authenticated encryption, the caller's: two functions that return 1, or 0. header is authenticated, text (length bytes, any number, also
   0) is encrypted or decrypted in place. Any AEAD with a nonce of 12 bytes and a tag of 16 will do (ChaCha20-Poly1305 of RFC 8439,
   AES-GCM, AES-CCM). On 0 text is not used. */
typedef struct {
    int (*seal)(void *context, const uint8_t nonce[12], const uint8_t *header, size_t header_length, uint8_t *text, size_t length,
                uint8_t tag[16]);
    int (*open)(void *context, const uint8_t nonce[12], const uint8_t *header, size_t header_length, uint8_t *text, size_t length,
                const uint8_t tag[16]);
    void *context; /* the key */
} mk_aead_t;

/* Which sequence numbers of one sender have been seen: the last 64. Zeroed at first. */
typedef struct {
    uint64_t last; /* highest accepted */
    uint64_t seen; /* bit i: last - i was accepted */
} mk_replay_t;

/* Authenticated frames. Caller's memory: name_secure_t of a typed node object holds it all. The key is in aead->context. A sequence number
   must never be used twice with one key: give every start a higher one than any before, for example the count of boots in the upper
   32 bits. At 2^64 - 1 they are used up, and nothing is sent any more. */
typedef struct {
    const mk_aead_t *aead;
    uint64_t sequence;   /* of the next frame that is sent */
    mk_replay_t *window; /* slots */
    uint8_t *text;       /* room for a payload */
    uint16_t capacity;   /* its bytes */
} mk_secure_t;

/* For the typed functions name_secure. */
MK_INLINE mk_secure_t mk_secure_make(const mk_aead_t *aead, uint64_t sequence, mk_replay_t *window, uint8_t *text, size_t capacity) {
    mk_secure_t secure;
    secure.aead = aead;
    secure.sequence = sequence;
    secure.window = window;
    secure.text = text;
    secure.capacity = (uint16_t)capacity;
    return secure;
}

/* Is this sequence number new? It is marked by mk_replay_mark only, once the seal has opened. */
int mk_replay_new(const mk_replay_t *window, uint64_t sequence);
void mk_replay_mark(mk_replay_t *window, uint64_t sequence);

/* Examines a frame: ARGUMENT (null), LENGTH, VERSION, for a plain one CHECKSUM, then TYPE: what is damaged is called so. Writes *frame
   on success only; payload of a sealed one is still encrypted and must not be used before mk_frame_open. Reads nothing beyond length. */
mk_status_t mk_frame_read(const uint8_t *bytes, size_t length, mk_frame_t *frame);

/* Opens a sealed frame that mk_frame_read found in `bytes`: REPLAYED, FORGED. text: room for frame->length bytes, where payload
   then points; on FORGED it is undefined. The window, its sender's, changes on success only. */
mk_status_t mk_frame_open(const uint8_t *bytes, mk_frame_t *frame, const mk_aead_t *aead, mk_replay_t *window, uint8_t *text);

/* Where the payload of a frame to be written goes. */
uint8_t *mk_frame_payload(uint8_t *bytes, int sealed);

/* Completes a frame whose payload (frame->length bytes) is in place: header and CRC, or header, sequence and seal; bytes has room for
   MK_FRAME_PLAIN or MK_FRAME_SEALED more than the payload. aead and sequence are used where frame->sealed, frame->payload is not.
   Returns the frame's length, or 0: the seal failed. */
size_t mk_frame_write(const mk_frame_t *frame, uint8_t *bytes, const mk_aead_t *aead, uint64_t sequence);

#ifdef __cplusplus
}
#endif

#endif
