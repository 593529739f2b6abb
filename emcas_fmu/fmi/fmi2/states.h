/* FMU states: kept, put back, serialized; a part of fmi2.c. */
#ifndef EMCAS_STATES_H
#define EMCAS_STATES_H

#include "instance.h"

/* FNV-1a, 64 bit. */
static uint64_t checksum(const void *data, size_t size)
{
    const unsigned char *bytes = data;
    uint64_t hash = UINT64_C(14695981039346656037);
    for (size_t i = 0; i < size; ++i) hash = (hash ^ bytes[i]) * UINT64_C(1099511628211);
    return hash;
}

/* What a fin's core must fulfil at `now`. Gives the reason if it does not. */
static const char *unsound_core(const core_state *core, const core_schedule *plan, double now)
{
    if (!core_all_finite(core->plant.x, CORE_PLANT) || !core_all_finite(core->tentative.x, CORE_PLANT)
        || !core_all_finite(core->sampled, CORE_SAMPLED) || !core_finite(core->active))
        return "a number is not finite";
    if (!core_all_finite(core->line, core_line_length(plan))) return "delay line";
    if (core->period < 0 || core->period > INT64_C(1000000000000) || core->position < 0
        || core->position >= plan->before + plan->after || (core->partial != 0 && core->partial != 1))
        return "place in time";
    if (core->partial) {
        const core_part *part = &core->part;
        double numbers[sizeof *part / sizeof(double)];
        memcpy(numbers, part, sizeof numbers);
        const double h = core->position < (int32_t)plan->before ? plan->h_before : plan->h_after;
        if (!core_all_finite(numbers, sizeof numbers / sizeof *numbers) || part->origin < 0.0
            || part->covered < part->origin || part->covered > h)
            return "part of a tick";
    }
    const double period = (double)core->period * plan->period;
    if (now < period - plan->slack || now > period + plan->period + plan->slack) return "place in time";
    return NULL;
}

static const char *unsound_line(const multi_fin *m, const model_state *s)
{
    if (!core_finite(s->fins.line)) return "state of the supply's line";
    if (s->fins.instant < 1) return "place in time of the supply's line";
#if MULTI_FIN_LINE
    /* The next instant of a line that is not stiff lies ahead, within an interval. */
    const double interval = multi_fin_interval(m), ahead = (double)s->fins.instant * interval - s->now;
    if (!multi_fin_stiff(m) && (ahead < 0.0 || ahead > interval * (1.0 + 1e-9) + 1e-9))
        return "place in time of the supply's line";
#else
    (void)m;
#endif
    return NULL;
}

/* What a state must fulfil that did not come out of fmi2GetFMUstate itself: it may have been
 * stored, sent, or made up. Gives the reason if it does not. */
