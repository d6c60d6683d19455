/* SPDX-License-Identifier: MIT */
/* Memory of the process. */
#ifndef MESHKAL_HOST_MEMORY_H
#define MESHKAL_HOST_MEMORY_H

/* Most bytes it ever held at once, as the system counts them (pages that were touched). */
double mk_peak_memory(void);

#endif
