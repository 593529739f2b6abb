/* Times of the steps of one actuator under random inputs: each step of a sequence several times from the same state. */
#define _POSIX_C_SOURCE 199309L
#include <time.h>

#include "kernel.h"

/* Pieces that a communication step is taken in: ticks, what is left of them behind events, parts of ticks. */
static unsigned pieces;
#define kernel_step(...) (++pieces, kernel_step(__VA_ARGS__))

#include "batch.c"

enum { SEQUENCE = 1000 };

typedef struct {
    core_inputs in;
    double end;
} step;

typedef struct {
    double command, load, supply; /* largest command [rad] and load [N.m], the supply [V, Pa] */
    uint64_t seed, steps, repeats;
} task;

/* Sums over the first time each step was taken, and the largest. */
typedef struct {
    uint64_t pieces, most_pieces, refused, clock_ns;
} tally;

static uint64_t ns_now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (uint64_t)t.tv_sec * 1000000000u + (uint64_t)t.tv_nsec;
}

/* xorshift64*: G. Marsaglia, "Xorshift RNGs" (2003); from 0 to 1. */
static double random_number(uint64_t *state)
{
    *state ^= *state >> 12, *state ^= *state << 25, *state ^= *state >> 27;
    return (double)((*state * UINT64_C(2685821657736338717)) >> 11) * 0x1p-53;
}

/* A host's next step: mostly of 1 ms, else shorter; inputs jump now and then, and some commands move on. */
static void draw(const task *t, const core_inputs *calm, uint64_t *state, step *next)
{
    const double what = random_number(state), value = 2.0 * random_number(state) - 1.0;
    core_inputs *in = &next->in;
    if (what < 0.05)
        in->command = value * t->command;
    else if (what < 0.3)
        in->command += 1e-3 * value;
    else if (what < 0.4)
        in->loads[0] = value * t->load;
    else if (what < 0.41)
        in->supply = (0.5 + 0.5 * value) * t->supply;
    else if (what < 0.43)
        in->supply = t->supply;
    else if (what < 0.432)
        in->enable = 0.0;
    else if (what < 0.452)
        in->enable = calm->enable;
    next->end += random_number(state) < 0.7 ? 1e-3 : 1e-5 + 9.9e-4 * random_number(state);
}

/* The core's inputs from an array: command, loads, supply, enable, the actuator's further inputs. */
static core_inputs listed(const double *in)
{
    core_inputs inputs = {.command = in[0], .supply = in[1 + CORE_LOADS], .enable = in[2 + CORE_LOADS]};
    memcpy(inputs.loads, in + 1, sizeof inputs.loads);
    memcpy(inputs.further, in + 3 + CORE_LOADS, CORE_FURTHER * sizeof *in);
    return inputs;
}

/* The least time [ns] of each step, of `repeats`, into `least`, and that of its first time into `first`. */
API int step_times(const double *p, const double *calm, const task *t, uint32_t *least, uint32_t *first, tally *sums)
{
    const core_inputs start = listed(calm);
    step steps[SEQUENCE], last = {start, 0.0};
    uint64_t state = t->seed;
    double out[MODEL_OUTPUTS];
    *sums = (tally){.clock_ns = UINT64_MAX};
    if (!rules_hold(p)) return 0;
    double c[KERNEL_CONSTANTS + 1];
    core_state now = {.time = {0, 0, 0}};
    kernel_prepare(p, c);
    core_start(p, c, &now);
    for (uint64_t begin = 0; begin < t->steps; begin += SEQUENCE) {
        for (int i = 0; i < SEQUENCE; ++i) {
            draw(t, &start, &state, &last);
            steps[i] = last;
        }
        const core_state before = now;
        for (uint64_t repeat = 0; repeat < t->repeats; ++repeat) {
            now = before;
            for (uint64_t i = 0; i < SEQUENCE; ++i) {
                pieces = 0;
                const uint64_t from = ns_now();
                const core_result result = core_run(p, c, &now, steps[i].end, &steps[i].in, NULL, out);
                const uint64_t till = ns_now(), again = ns_now();
                const uint32_t spent = (uint32_t)(till - from);
                if (again - till < sums->clock_ns) sums->clock_ns = again - till;
                if (repeat == 0 || spent < least[begin + i]) least[begin + i] = spent;
                if (repeat > 0) continue;
                first[begin + i] = spent;
                sums->pieces += pieces;
                sums->refused += result != CORE_DONE;
                if (pieces > sums->most_pieces) sums->most_pieces = pieces;
            }
        }
    }
    return 1;
}
