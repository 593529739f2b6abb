/* What changes while actuators that are stepped together run, and what acts on them.
 *
 * `lanes` are a number for each of them: one number by scalar.h, several if vector.h comes first. model.h holds the
 * sizes; it is generated, and so are the equations.
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

/* A condition without which it does not compile; C99 has no static assertions. */
#define CORE_REQUIRE(what, condition) typedef char core_required_##what[(condition) ? 1 : -1]

/* The plant's states. Those of one lane are followed by the duration of the last step, which writes both in place: a copy
 * would be read in wider words than those just written, for which a processor waits. */
typedef struct {
    lanes x[CORE_PLANT + (LANES == 1)];
} core_plant;

/* Command, loads (aero_torque and the motion loads, which have a mean over a tick), inputs that act through limits, and
 * the actuator's further inputs. Their array has an unused element, since there may be no further input. */
typedef struct {
    lanes command, loads[CORE_LOADS], supply, enable, further[CORE_FURTHER + 1];
} core_inputs;

/* How the inputs change from those at `begin` [s]; enable and other Booleans do not. */
typedef struct {
    lanes begin, command, loads[CORE_LOADS], supply, further[CORE_ACTING + 1];
} core_ramp;

/* A tick that contains a communication point: the plant's time within the tick [s], the time up to which inputs are
 * known [s], the inputs at the beginning, and the integrals of the loads' differences from these. */
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

/* Everything that changes while running. The line is the delay buffer: the DAC's
 * values up to the present one and, behind them, the commands on their way, the oldest first. */
typedef struct {
    core_part part;
    core_time time;
    lanes sampled[CORE_SAMPLED]; /* controller states, measured fin angle, limited, states that steps see */
    lanes active;
    core_plant plant, tentative;
    lanes line[CORE_LINE];
} core_state;

/* A state begins with the part and ends with the line, of which core_keep copies what is in use. */
CORE_REQUIRE(order_of_state, offsetof(core_state, time) == sizeof(core_part)
                             && offsetof(core_state, line) == sizeof(core_state) - CORE_LINE * sizeof(lanes));

typedef enum { CORE_DONE, CORE_NOT_FINITE, CORE_TOO_MANY_EVENTS, CORE_TOO_MANY_TICKS } core_result;

/* The Schedule of schedule.py. Lanes that move have as many ticks, samples and late commands as the first. */
typedef struct {
    lanes CORE_SCHEDULE;
} core_schedule;

#endif
