/* Many actuators, and many whole runs in one call, as a library for the Python API, one actuator at a time. */
#include "tables.h"

#if defined __x86_64__
#include <cpuid.h>
#endif

/* Return the number of actuators in a vector of this processor: 8 with AVX-512 F and DQ, 4 with AVX2, 1 with neither.
 * Vectors whose registers the system does not save do not count (Intel's manual, volume 1, 13.3 and 15.2). */
API int actuator_lanes(void)
{
#if defined __x86_64__
    unsigned a, b, c, d, saved, high;
    if (!__get_cpuid(1, &a, &b, &c, &d) || !(c >> 27 & 1u)) return 1;
    __asm__ volatile("xgetbv" : "=a"(saved), "=d"(high) : "c"(0));
    if ((saved & 0x6u) != 0x6u || !__get_cpuid_count(7, 0, &a, &b, &c, &d)) return 1;
    if ((saved & 0xe6u) == 0xe6u && (b >> 16 & 3u) == 3u) return 8;
    if (b >> 5 & 1u) return 4;
#endif
    return 1;
}