static const char *unsound(const instance *m, const model_state *s)
{
    if (s->phase != INSTANTIATED && s->phase != INITIALIZING && s->phase != RUNNING && s->phase != TERMINATED)
        return "unknown phase";
    if (!core_finite(s->start) || !core_finite(s->now) || s->now < 0.0) return "time";
    if (!core_all_finite(s->rates, UNIT_INPUTS)) return "input derivatives";
    for (size_t i = 0; i < UNIT_VARIABLES; ++i) {
        const double value = s->values[i];
        if (VARIABLE[i].kind != REAL
            && (!core_finite(value) || value != floor(value) || fabs(value) > (VARIABLE[i].kind == INTEGER ? INT32_MAX : 1)))
            return VARIABLE[i].name; /* no whole number, no truth */
    }
    if (s->phase == INSTANTIATED || s->phase == INITIALIZING) return NULL; /* the core is made anew */
    instance probe = {.callbacks = m->callbacks, .name = m->name};
    probe.s = *s;
    if (!all_rules_hold(&probe)) return "parameters out of their limits";
    prepare(&probe);
    for (size_t fin = 0; fin < FINS; ++fin) {
        const core_schedule plan = core_scheduled(probe.fins.p[fin], probe.fins.c[fin]);
        const char *reason = unsound_core(&s->fins.core[fin], &plan, s->now);
        if (reason) return reason;
    }
    return unsound_line(&probe.fins, s);
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    instance *m = c;
    if (!allowed(m, ANY_PHASE, "fmi2GetFMUstate")) return fmi2Error;
    if (!state) return report(m, fmi2Error, "fmi2GetFMUstate: nowhere to put it");
    if (!*state) *state = allocate(&m->callbacks, sizeof(model_state));
    if (!*state) return report(m, fmi2Error, "fmi2GetFMUstate: no memory");
    memcpy(*state, &m->s, sizeof m->s);
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    instance *m = c;
    const model_state *s = state;
    if (!allowed(m, ANY_PHASE, "fmi2SetFMUstate")) return fmi2Error;
    if (!s) return report(m, fmi2Error, "fmi2SetFMUstate: no state given");
    if (memcmp(m->s.values + PARAMETER_BEGIN, s->values + PARAMETER_BEGIN, sizeof s->values - PARAMETER_BEGIN * sizeof(double)) != 0)
        m->unprepared = 1;
    m->s = *s;
    m->moved = m->check_inputs = 1;
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    const instance *m = c;
    if (!m) return fmi2Error;
    if (state && *state) {
        release(&m->callbacks, *state);
        *state = NULL;
    }
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    const instance *m = c;
    if (!allowed(m, ANY_PHASE, "fmi2SerializedFMUstateSize")) return fmi2Error;
    if (!state || !size) return report(m, fmi2Error, "fmi2SerializedFMUstateSize: argument missing");
    *size = sizeof(state_head) + sizeof(model_state);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    const instance *m = c;
    if (!allowed(m, ANY_PHASE, "fmi2SerializeFMUstate")) return fmi2Error;
    if (!state || !bytes) return report(m, fmi2Error, "fmi2SerializeFMUstate: argument missing");
    if (size < sizeof(state_head) + sizeof(model_state))
        return report(m, fmi2Error, "fmi2SerializeFMUstate: %lu bytes are too few", (unsigned long)size);
    state_head head = {.magic = MODEL_STATE, .check = checksum(state, sizeof(model_state))};
    memcpy(bytes, &head, sizeof head);
    memcpy(bytes + sizeof head, state, sizeof(model_state));
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    const instance *m = c;
    const state_head expected = {.magic = MODEL_STATE};
    state_head head;
    if (!allowed(m, ANY_PHASE, "fmi2DeSerializeFMUstate")) return fmi2Error;
    if (!bytes || !state) return report(m, fmi2Error, "fmi2DeSerializeFMUstate: argument missing");
    if (size != sizeof head + sizeof(model_state))
        return report(m, fmi2Error, "FMU state refused: it has %lu bytes, not %lu", (unsigned long)size,
                      (unsigned long)(sizeof head + sizeof(model_state)));
    memcpy(&head, bytes, sizeof head);
    if (memcmp(head.magic, expected.magic, sizeof head.magic) != 0)
        return report(m, fmi2Error, "FMU state refused: it is of another FMU or build, not of %s", MODEL_STATE);
    if (head.check != checksum(bytes + sizeof head, sizeof(model_state)))
        return report(m, fmi2Error, "FMU state refused: its checksum is wrong");
    model_state s;
    memcpy(&s, bytes + sizeof head, sizeof s);
    s.fresh = 0;
    const char *reason = unsound(m, &s);
    if (reason) return report(m, fmi2Error, "FMU state refused: %s", reason);
    if (!*state) *state = allocate(&m->callbacks, sizeof s);
    if (!*state) return report(m, fmi2Error, "fmi2DeSerializeFMUstate: no memory");
    memcpy(*state, &s, sizeof s);
    return fmi2OK;
}

#endif
