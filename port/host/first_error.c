/* SPDX-License-Identifier: MIT */
#include "first_error.h"

void mk_first_error_open(mk_first_error_t *first) {
    (void)pthread_mutex_init(&first->lock, NULL);
    first->index = -1;
}

int mk_first_error_before(mk_first_error_t *first, long index) {
    (void)pthread_mutex_lock(&first->lock);
    const int before = first->index >= 0 && first->index < index;
    (void)pthread_mutex_unlock(&first->lock);
    return before;
}

void mk_first_error_put(mk_first_error_t *first, long index, const mk_error_t *error) {
    (void)pthread_mutex_lock(&first->lock);
    if (first->index < 0 || index < first->index) {
        first->index = index;
        first->error = *error;
    }
    (void)pthread_mutex_unlock(&first->lock);
}

int mk_first_error_close(mk_first_error_t *first, mk_error_t *error) {
    (void)pthread_mutex_destroy(&first->lock);
    if (first->index < 0) return 1;
    *error = first->error;
    return 0;
}
