/* The life cycle of an instance: created, initialized, terminated, reset, freed. Common to all versions of FMI. */
#ifndef EMCAS_LIFE_CYCLE_H
#define EMCAS_LIFE_CYCLE_H

#include "instance.h"

static void reset_instance(instance *m)
{
    memset(&m->s, 0, sizeof m->s);
    memcpy(m->s.values, START, sizeof START);
    m->s.phase = INSTANTIATED;
    m->s.stop = HUGE_VAL;
    m->pending = m->moved = m->check_inputs = 1;
    m->ticks = m->interval_known = false;
    m->commanded = 0;
    memset(m->warned, 0, sizeof m->warned);
}

/* Return a new instance with this name; log the reason and return NULL if it cannot be created. */
static instance *new_instance(const host_services *host, const char *name, const char *guid, bool logging)
{
    const bool named = name && *name;
    const size_t length = named ? strlen(name) + 1 : 0;
    const instance none = {
        .host = *host, .name = named ? name : MODEL_NAME, .logged = logging ? EVERY_CATEGORY : 0};
    instance *m = NULL;
    if (!named)
        report(&none, FMI(Error), "the instance has no name");
    else if (!guid || strcmp(guid, MODEL_GUID) != 0)
        report(&none, FMI(Error), "the " GUID_NAME " of the call is %s, this FMU has %s", guid ? guid : "none",
               MODEL_GUID);
    else if (!(m = allocate(host, sizeof *m + length)))
        report(&none, FMI(Error), "no memory for an instance");
    if (!m) return NULL;
    *m = none;
    m->name = memcpy(m + 1, name, length);
    reset_instance(m);
    return m;
}

void FMI(FreeInstance)(void *c)
{
    instance *m = c;
    if (m) release(&m->host, m);
}

/* Set the start time [s] and, if the host has one, the stop time [s]; an error if they are impossible. */
static int begin_initialization(instance *m, double start, bool stops, double stop)
{
    if (!core_finite(start)) return report(m, FMI(Error), "start time %.9g is not finite", start);
    if (stops && !(stop >= start))
        return report(m, FMI(Error), "stop time %.9g s is not at or after the start time %.9g s", stop, start);
    m->s.start = start;
    m->s.stop = stops ? stop : HUGE_VAL;
    return FMI(OK);
}

/* Start the run unless parameters or start time are refused; the host may correct parameters and repeat the call. */
FMI(Status) FMI(ExitInitializationMode)(void *c)
{
    instance *m = c;
    if (!allowed(m, INITIALIZING, __func__) || !sound(m, FMI(Error))) return FMI(Error);
    if (!m->s.fresh) refresh(m); /* in the run it would not clear the outputs if an input is not finite */
    prepare(m);
    if (fabs(m->s.start) > m->fins.latest) return report(m, FMI(Error), TOO_LATE, m->s.start, m->fins.latest);
    all_rules_kept(m, FMI(Warning));
    multi_fin_start(&m->fins, &m->s.fins);
    m->s.phase = m->event_mode ? HANDLING_EVENT : RUNNING;
    m->s.fresh = 0;
    return FMI(OK);
}

FMI(Status) FMI(Terminate)(void *c)
{
    instance *m = c;
    if (!allowed(m, DURING_RUN, __func__)) return FMI(Error);
    if (!m->s.fresh) refresh(m);
    m->s.phase = TERMINATED;
    return FMI(OK);
}

FMI(Status) FMI(Reset)(void *c)
{
    if (!c) return FMI(Error);
    reset_instance(c);
    return FMI(OK);
}

const char *FMI(GetVersion)(void)
{
    return FMI(Version);
}

#endif
