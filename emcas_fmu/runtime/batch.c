/* Many actuators, and many whole runs in one call, as a library for the Python API: one number to a lane. */
#include "tables.h"

#if defined __x86_64__
#include <cpuid.h>
#endif

/* The number of actuators in a vector of this processor, for which vectors.c is compiled: 8 with AVX-512, 4 with AVX2,
 * 1 with neither, or if the system does not save their registers (Intel's manual, volume 1, 13.3 and 15.2). */
API int actuator_lanes(void)
{
#if defined __x86_64__
    unsigned a, b, c, d, kept, high;
    if (!__get_cpuid(1, &a, &b, &c, &d) || !(c >> 27 & 1u)) return 1;
    __asm__ volatile("xgetbv" : "=a"(kept), "=d"(high) : "c"(0));
    if ((kept & 0x6u) != 0x6u || !__get_cpuid_count(7, 0, &a, &b, &c, &d)) return 1;
    if ((kept & 0xe6u) == 0xe6u && (b >> 16 & 3u) == 3u) return 8;
    if (b >> 5 & 1u) return 4;
#endif
    return 1;
}
