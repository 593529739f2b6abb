/* The fins of a unit, which move together on one bus: multi_fin.py in C, function by function.
 *
 * FINS is their number. On a stiff bus each runs as it would alone; a single fin and fins without a supply have
 * no other. With a source resistance the fins stop together at the instants of the bus, k times its interval,
 * where the sag follows their current; it is held in between.
 */
#ifndef EMCAS_MULTI_FIN_H
#define EMCAS_MULTI_FIN_H

#include "core.h"

#define MULTI_FIN_BUS (FINS > 1 && MODEL_SUPPLY >= 0)

/* Voltage, current and power of the bus go before the fins' outputs. */
enum { BUS_OUTPUTS = MULTI_FIN_BUS ? 3 : 0, MULTI_FIN_OUTPUTS = BUS_OUTPUTS + FINS * MODEL_OUTPUTS };

/* Each fin's parameters and what follows from them; resistance [Ohm] and interval [s] of the bus; tolerance of
 * communication points [s]. */
typedef struct {
    const double *p[FINS];
    double c[FINS][KERNEL_CONSTANTS];
    double resistance, interval, slack;
} multi_fin;

/* Everything that changes while running: of the bus the sag and the instant that comes next. */
typedef struct {
    core_state core[FINS];
    double sag;
    int64_t instant;
} multi_fin_state;

/* Take the parameters, those of the fins one after the other. */
static void multi_fin_bind(multi_fin *m, const double *p, double resistance, double interval)
{
    m->resistance = resistance;
    m->interval = interval;
    m->slack = HUGE_VAL;
    for (size_t fin = 0; fin < FINS; ++fin) {
        m->p[fin] = p + fin * MODEL_PARAMETERS;
        kernel_prepare(m->p[fin], m->c[fin]);
        m->slack = fmin(m->slack, core_scheduled(m->p[fin], m->c[fin]).slack);
    }
}

static void multi_fin_start(const multi_fin *m, multi_fin_state *s)
{
    for (size_t fin = 0; fin < FINS; ++fin) core_start(m->p[fin], m->c[fin], &s->core[fin]);
    s->sag = 0.0;
    s->instant = 1;
}

/* What acts on a fin, but for the sag, of its actuator's inputs and the mixing commands. But for `carried`, linear. */
static void multi_fin_acting(const multi_fin *m, size_t fin, const double *in, const double *mixing,
                             const double *carried, core_inputs *out)
{
    core_inputs_of(in, carried, out);
#if FINS > 1
    kernel_mixed_command(m->p[fin], m->c[fin], in[INPUT_FIN_COMMAND], mixing[0], mixing[1], mixing[2],
                         &out->command);
#else
    (void)m, (void)fin, (void)mixing;
#endif
}

static double bus_voltage(const multi_fin *m, double source, double sag)
{
    double voltage = source;
#if MULTI_FIN_BUS
    kernel_bus_voltage(m->p[0], m->c[0], source, sag, &voltage);
#else
    (void)m, (void)sag;
#endif
    return voltage;
}

/* Voltage, current and power of the bus, of the fins' outputs behind them. */
static void bus(const multi_fin *m, double source, double sag, double *out)
{
#if MULTI_FIN_BUS
    out[0] = bus_voltage(m, source, sag);
    out[2] = 0.0;
    for (size_t fin = 0; fin < FINS; ++fin) out[2] += out[BUS_OUTPUTS + fin * MODEL_OUTPUTS + MODEL_SUPPLY_POWER];
    kernel_bus_current(m->p[0], m->c[0], out[2], out[0], &out[1]);
#else
    (void)m, (void)source, (void)sag, (void)out;
#endif
}

static void multi_fin_outputs(const multi_fin *m, const multi_fin_state *s, const core_inputs *in, double *out)
{
    for (size_t fin = 0; fin < FINS; ++fin) {
        const core_schedule plan = core_scheduled(m->p[fin], m->c[fin]);
        core_inputs acting = in[fin];
        acting.supply = bus_voltage(m, acting.supply, s->sag);
        core_outputs(m->p[fin], m->c[fin], &s->core[fin], &plan, &acting,
                     out + BUS_OUTPUTS + fin * MODEL_OUTPUTS);
    }
    bus(m, in->supply, s->sag, out);
}

