/* FMU states: copying, restoring, serializing. Common to all versions of FMI, with the names of FMI 3.0. */
#ifndef EMCAS_STATES_H
#define EMCAS_STATES_H

#include "instance.h"

/* Return the hash FNV-1a of 64 bits. */
static uint64_t checksum(const void *data, size_t size)
{
    const unsigned char *bytes = data;
    uint64_t hash = UINT64_C(14695981039346656037);
    for (size_t i = 0; i < size; ++i) hash = (hash ^ bytes[i]) * UINT64_C(1099511628211);
    return hash;
}

/* Return the reason why a core cannot be in this state at `now` [s from the start]; NULL if it can. */
static const char *unsound_core(const core_state *core, const core_schedule *plan, double now)
{
    if (!core_all_finite(core->plant.x, CORE_PLANT) || !core_all_finite(core->tentative.x, CORE_PLANT)
        || !core_all_finite(core->sampled, CORE_SAMPLED) || !core_finite(core->active)
        || !core_all_finite(core->line, core_line_length(plan)))
        return "a number is not finite";
    if (core->time.period < 0 || core->time.period > INT64_C(1000000000000) || core->time.position < 0
        || core->time.position >= plan->before + plan->after || (core->time.partial != 0 && core->time.partial != 1))
        return "impossible position in time";
    if (core->time.partial) {
        const core_part *part = &core->part;
        double numbers[sizeof *part / sizeof(double)];
        memcpy(numbers, part, sizeof numbers);
        const double h = core->time.position < (int32_t)plan->before ? plan->h_before : plan->h_after;
        if (!core_all_finite(numbers, sizeof numbers / sizeof *numbers) || part->origin < 0.0
            || part->covered < part->origin || part->covered > h)
            return "impossible part of a tick";
    }
    const double period = (double)core->time.period * plan->sample_time;
    if (now * DBL_EPSILON > plan->slack || now < period - plan->slack
        || now > period + plan->sample_time + plan->slack)
        return "impossible position in time";
    return NULL;
}

static const char *unsound_line(const multi_fin *m, const model_state *s)
{
    if (!core_all_finite(s->fins.line, MODEL_LINE_STATES)) return "impossible state of the supply's line";
    if (s->fins.instant < 1) return "impossible time of the supply's line";
#if MULTI_FIN_LINE
    if (!core_finite(s->fins.mean) || !core_all_finite(s->fins.charge, FINS) || !core_all_finite(s->fins.power, FINS))
        return "impossible state of the supply's line";
    /* The next instant of a line that is not stiff is at most an interval ahead, apart from rounding. */
    const double interval = multi_fin_interval(m), ahead = (double)s->fins.instant * interval - s->now;
    if (!multi_fin_stiff(m) && (ahead < 0.0 || ahead > interval + 1e-9))
        return "impossible time of the supply's line";
#else
    (void)m;
#endif
    return NULL;
}

/* Return the reason why a state with the right checksum cannot be one of this FMU; NULL if it can. */
static const char *unsound(const instance *m, const model_state *s)
{
    if (s->phase != INSTANTIATED && s->phase != INITIALIZING && s->phase != RUNNING && s->phase != TERMINATED
        && s->phase != HANDLING_EVENT)
        return "unknown phase";
    if (!core_finite(s->start) || !(s->stop >= s->start) || !core_finite(s->now) || s->now < 0.0)
        return "impossible time";
    if (!core_all_finite(s->rates, FMU_INPUTS)) return "an input derivative is not finite";
    for (size_t i = 0; i < FMU_VARIABLES; ++i) {
        const double value = s->values[i];
        if (VARIABLE[i].kind != REAL
            && (!core_finite(value) || value != floor(value)
                || fabs(value) > (VARIABLE[i].kind == INTEGER ? INT32_MAX : 1)))
            return VARIABLE[i].name; /* not an integer, or not 0 or 1 */
    }
    if (s->phase & BEFORE_RUN) return NULL; /* the end of initialization starts the core anew */
    instance probe = {.host = m->host, .name = m->name}; /* logs nothing */
    probe.s = *s;
    const double *tuned = s->tuned;
    for (size_t i = PARAMETER_BEGIN; i < FMU_VARIABLES; ++i)
        if (VARIABLE[i].tunable) probe.s.values[i] = *tuned++;
    if (!sound(&probe, FMI(Error))) return "its parameters break a limit or rule";
    prepare(&probe);
    if (fabs(s->start) > probe.fins.latest) return "impossible time";
    for (size_t fin = 0; fin < FINS; ++fin) {
        const core_schedule plan = core_scheduled(probe.fins.p[fin], probe.fins.c[fin]);
        const char *reason = unsound_core(&s->fins.core[fin], &plan, s->now);
        if (reason) return reason;
    }
    return unsound_line(&probe.fins, s);
}

