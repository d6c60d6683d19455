/* SPDX-License-Identifier: MIT */
/* Rows of the integrity monitor: sets of them, and who is where in a call. Row r of place p has number p m + r, below 32. */
#ifndef MESHKAL_INTEGRITY_ROWS_H
#define MESHKAL_INTEGRITY_ROWS_H

/* The first `rows` rows of a place, 1 <= rows <= m. */
static uint32_t mk_rows_of(int m, int place, int rows) { return (UINT32_MAX >> (MK_MONITOR_ROWS - rows)) << (place * m); }

static int mk_rows_count(uint32_t set) {
    int count = 0;
    for (; set; set &= set - 1) count++;
    return count;
}

/* The readings of a call that are watched, in its order. */
typedef struct {
    uint32_t seen, remaining; /* rows of this epoch that count; rows of the older epochs of the window */
    int crowded;
    uint8_t sensors, rows; /* readings watched; rows that count, which are those of sensors not held faulty */
    struct {
        uint16_t from, index; /* first row in r and S; of the sensor in the call */
        uint8_t place, rows;
    } sensor[MK_MONITOR_ROWS];
    struct {
        uint16_t from; /* in r and S */
        uint8_t number, sensor;
    } row[MK_MONITOR_ROWS];
} mk_reading_t;

#endif