#if FINS == 1

/* Move on to `end` [s] after the start, all or nothing. The outputs there go to `out`. A core does that by itself,
 * and copies no more of its delay line than is in use. */
static core_result multi_fin_run(const multi_fin *m, multi_fin_state *state, double from, double end,
                                 const core_inputs *in, const core_ramp *ramp, double *out)
{
    (void)from;
    return core_run(m->p[0], m->c[0], state->core, end, in, ramp, out);
}

#else

static double source_at(const core_inputs *in, const core_ramp *ramp, double time)
{
    return in->supply + (ramp ? ramp->supply * (time - ramp->begin) : 0.0);
}

/* All fins to `until`. The sag comes off the ramp of the supply; where that would leave nothing at either end
 * the bus's least voltage is held. */
static core_result run_fins(const multi_fin *m, multi_fin_state *s, double from, double until, const core_inputs *in,
                            const core_ramp *ramp, double *out)
{
    const double sag = s->sag;
    for (size_t fin = 0; fin < FINS; ++fin) {
        core_inputs acting = in[fin];
        core_ramp rising;
        acting.supply = bus_voltage(m, acting.supply, sag);
        if (ramp) {
            const double first = source_at(&in[fin], &ramp[fin], from), last = source_at(&in[fin], &ramp[fin], until);
            rising = ramp[fin];
            acting.supply = in[fin].supply - sag;
            if (bus_voltage(m, first, sag) > first - sag || bus_voltage(m, last, sag) > last - sag) {
                acting.supply = bus_voltage(m, 0.5 * (first + last), sag);
                rising.supply = 0.0;
            }
        }
        const core_result result = core_run(m->p[fin], m->c[fin], &s->core[fin], until, &acting,
                                            ramp ? &rising : NULL, out + BUS_OUTPUTS + fin * MODEL_OUTPUTS);
        if (result != CORE_DONE) return result;
    }
    return CORE_DONE;
}

#if MULTI_FIN_BUS
static double next_sag(const multi_fin *m, double sag, double drawn)
{
    double inductances = 0.0, next;
    for (size_t fin = 0; fin < FINS; ++fin) {
        double inverse;
        kernel_inverse_inductance(m->p[fin], m->c[fin], m->interval, &inverse);
        inductances += inverse;
    }
    kernel_bus_sag(m->p[0], m->c[0], m->resistance, sag, drawn, m->interval, inductances, &next);
    return next;
}
#endif

/* Move on from `from` to `end` [s] after the start, all or nothing. The outputs there go to `out`. */
static core_result multi_fin_run(const multi_fin *m, multi_fin_state *state, double from, double end,
                                 const core_inputs *in, const core_ramp *ramp, double *out)
{
    multi_fin_state s = *state;
    double outputs[MULTI_FIN_OUTPUTS];
#if MULTI_FIN_BUS
    const bool stiff = !(m->resistance > 0.0);
    if (!stiff && !(end / m->interval - (double)s.instant <= CORE_MOST_TICKS)) return CORE_TOO_MANY_TICKS;
    /* A host's clock may stand a little before an instant it means to have reached. */
    for (double next; !stiff && (next = (double)s.instant * m->interval) <= end + m->slack; ++s.instant) {
        const double until = next < end ? next : end;
        const core_result reached = run_fins(m, &s, from, until, in, ramp, outputs);
        if (reached != CORE_DONE) return reached;
        bus(m, source_at(in, ramp, until), s.sag, outputs);
        s.sag = next_sag(m, s.sag, outputs[1]);
        if (!core_finite(s.sag)) return CORE_NOT_FINITE;
        from = until;
    }
#endif
    const core_result result = run_fins(m, &s, from, end, in, ramp, outputs);
    if (result != CORE_DONE) return result;
    bus(m, source_at(in, ramp, end), s.sag, outputs);
    *state = s;
    memcpy(out, outputs, sizeof outputs);
    return CORE_DONE;
}

#endif

#endif
