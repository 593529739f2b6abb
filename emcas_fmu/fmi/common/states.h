/* FMU states: copied, restored, serialized. Common to all versions of FMI. */
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

/* Return why a core cannot be in this state at `now` [s]; NULL if it can. */
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
    if (now * DBL_EPSILON > plan->slack) return "place in time";
    if (now < period - plan->slack || now > period + plan->period + plan->slack) return "place in time";
    return NULL;
}

static const char *unsound_line(const multi_fin *m, const model_state *s)
{
    if (!core_finite(s->fins.line)) return "state of the supply's line";
    if (s->fins.instant < 1) return "place in time of the supply's line";
#if MULTI_FIN_LINE
    /* The next instant of a line that is not stiff is ahead, within an interval. */
    const double interval = multi_fin_interval(m), ahead = (double)s->fins.instant * interval - s->now;
    if (!multi_fin_stiff(m) && (ahead < 0.0 || ahead > interval * (1.0 + 1e-9) + 1e-9))
        return "place in time of the supply's line";
#else
    (void)m;
#endif
    return NULL;
}

/* Return why a deserialized state cannot be one of this FMU, NULL if it can: it may have been damaged or made up. */
static const char *unsound(const instance *m, const model_state *s)
{
    if (s->phase != INSTANTIATED && s->phase != INITIALIZING && s->phase != RUNNING && s->phase != TERMINATED
        && !(s->phase == HANDLING_EVENT && handles_events(&m->host)))
        return "unknown phase";
    if (!core_finite(s->start) || !core_finite(s->now) || s->now < 0.0) return "time";
    if (!core_all_finite(s->rates, FMU_INPUTS)) return "input derivatives";
    for (size_t i = 0; i < FMU_VARIABLES; ++i) {
        const double value = s->values[i];
        if (VARIABLE[i].kind != REAL
            && (!core_finite(value) || value != floor(value) || fabs(value) > (VARIABLE[i].kind == INTEGER ? INT32_MAX : 1)))
            return VARIABLE[i].name; /* not an integer, or not 0 or 1 */
    }
    if (s->phase & BEFORE_RUN) return NULL; /* the core will be started anew */
    instance probe = {.host = m->host, .name = m->name};
    probe.s = *s;
    if (!all_rules_hold(&probe)) return "parameters out of their limits";
    prepare(&probe);
    if (fabs(s->start) > probe.fins.latest) return "time";
    for (size_t fin = 0; fin < FINS; ++fin) {
        const core_schedule plan = core_scheduled(probe.fins.p[fin], probe.fins.c[fin]);
        const char *reason = unsound_core(&s->fins.core[fin], &plan, s->now);
        if (reason) return reason;
    }
    return unsound_line(&probe.fins, s);
}

static int copy_state(instance *m, void **state, const char *function)
{
    if (!allowed(m, ANY_PHASE, function)) return STATUS_ERROR;
    if (!state) return report(m, STATUS_ERROR, "%s: the pointer for the result is NULL", function);
    if (!*state) *state = allocate(&m->host, sizeof(model_state));
    if (!*state) return report(m, STATUS_ERROR, "%s: no memory", function);
    memcpy(*state, &m->s, sizeof m->s);
    return STATUS_OK;
}

static int restore_state(instance *m, const void *state, const char *function)
{
    const model_state *s = state;
    if (!allowed(m, ANY_PHASE, function)) return STATUS_ERROR;
    if (!s) return report(m, STATUS_ERROR, "%s: the state is NULL", function);
    if (memcmp(m->s.values + PARAMETER_BEGIN, s->values + PARAMETER_BEGIN, sizeof s->values - PARAMETER_BEGIN * sizeof(double)) != 0)
        m->unprepared = 1;
    m->s = *s;
    m->moved = m->check_inputs = 1;
    return STATUS_OK;
}

static int free_state(const instance *m, void **state)
{
    if (!m) return STATUS_ERROR;
    if (state && *state) {
        release(&m->host, *state);
        *state = NULL;
    }
    return STATUS_OK;
}

static int serialized_size(const instance *m, const void *state, size_t *size, const char *function)
{
    if (!allowed(m, ANY_PHASE, function)) return STATUS_ERROR;
    if (!state || !size) return report(m, STATUS_ERROR, "%s: argument missing", function);
    *size = sizeof(state_head) + sizeof(model_state);
    return STATUS_OK;
}

static int serialize(const instance *m, const void *state, void *bytes, size_t size, const char *function)
{
    if (!allowed(m, ANY_PHASE, function)) return STATUS_ERROR;
    if (!state || !bytes) return report(m, STATUS_ERROR, "%s: argument missing", function);
    if (size < sizeof(state_head) + sizeof(model_state))
        return report(m, STATUS_ERROR, "%s: %lu bytes are too few", function, (unsigned long)size);
    state_head head = {.magic = MODEL_STATE, .check = checksum(state, sizeof(model_state))};
    memcpy(bytes, &head, sizeof head);
    memcpy((char *)bytes + sizeof head, state, sizeof(model_state));
    return STATUS_OK;
}

static int deserialize(instance *m, const void *bytes, size_t size, void **state, const char *function)
{
    const state_head expected = {.magic = MODEL_STATE};
    const char *content = bytes;
    state_head head;
    if (!allowed(m, ANY_PHASE, function)) return STATUS_ERROR;
    if (!bytes || !state) return report(m, STATUS_ERROR, "%s: argument missing", function);
    if (size != sizeof head + sizeof(model_state))
        return report(m, STATUS_ERROR, "FMU state refused: it has %lu bytes, not %lu", (unsigned long)size,
                      (unsigned long)(sizeof head + sizeof(model_state)));
    memcpy(&head, content, sizeof head);
    if (memcmp(head.magic, expected.magic, sizeof head.magic) != 0)
        return report(m, STATUS_ERROR, "FMU state refused: it is of another FMU or build, not of %s", MODEL_STATE);
    if (head.check != checksum(content + sizeof head, sizeof(model_state)))
        return report(m, STATUS_ERROR, "FMU state refused: its checksum is wrong");
    model_state s;
    memcpy(&s, content + sizeof head, sizeof s);
    s.fresh = 0;
    const char *reason = unsound(m, &s);
    if (reason) return report(m, STATUS_ERROR, "FMU state refused: %s", reason);
    if (!*state) *state = allocate(&m->host, sizeof s);
    if (!*state) return report(m, STATUS_ERROR, "%s: no memory", function);
    memcpy(*state, &s, sizeof s);
    return STATUS_OK;
}

#endif
