/* Several fins in one unit: their places in the interface, mixed commands, and the bus they share.
 *
 * On a stiff bus each fin runs as it would alone. With a source resistance the fins stop together at the
 * instants of the bus, k times bus.update_time, where the sag follows their current; it is held in between.
 */
#ifndef EMCAS_MULTI_FIN_H
#define EMCAS_MULTI_FIN_H

static const double *inputs_of(const double *values, size_t fin, double *room)
{
    for (size_t i = 0; i < MODEL_INPUTS; ++i) room[i] = values[PLACE[fin][i]];
    return room;
}

/* What acts on a fin, but for the sag. The forces apart, linear in `values`. */
static core_inputs acting(const instance *m, size_t fin, const double *values, const double *force)
{
    double room[MODEL_INPUTS], command;
    const double *in = inputs_of(values, fin, room);
    kernel_mixed_command(parameters(m, fin), m->fin[fin].constants, in[INPUT_FIN_COMMAND],
                         values[UNIT_ROLL_COMMAND], values[UNIT_PITCH_COMMAND], values[UNIT_YAW_COMMAND], &command);
    return core_inputs_of(command, in, force);
}

#if MODEL_SUPPLY >= 0

static double bus_resistance(const model_state *s)
{
    return s->values[UNIT_BUS_SOURCE_RESISTANCE];
}

static double bus_interval(const model_state *s)
{
    return s->values[UNIT_BUS_UPDATE_TIME];
}

static double bus_voltage(const instance *m, double source, double sag)
{
    double found;
    kernel_bus_voltage(parameters(m, 0), m->fin[0].constants, source, sag, &found);
    return found;
}

/* Current and, where asked for, power of all fins whose outputs these are. */
static double bus_current(const instance *m, const double *out, double voltage, double *power)
{
    double sum = 0.0, found;
    for (size_t fin = 0; fin < FINS; ++fin) sum += out[fin * MODEL_OUTPUTS + OUTPUT_SUPPLY_POWER];
    kernel_bus_current(parameters(m, 0), m->fin[0].constants, sum, voltage, &found);
    if (power) *power = sum;
    return found;
}

static double next_sag(const instance *m, double sag, double current)
{
    double inductances = 0.0, found;
    for (size_t fin = 0; fin < FINS; ++fin) {
        double inverse;
        kernel_inverse_inductance(parameters(m, fin), m->fin[fin].constants, &inverse);
        inductances += inverse;
    }
    kernel_bus_sag(parameters(m, 0), m->fin[0].constants, bus_resistance(&m->s), sag, current, bus_interval(&m->s),
                   inductances, &found);
    return found;
}

static void put_out_bus(instance *m, double source, double sag, const double *out)
{
    double *values = m->s.values;
    values[UNIT_BUS_VOLTAGE] = bus_voltage(m, source, sag);
    values[UNIT_BUS_CURRENT] = bus_current(m, out, values[UNIT_BUS_VOLTAGE], &values[UNIT_SUPPLY_POWER]);
}

#else /* Fins without a supply: a stiff bus that nothing draws from. */

static double bus_resistance(const model_state *s)
{
    (void)s;
    return 0.0;
}

static double bus_interval(const model_state *s)
{
    (void)s;
    return 1.0;
}

static double bus_voltage(const instance *m, double source, double sag)
{
    (void)m;
    return source - sag;
}

static double bus_current(const instance *m, const double *out, double voltage, double *power)
{
    (void)m, (void)out, (void)voltage, (void)power;
    return 0.0;
}

static double next_sag(const instance *m, double sag, double current)
{
    (void)m, (void)current;
    return sag;
}

static void put_out_bus(instance *m, double source, double sag, const double *out)
{
    (void)m, (void)source, (void)sag, (void)out;
}

#endif

static void start_bus(instance *m)
{
    m->s.sag = 0.0;
    m->s.instant = 1;
}

static void put_out(instance *m, double source, double sag, const double *out)
{
    memcpy(m->s.values + FIN_OUTPUT_BEGIN, out, FINS * MODEL_OUTPUTS * sizeof *out);
    put_out_bus(m, source, sag, out);
}

static void find_outputs(instance *m, const core_inputs *in)
{
    double out[FINS * MODEL_OUTPUTS];
    for (size_t fin = 0; fin < FINS; ++fin) {
        core_inputs acting = in[fin];
        acting.supply = bus_voltage(m, acting.supply, m->s.sag);
        fin_outputs(m, fin, &m->s.core[fin], &acting, out + fin * MODEL_OUTPUTS);
    }
    put_out(m, in->supply, m->s.sag, out);
}

static double source_at(const core_inputs *in, const core_ramp *ramp, double time)
{
    return in->supply + (ramp ? ramp->supply * (time - ramp->begin) : 0.0);
}

/* All fins to `until`. The sag comes off the ramp of the supply; where that would leave nothing at either end
 * the bus's least voltage is held. */
static core_result run_fins(instance *m, core_state *core, double from, double until, const core_inputs *in,
                            const core_ramp *ramp, double sag, double *out)
{
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
        const core_result result = core_run(parameters(m, fin), m->fin[fin].constants, &core[fin], until, &acting,
                                            ramp ? &rising : NULL, out + fin * MODEL_OUTPUTS);
        if (result != CORE_DONE) return result;
    }
    return CORE_DONE;
}

/* The whole unit to `end`, all or nothing. */
static core_result unit_run(instance *m, double end, const core_inputs *in, const core_ramp *ramp)
{
    const bool stiff = !(bus_resistance(&m->s) > 0.0);
    const double interval = bus_interval(&m->s);
    core_state core[FINS];
    double out[FINS * MODEL_OUTPUTS], sag = m->s.sag;
    int64_t instant = m->s.instant;
    if (!stiff && !(end / interval - (double)instant <= CORE_MOST_TICKS)) return CORE_TOO_MANY_TICKS;
    memcpy(core, m->s.core, sizeof core);
    for (double from = m->s.now;;) {
        const double next = (double)instant * interval;
        /* A host's clock may stand a little before an instant it means to have reached. */
        const bool meets = !stiff && next <= end + m->slack;
        const double until = meets && next < end ? next : end;
        const core_result result = run_fins(m, core, from, until, in, ramp, sag, out);
        if (result != CORE_DONE) return result;
        if (!meets) break;
        sag = next_sag(m, sag, bus_current(m, out, bus_voltage(m, source_at(in, ramp, until), sag), NULL));
        if (!core_finite(sag)) return CORE_NOT_FINITE;
        ++instant;
        from = until;
    }
    memcpy(m->s.core, core, sizeof core);
    m->s.sag = sag;
    m->s.instant = instant;
    put_out(m, source_at(in, ramp, end), sag, out);
    return CORE_DONE;
}

static const char *unsound_bus(const model_state *s)
{
    const double stood = (double)s->instant * bus_interval(s) - s->now;
    const bool stiff = bus_resistance(s) == 0.0;
    if (!core_finite(s->sag)) return "sag of the bus";
    /* The next instant of a bus that is not stiff lies ahead, within an interval. */
    if (s->instant < 1 || (!stiff && (stood < 0.0 || stood > bus_interval(s) * (1.0 + 1e-9) + 1e-9)))
        return "place in time of the bus";
    return NULL;
}

#endif
