/* Vectors of LANES numbers, and conditions on them, in the widest registers that the compiler's flags allow. In each
 * lane an operation gives the same bits as the operation on one number in C. */
#ifndef EMCAS_VECTOR_H
#define EMCAS_VECTOR_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include <immintrin.h>

#if defined __AVX512F__ && defined __AVX512DQ__
enum { LANES = 8 };
typedef __m512d lanes;
typedef __mmask8 lanes_mask;
static inline lanes lanes_set(double x) { return _mm512_set1_pd(x); }
static inline lanes lanes_load(const double *x) { return _mm512_loadu_pd(x); }
static inline void lanes_store(double *to, lanes x) { _mm512_storeu_pd(to, x); }
static inline lanes lanes_sqrt(lanes x) { return _mm512_sqrt_pd(x); }
static inline lanes lanes_floor(lanes x) { return _mm512_roundscale_pd(x, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC); }
static inline lanes lanes_minimum(lanes a, lanes b) { return _mm512_min_pd(a, b); }
static inline lanes lanes_maximum(lanes a, lanes b) { return _mm512_max_pd(a, b); }
static inline lanes_mask lanes_less(lanes a, lanes b) { return _mm512_cmp_pd_mask(a, b, _CMP_LT_OQ); }
static inline lanes_mask lanes_less_equal(lanes a, lanes b) { return _mm512_cmp_pd_mask(a, b, _CMP_LE_OQ); }
static inline lanes_mask lanes_equal(lanes a, lanes b) { return _mm512_cmp_pd_mask(a, b, _CMP_EQ_OQ); }
static inline lanes_mask lanes_same(lanes a, lanes b) /* by their bits */
{
    return _mm512_cmpeq_epi64_mask(_mm512_castpd_si512(a), _mm512_castpd_si512(b));
}
static inline lanes_mask lanes_true(lanes x) { return _mm512_cmp_pd_mask(x, _mm512_setzero_pd(), _CMP_NEQ_UQ); }
static inline lanes_mask lanes_both(lanes_mask a, lanes_mask b) { return a & b; }
static inline lanes_mask lanes_but(lanes_mask a, lanes_mask b) { return (lanes_mask)(a & ~b); }
static inline lanes_mask lanes_either(lanes_mask a, lanes_mask b) { return a | b; }
static inline lanes lanes_where(lanes_mask m, lanes yes, lanes no) { return _mm512_mask_blend_pd(m, no, yes); }
static inline unsigned lanes_bits(lanes_mask m) { return m; }
static inline lanes_mask lanes_of_bits(unsigned bits) { return (lanes_mask)bits; }
#elif defined __AVX2__
enum { LANES = 4 };
typedef __m256d lanes, lanes_mask;
static inline lanes lanes_set(double x) { return _mm256_set1_pd(x); }
static inline lanes lanes_load(const double *x) { return _mm256_loadu_pd(x); }
static inline void lanes_store(double *to, lanes x) { _mm256_storeu_pd(to, x); }
static inline lanes lanes_sqrt(lanes x) { return _mm256_sqrt_pd(x); }
static inline lanes lanes_floor(lanes x) { return _mm256_floor_pd(x); }
static inline lanes lanes_minimum(lanes a, lanes b) { return _mm256_min_pd(a, b); }
static inline lanes lanes_maximum(lanes a, lanes b) { return _mm256_max_pd(a, b); }
static inline lanes_mask lanes_less(lanes a, lanes b) { return _mm256_cmp_pd(a, b, _CMP_LT_OQ); }
static inline lanes_mask lanes_less_equal(lanes a, lanes b) { return _mm256_cmp_pd(a, b, _CMP_LE_OQ); }
static inline lanes_mask lanes_equal(lanes a, lanes b) { return _mm256_cmp_pd(a, b, _CMP_EQ_OQ); }
static inline lanes_mask lanes_same(lanes a, lanes b) /* by their bits */
{
    return _mm256_castsi256_pd(_mm256_cmpeq_epi64(_mm256_castpd_si256(a), _mm256_castpd_si256(b)));
}
static inline lanes_mask lanes_true(lanes x) { return _mm256_cmp_pd(x, _mm256_setzero_pd(), _CMP_NEQ_UQ); }
static inline lanes_mask lanes_both(lanes_mask a, lanes_mask b) { return _mm256_and_pd(a, b); }
static inline lanes_mask lanes_but(lanes_mask a, lanes_mask b) { return _mm256_andnot_pd(b, a); }
static inline lanes_mask lanes_either(lanes_mask a, lanes_mask b) { return _mm256_or_pd(a, b); }
static inline lanes lanes_where(lanes_mask m, lanes yes, lanes no) { return _mm256_blendv_pd(no, yes, m); }
static inline unsigned lanes_bits(lanes_mask m) { return (unsigned)_mm256_movemask_pd(m); }
static inline lanes_mask lanes_of_bits(unsigned b)
{
    const __m256i bit = _mm256_set_epi64x(8, 4, 2, 1);
    return _mm256_castsi256_pd(_mm256_cmpeq_epi64(_mm256_and_si256(_mm256_set1_epi64x((long long)b), bit), bit));
}
#else
#error "vector.h needs AVX2, or AVX-512 with F and DQ"
#endif

