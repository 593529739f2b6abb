/* The types and functions of vector.h for a single lane: `lanes` is one number. */
#ifndef EMCAS_SCALAR_H
#define EMCAS_SCALAR_H

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "kernel.h"

enum { LANES = 1, LANES_ALL = 1 };
typedef double lanes;
typedef bool lanes_mask;

/* Call a function of the equations; a single lane computes it whatever `which` is. */
#define EQUATIONS(name, which, ...) ((void)(which), kernel_##name(__VA_ARGS__))
#define EVERY_LANE true
#define NO_LANE false
#define lanes_finite(x) core_finite(x)

static inline lanes lanes_set(double x) { return x; }
static inline lanes lanes_load(const double *x) { return *x; }
static inline void lanes_store(double *to, lanes x) { *to = x; }
static inline double lanes_of(lanes x, int lane) { return (void)lane, x; }
static inline lanes lanes_fabs(lanes x) { return fabs(x); }
static inline lanes_mask lanes_less(lanes a, lanes b) { return a < b; }
static inline lanes_mask lanes_less_equal(lanes a, lanes b) { return a <= b; }
static inline lanes_mask lanes_greater(lanes a, lanes b) { return a > b; }
static inline lanes_mask lanes_greater_equal(lanes a, lanes b) { return a >= b; }
static inline lanes_mask lanes_equal(lanes a, lanes b) { return a == b; }
static inline lanes_mask lanes_same(lanes a, lanes b) { return memcmp(&a, &b, sizeof a) == 0; } /* by their bits */
static inline lanes lanes_where(lanes_mask m, lanes yes, lanes no) { return m ? yes : no; }
static inline lanes_mask lanes_both(lanes_mask a, lanes_mask b) { return a && b; }
static inline lanes_mask lanes_but(lanes_mask a, lanes_mask b) { return a && !b; }
static inline unsigned lanes_bits(lanes_mask m) { return m; }
static inline lanes_mask lanes_of_bits(unsigned bits) { return bits & 1u; }
static inline bool lanes_any(lanes_mask m) { return m; }
static inline bool lanes_every(lanes_mask m) { return m; }
static inline int lanes_lead(lanes_mask which) { return (void)which, 0; }
static inline lanes_mask lanes_alike(lanes x, int lane) { return (void)x, (void)lane, true; }

#endif
