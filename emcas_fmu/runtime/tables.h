/* Columns of inputs and outputs of many whole runs. */
#ifndef EMCAS_TABLES_H
#define EMCAS_TABLES_H

#include "core.h"

#if defined _WIN32
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif

/* An input of many runs: its first value, and the strides [doubles] to the next run and to the next row; 0 if the value
 * is the same. */
typedef struct {
    const double *first;
    ptrdiff_t run, row;
} input_column;

/* An output of many runs, likewise; `index` is its position among the outputs; it is kept at every `every`th point. */
typedef struct {
    double *first;
    ptrdiff_t run, row;
    size_t index, every;
} output_column;

/* Further results of a run, behind those of core_result; RUN_APART: it did not stay with its group. */
enum { RUN_REFUSED = CORE_TOO_MANY_TICKS + 1, RUN_INPUT_NOT_FINITE, RUN_APART };

/* Whether an output is kept at a point of time; without a division in the usual case, since divisions are slow. */
static inline bool kept_at(const output_column *column, size_t k)
{
    return column->every == 1 || k % column->every == 0;
}

static inline double *value_at(const output_column *column, size_t run, size_t k)
{
    return column->first + (ptrdiff_t)run * column->run
           + (ptrdiff_t)(column->every == 1 ? k : k / column->every) * column->row;
}

/* Set the outputs of a run at points that it did not reach to NaN. */
static inline void not_reached(const output_column *out, size_t columns, size_t run, size_t reached, size_t points)
{
    for (size_t k = reached; k < points; ++k)
        for (size_t j = 0; j < columns; ++j)
            if (kept_at(&out[j], k)) *value_at(&out[j], run, k) = NAN;
}

#endif