enum { LANES_ALL = (1 << LANES) - 1 };
typedef uint64_t lanes_words __attribute__((vector_size(sizeof(lanes)))); /* the bits of each number */

/* Call a function of the equations for the lanes `which`. */
#define EQUATIONS(name, which, ...) vector_##name(lanes_bits(which), __VA_ARGS__)
#define EVERY_LANE lanes_of_bits(LANES_ALL)
#define NO_LANE lanes_of_bits(0)

static inline lanes lanes_fabs(lanes x) { return (lanes)((lanes_words)x & UINT64_C(0x7fffffffffffffff)); }
static inline lanes_mask lanes_greater(lanes a, lanes b) { return lanes_less(b, a); }
static inline lanes_mask lanes_greater_equal(lanes a, lanes b) { return lanes_less_equal(b, a); }
static inline lanes_mask lanes_negate(lanes_mask m) { return lanes_but(EVERY_LANE, m); }
static inline lanes lanes_number(lanes_mask m) { return lanes_where(m, lanes_set(1.0), lanes_set(0.0)); }
static inline lanes_mask lanes_where_mask(lanes_mask m, lanes_mask yes, lanes_mask no)
{
    return lanes_either(lanes_both(m, yes), lanes_but(no, m));
}
static inline bool lanes_any(lanes_mask m) { return lanes_bits(m) != 0; }
static inline bool lanes_every(lanes_mask m) { return lanes_bits(m) == LANES_ALL; }
/* Return the first lane of `which`, which must not be empty. */
static inline int lanes_lead(lanes_mask which) { return __builtin_ctz(lanes_bits(which)); }
static inline double lanes_of(lanes x, int lane) { return ((const double *)&x)[lane]; }
static inline lanes_mask lanes_alike(lanes x, int lane) { return lanes_equal(x, lanes_set(lanes_of(x, lane))); }
static inline lanes_mask lanes_finite(lanes x) { return lanes_equal(x - x, lanes_set(0.0)); }
static inline lanes lanes_clip(lanes x, lanes low, lanes high)
{
    return lanes_where(lanes_less(x, low), low, lanes_minimum(high, x));
}

/* The two operations on bits in ops/elementary.py. The last bit of a double between 2^52 and 2^53 is worth 1. Adding a
 * whole number puts that number into the last bits; conversely, setting last bits adds their number to the value. */
static inline lanes lanes_power_of_two(lanes k)
{
    return (lanes)((lanes_words)(k + lanes_set(0x1.8p52 + 1023.0)) << 52);
}
static inline lanes lanes_exponent(lanes x)
{
    return (lanes)((lanes_words)x >> 52 | (lanes_words)lanes_set(0x1p52)) - lanes_set(0x1p52) - lanes_set(1023.0);
}

#endif