FMI(Status) FMI(GetFMUState)(void *c, void **state)
{
    instance *m = c;
    if (!allowed_with(m, ANY_PHASE, 1, state, state, __func__)) return FMI(Error);
    if (!*state) *state = allocate(&m->host, sizeof(model_state));
    if (!*state) return report(m, FMI(Error), "%s: no memory", __func__);
    memcpy(*state, &m->s, sizeof m->s);
    return FMI(OK);
}

FMI(Status) FMI(SetFMUState)(void *c, void *state)
{
    instance *m = c;
    const model_state *s = state;
    if (!allowed_with(m, ANY_PHASE, 1, s, s, __func__)) return FMI(Error);
    if (s->phase == HANDLING_EVENT && !m->event_mode)
        return report(m, FMI(Error), "FMU state refused: it is of event mode; restore it in an instance that has it");
    if (memcmp(m->s.values + PARAMETER_BEGIN, s->values + PARAMETER_BEGIN,
               (FMU_VARIABLES - PARAMETER_BEGIN) * sizeof(double)) != 0)
        m->pending = 1;
    m->s = *s;
    m->moved = m->check_inputs = 1;
    m->ticks = false;
    return FMI(OK);
}

FMI(Status) FMI(FreeFMUState)(void *c, void **state)
{
    const instance *m = c;
    if (!m) return FMI(Error);
    if (state && *state) {
        release(&m->host, *state);
        *state = NULL;
    }
    return FMI(OK);
}

FMI(Status) FMI(SerializedFMUStateSize)(void *c, void *state, size_t *size)
{
    if (!allowed_with(c, ANY_PHASE, 1, state, size, __func__)) return FMI(Error);
    *size = sizeof(state_head) + sizeof(model_state);
    return FMI(OK);
}

FMI(Status) FMI(SerializeFMUState)(void *c, void *state, FMI(Byte) bytes[], size_t size)
{
    if (!allowed_with(c, ANY_PHASE, 1, state, bytes, __func__)) return FMI(Error);
    if (size < sizeof(state_head) + sizeof(model_state))
        return report(c, FMI(Error), "%s: %lu bytes are too few", __func__, (unsigned long)size);
    state_head head = {.magic = MODEL_STATE, .check = checksum(state, sizeof(model_state))};
    memcpy(bytes, &head, sizeof head);
    memcpy(bytes + sizeof head, state, sizeof(model_state));
    return FMI(OK);
}

FMI(Status) FMI(DeserializeFMUState)(void *c, const FMI(Byte) bytes[], size_t size, void **state)
{
    const state_head expected = {.magic = MODEL_STATE};
    instance *m = c;
    state_head head;
    if (!allowed_with(m, ANY_PHASE, 1, bytes, state, __func__)) return FMI(Error);
    if (size != sizeof head + sizeof(model_state))
        return report(m, FMI(Error), "FMU state refused: it has %lu bytes, not %lu", (unsigned long)size,
                      (unsigned long)(sizeof head + sizeof(model_state)));
    memcpy(&head, bytes, sizeof head);
    if (memcmp(head.magic, expected.magic, sizeof head.magic) != 0)
        return report(m, FMI(Error), "FMU state refused: it is of another FMU or build, not of %s", MODEL_STATE);
    if (head.check != checksum(bytes + sizeof head, sizeof(model_state)))
        return report(m, FMI(Error), "FMU state refused: its checksum is wrong");
    model_state s;
    memcpy(&s, bytes + sizeof head, sizeof s);
    s.fresh = 0;
    const char *reason = unsound(m, &s);
    if (reason) return report(m, FMI(Error), "FMU state refused: %s", reason);
    if (!*state) *state = allocate(&m->host, sizeof s);
    if (!*state) return report(m, FMI(Error), "%s: no memory", __func__);
    memcpy(*state, &s, sizeof s);
    return FMI(OK);
}

#endif
