/* The state and the inputs of actuators that are stepped together.
 *
 * `lanes` has a number for each actuator: with scalar.h (the default) it is one number; if vector.h is included first,
 * several. model.h has the sizes; it is generated, as are the equations.
 */
#ifndef EMCAS_CORE_STATE_H
#define EMCAS_CORE_STATE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#ifndef EMCAS_VECTOR_H
#include "scalar.h"
#endif
#include "model.h"

/* Stop the compilation if a condition is false; C99 has no static assertions. */
#define CORE_REQUIRE(what, condition) typedef char core_required_##what[(condition) ? 1 : -1]

/* The plant's states. With one lane the duration of the last step follows them, and the step then writes both in
 * place, since a copy with wider loads than the preceding stores would stall (no store forwarding). */
typedef struct {
    lanes x[CORE_PLANT + (LANES == 1)];
} core_plant;

/* Command, loads (aero_torque and the motion loads, of which a tick uses the mean), inputs that act through limits, and
 * the actuator's further inputs. The array `further` has an unused element, since C has no empty arrays. */
typedef struct {
    lanes command, loads[CORE_LOADS], supply, enable, further[CORE_FURTHER + 1];
} core_inputs;

/* Derivatives of the inputs from `begin` [s] on; enable and other Booleans are held. */
typedef struct {
    lanes begin, command, loads[CORE_LOADS], supply, further[CORE_ACTING + 1];
} core_ramp;

/* A tick that contains a communication point: the plant's time within the tick [s], the time up to which inputs are
 * known [s], the inputs of the part's first interval, and the integrals of the loads' differences from these. */
typedef struct {
    lanes origin, covered;
    core_inputs first;
    lanes loads[CORE_LOADS];
} core_part;

/* The number of the sample period and of the tick in it, and whether there is a part of a tick. */
typedef struct {
    int64_t period;
    int32_t position, partial;
} core_time;

/* Everything that changes while running. The line is the delay buffer: the DAC's values up to the present one, then
 * the commands that are still delayed, both with the oldest first. */
typedef struct {
    core_part part;
    core_time time;
    lanes sampled[CORE_SAMPLED]; /* controller states, measured fin angle, limited, sampled states */
    lanes active; /* the reference in the drive */
    core_plant plant, tentative;
    lanes line[CORE_LINE];
} core_state;

/* A state begins with the part and ends with the line; core_keep copies the used values of both. */
CORE_REQUIRE(order_of_state, offsetof(core_state, time) == sizeof(core_part)
                             && offsetof(core_state, line) == sizeof(core_state) - CORE_LINE * sizeof(lanes));

typedef enum { CORE_DONE, CORE_NOT_FINITE, CORE_TOO_MANY_EVENTS, CORE_TOO_MANY_TICKS } core_result;

/* The Schedule of schedule.py. Lanes that move together have equal numbers of ticks, delayed samples and commands. */
typedef struct {
    lanes CORE_SCHEDULE;
} core_schedule;

#endif
