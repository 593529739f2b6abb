/* The same actuator as the author of a 6-DOF simulation would write it by hand: the measure of the FMU's speed.
 *
 * An FMI 2.0 co-simulation slave in one file, parameters compiled in, outputs computed only when asked for. Ticks of
 * 0.1 ms, in each of which current, rate and angle take one semi-implicit Euler step; dry friction by the rule that a
 * speed which would change sign is zero and that a fin at rest stays there until the moment exceeds the limit.
 *
 * parameters.h holds parameters (P_...) and value references (VR_...) out of the shipped parameter set. With
 * -DWITHOUT_COS the reduction ratio follows from the tangent, which saves the cosine of equation (2.6); -DPERIOD=1000
 * makes ticks of 1 us, to see what the ticks cost in accuracy and that nothing else does.
 */
#include "fmi2.h"
#include "parameters.h"

#include <math.h>
#include <string.h>

#ifndef PERIOD
#define PERIOD 10 /* ticks from sample to sample */
#endif
#define H (P_controller_sample_time / PERIOD)
#define ARRIVAL (7 * PERIOD / 10) /* ticks into a period when the sample of 3 periods before gets to the drive: 3.7 ms */
#define LINE 5 /* samples: in the drive before and after the arrival, and on their way */
#define SPAN (20.0 * 3.14159265358979323846 / 180.0)

static const double RATIO = P_kinematics_moment_arm / P_screw_lead;
static const double TURNING = P_inertia_motor + P_inertia_screw + P_mass_nut * P_screw_lead * P_screw_lead;
static const double SWINGING = P_inertia_fin + P_inertia_shaft + P_inertia_fork;
static const double COUNT = 2.0 * 3.14159265358979323846 / (P_encoder_pulses * P_encoder_multiplier);

typedef struct {
    double angle, rate, current, xi;           /* of the plant: fin angle and rate, motor current, drive integral */
    double integral, speed_integral, counts, measured; /* of the controllers */
    double line[LINE], reference, i_ref;       /* DAC values by age; the one in the drive, and its current */
    double in[VR_supply_voltage + 1];          /* real inputs */
    double tan_0, of_coulomb, of_viscous;      /* constants: a library call, friction over that at 24 degC */
    double f_x, f_z, spin, coning, about_screw, about_hinge, start;
    long long tick;
    int phase, enable, limited, loaded;
    void (*release)(void *);
} Actuator;

static double clip(double x, double limit) {
    return x < -limit ? -limit : x > limit ? limit : x;
}

static double coulomb(double fin, int positive) {
    static const double up[] = P_friction_coulomb_positive, down[] = P_friction_coulomb_negative;
    const double *c = positive ? up : down, z = fin * (1.0 / SPAN);
    double value = ((((((c[6] * z + c[5]) * z + c[4]) * z + c[3]) * z + c[2]) * z + c[1]) * z + c[0]);
    return value > 0.0 ? value : 0.0;
}

static double motor_angle(const Actuator *a, double fin) {
    return RATIO * (tan(fin + P_kinematics_initial_angle) - a->tan_0);
}

static double ratio(const Actuator *a) {
    double c = cos(a->angle + P_kinematics_initial_angle);
    return RATIO / (c * c);
}

/* Equations 2.27-2.45, and the vehicle's rotation. */
static void forces(Actuator *a) {
    const double *in = a->in, g = P_loads_gravity ? 9.80665 : 0.0, at = P_mounting_station;
    const double *w = in + VR_angular_rate_x, *turning = in + VR_angular_acceleration_x;
    double pitch = in[VR_attitude_pitch], roll = in[VR_attitude_roll];
    double y = g * sin(roll) * cos(pitch) - in[VR_acceleration_y] - at * (turning[2] + w[0] * w[1]);
    double z = g * cos(roll) * cos(pitch) - in[VR_acceleration_z] - at * (w[0] * w[2] - turning[1]);
    double across = cos(P_mounting_azimuth) * w[2] - sin(P_mounting_azimuth) * w[1];
    a->f_x = -g * sin(pitch) - in[VR_acceleration_x] + at * (w[1] * w[1] + w[2] * w[2]);
    a->f_z = cos(P_mounting_azimuth) * z - sin(P_mounting_azimuth) * y;
    a->spin = w[0] * w[0] - across * across;
    a->coning = w[0] * across;
    a->about_screw = turning[0];
    a->about_hinge = cos(P_mounting_azimuth) * turning[1] + sin(P_mounting_azimuth) * turning[2];
    a->loaded = a->f_x != 0.0 || a->f_z != 0.0 || a->spin != 0.0 || a->coning != 0.0 || a->about_screw != 0.0
             || a->about_hinge != 0.0;
}

static double body_moment(const Actuator *a) {
    double x = P_mass_fin * P_center_of_mass_fin_x + P_mass_shaft * P_center_of_mass_shaft_x
             + P_mass_fork * P_center_of_mass_fork_x;
    double z = P_mass_fin * P_center_of_mass_fin_z + P_mass_shaft * P_center_of_mass_shaft_z
             + P_mass_fork * P_center_of_mass_fork_z;
    double c = cos(a->angle), s = sin(a->angle);
    return (z * c - x * s) * a->f_x - (x * c + z * s) * a->f_z
         + SWINGING * (a->spin * s * c + a->coning * (c * c - s * s) - a->about_hinge);
}

/* What nut and rotor add about the hinge. */
static double screw_moment(const Actuator *a, double r) {
    return r * (P_screw_lead * P_mass_nut * a->f_x - (P_inertia_motor + P_inertia_screw) * a->about_screw);
}

static double hinge_moment(const Actuator *a) {
    return a->in[VR_aero_torque] + (a->loaded ? body_moment(a) : 0.0);
}

/* The integral that asks for no speed at a measured motor angle. */
static double resting(double motor) {
    return P_controller_position_kp * (1.0 - P_controller_position_setpoint_weight) * motor;
}

/* Section 4.2, the encoder on the motor's shaft. */
static double sample(Actuator *a) {
    double motor = motor_angle(a, a->angle), speed;
    if (P_encoder_enabled) {
        double counts = floor(motor / COUNT);
        speed = (counts - a->counts) * COUNT / P_controller_sample_time;
        motor = counts * COUNT;
        a->counts = counts;
        a->measured = atan(motor / RATIO + a->tan_0) - P_kinematics_initial_angle;
    } else {
        speed = ratio(a) * a->rate;
        a->measured = a->angle;
    }
    if (!a->enable) {
        a->integral = resting(motor);
        a->speed_integral = 0.0;
        a->limited = 0;
        return 0.0;
    }
    double command = clip(a->in[VR_fin_command], P_command_limit);
    double target = motor_angle(a, command);
    double raw = P_controller_position_kp * (P_controller_position_setpoint_weight * target - motor) + a->integral;
    double wanted = clip(raw, P_controller_speed_limit);
    double feed = P_compensation_gain / (P_motor_torque_constant * P_drive_current_gain)
                * coulomb(a->measured, wanted > 0.0) * clip(wanted / P_compensation_speed_band, 1.0);
    double u = P_controller_velocity_kp * (wanted - speed) + a->speed_integral + feed;
    double held = clip(u, P_drive_reference_limit);
    double current = clip(P_drive_current_gain * held + P_drive_current_offset, P_drive_current_limit);
    double beyond = (current - P_drive_current_offset) / P_drive_current_gain - u;
    a->integral += P_controller_sample_time
                 * (P_controller_position_ki * (target - motor) + P_controller_antiwindup * (wanted - raw)
                    + P_controller_drive_antiwindup / P_controller_velocity_kp * beyond);
    double tracking = fmin(P_controller_drive_antiwindup, P_controller_velocity_ki / P_controller_velocity_kp);
    a->speed_integral += P_controller_sample_time
                       * (P_controller_velocity_ki * (wanted - speed) + tracking * beyond);
    a->limited = command != a->in[VR_fin_command] || wanted != raw || held != u;
    return held;
}

static double demand(const Actuator *a) {
    return P_drive_kp * (a->i_ref - a->current) + a->xi;
}

static void flow(Actuator *a, double speed) {
    double wanted = demand(a), voltage = clip(wanted, a->in[VR_supply_voltage]);
    if (voltage == wanted)
        a->xi += H * P_drive_ki * (a->i_ref - a->current);
    a->current += H / P_motor_inductance
                * (voltage - P_motor_resistance * a->current - P_motor_back_emf_constant * speed);
}

static void tick(Actuator *a) {
    double phi = a->angle + P_kinematics_initial_angle, t = tan(phi);
#ifdef WITHOUT_COS
    double r = RATIO * (1.0 + t * t);
#else
    double c = cos(phi), r = RATIO / (c * c);
#endif
    if (a->enable)
        flow(a, r * a->rate);
    double moment = r * P_motor_torque_constant * a->current + a->in[VR_aero_torque];
    if (a->loaded)
        moment += body_moment(a) + screw_moment(a, r);
    int positive = a->rate > 0.0 || (a->rate == 0.0 && moment > 0.0);
    double friction = r * a->of_coulomb * coulomb(a->angle, positive) + P_friction_fin_coulomb;
    if (a->rate == 0.0 && fabs(moment) <= friction)
        return;
    double viscous = a->of_viscous * (positive ? P_friction_viscous_positive : P_friction_viscous_negative);
    moment += (positive ? -friction : friction) - (r * r * viscous + P_friction_fin_viscous) * a->rate
            - TURNING * r * (2.0 * r * t) * a->rate * a->rate;
    double rate = a->rate + H * moment / (SWINGING + TURNING * r * r);
    if (positive ? rate < 0.0 : rate > 0.0)
        rate = 0.0;
    a->rate = rate;
    a->angle += H * rate;
    if (fabs(a->angle) >= P_fin_stop_angle) {
        a->angle = copysign(P_fin_stop_angle, a->angle);
        a->rate = 0.0;
    }
}

static void arrive(Actuator *a, double reference) {
    a->reference = reference;
    a->i_ref = clip(P_drive_current_gain * reference + P_drive_current_offset, P_drive_current_limit);
}

static double at_temperature(const double *ratio) {
    static const double at[] = P_friction_table_temperature;
    const int last = (int)(sizeof at / sizeof *at) - 1;
    int i = 0;
    while (i < last && P_friction_temperature > at[i + 1]) ++i;
    if (i == last || P_friction_temperature <= at[0]) return ratio[i];
    return ratio[i] + (ratio[i + 1] - ratio[i]) * (P_friction_temperature - at[i]) / (at[i + 1] - at[i]);
}

static void initialise(Actuator *a) {
    void (*release)(void *) = a->release;
    memset(a, 0, sizeof *a);
    a->release = release;
    a->tan_0 = tan(P_kinematics_initial_angle);
    a->of_coulomb = at_temperature((const double[])P_friction_table_coulomb);
    a->of_viscous = at_temperature((const double[])P_friction_table_viscous);
    a->in[VR_supply_voltage] = P_drive_supply_voltage;
    a->enable = 1;
    a->angle = P_fin_start_angle;
    a->counts = floor(motor_angle(a, a->angle) / COUNT);
    a->measured = atan(a->counts * COUNT / RATIO + a->tan_0) - P_kinematics_initial_angle;
    a->integral = resting(a->counts * COUNT);
    arrive(a, 0.0);
}

static double voltage(const Actuator *a) {
    return a->enable ? clip(demand(a), a->in[VR_supply_voltage])
                     : P_motor_back_emf_constant * ratio(a) * a->rate;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_set_state) {
    Actuator *a = c;
    (void)no_set_state;
    long long target = llround((time + step - a->start) / H);
    if (!a->enable)
        a->current = a->xi = 0.0;
    for (; a->tick < target; a->tick++) {
        if (a->phase == 0) {
            memmove(a->line, a->line + 1, sizeof a->line - sizeof *a->line);
            a->line[LINE - 1] = sample(a);
            arrive(a, a->line[0]);
        } else if (a->phase == ARRIVAL) {
            arrive(a, a->line[1]);
        }
        tick(a);
        if (++a->phase == PERIOD)
            a->phase = 0;
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real value[]) {
    Actuator *a = c;
    int body = 0;
    for (size_t i = 0; i < n; i++) {
        if (r[i] > VR_supply_voltage)
            return fmi2Error;
        a->in[r[i]] = value[i];
        body |= r[i] >= VR_acceleration_x && r[i] <= VR_angular_acceleration_z;
    }
    if (body)
        forces(a);
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real value[]) {
    const Actuator *a = c;
    for (size_t i = 0; i < n; i++) {
        switch (r[i]) {
        case VR_fin_angle: value[i] = a->angle; break;
        case VR_fin_rate: value[i] = a->rate; break;
        case VR_motor_angle: value[i] = motor_angle(a, a->angle); break;
        case VR_motor_speed: value[i] = ratio(a) * a->rate; break;
        case VR_motor_current: value[i] = a->current; break;
        case VR_motor_voltage: value[i] = voltage(a); break;
        case VR_motor_torque: value[i] = P_motor_torque_constant * a->current; break;
        case VR_drive_reference: value[i] = a->line[LINE - 1]; break;
        case VR_nut_position: value[i] = P_screw_lead * motor_angle(a, a->angle); break;
        case VR_hinge_torque: value[i] = hinge_moment(a); break;
        case VR_supply_power: value[i] = voltage(a) * a->current; break;
        case VR_tracking_error: value[i] = clip(a->in[VR_fin_command], P_command_limit) - a->angle; break;
        case VR_measured_fin_angle: value[i] = a->measured; break;
        case VR_current_error: value[i] = a->enable ? a->i_ref - a->current : 0.0; break;
        default:
            if (r[i] > VR_supply_voltage)
                return fmi2Error;
            value[i] = a->in[r[i]];
        }
    }
    return fmi2OK;
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Boolean value[]) {
    for (size_t i = 0; i < n; i++) {
        if (r[i] != VR_enable)
            return fmi2Error;
        ((Actuator *)c)->enable = value[i] != 0;
    }
    return fmi2OK;
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Boolean value[]) {
    const Actuator *a = c;
    for (size_t i = 0; i < n; i++) {
        switch (r[i]) {
        case VR_enable: value[i] = a->enable; break;
        case VR_saturated:
            value[i] = a->limited || (a->enable && (fabs(demand(a)) > a->in[VR_supply_voltage]
                || fabs(P_drive_current_gain * a->reference + P_drive_current_offset) > P_drive_current_limit));
            break;
        case VR_at_stop: value[i] = fabs(a->angle) >= P_fin_stop_angle; break;
        default: return fmi2Error;
        }
    }
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
    (void)name, (void)guid, (void)resources, (void)visible, (void)logging;
    Actuator *a = type == fmi2CoSimulation ? functions->allocateMemory(1, sizeof *a) : NULL;
    if (a) {
        a->release = functions->freeMemory;
        initialise(a);
    }
    return a;
}

void fmi2FreeInstance(fmi2Component c) {
    if (c)
        ((Actuator *)c)->release(c);
}

fmi2Status fmi2Reset(fmi2Component c) {
    initialise(c);
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop) {
    (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop;
    ((Actuator *)c)->start = start;
    return fmi2OK;
}

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { (void)c; return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { (void)c; return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component c) { (void)c; return fmi2OK; }

/* What this slave has nothing to offer for; loaders want the symbols. */
#define NONE(name, ...) fmi2Status name(__VA_ARGS__); fmi2Status name(__VA_ARGS__)
typedef const fmi2ValueReference *References;

NONE(fmi2SetDebugLogging, fmi2Component c, fmi2Boolean on, size_t n, const fmi2String *s) {
    return (void)c, (void)on, (void)n, (void)s, fmi2OK;
}
NONE(fmi2CancelStep, fmi2Component c) { return (void)c, fmi2Error; }
NONE(fmi2GetInteger, fmi2Component c, References r, size_t n, fmi2Integer *v) {
    return (void)c, (void)r, (void)v, n ? fmi2Error : fmi2OK;
}
NONE(fmi2SetInteger, fmi2Component c, References r, size_t n, const fmi2Integer *v) {
    return (void)c, (void)r, (void)v, n ? fmi2Error : fmi2OK;
}
NONE(fmi2GetString, fmi2Component c, References r, size_t n, fmi2String *v) {
    return (void)c, (void)r, (void)v, n ? fmi2Error : fmi2OK;
}
NONE(fmi2SetString, fmi2Component c, References r, size_t n, const fmi2String *v) {
    return (void)c, (void)r, (void)v, n ? fmi2Error : fmi2OK;
}
NONE(fmi2GetFMUstate, fmi2Component c, fmi2FMUstate *s) { return (void)c, (void)s, fmi2Error; }
NONE(fmi2SetFMUstate, fmi2Component c, fmi2FMUstate s) { return (void)c, (void)s, fmi2Error; }
NONE(fmi2FreeFMUstate, fmi2Component c, fmi2FMUstate *s) { return (void)c, (void)s, fmi2Error; }
NONE(fmi2SerializedFMUstateSize, fmi2Component c, fmi2FMUstate s, size_t *n) {
    return (void)c, (void)s, (void)n, fmi2Error;
}
NONE(fmi2SerializeFMUstate, fmi2Component c, fmi2FMUstate s, fmi2Byte *b, size_t n) {
    return (void)c, (void)s, (void)b, (void)n, fmi2Error;
}
NONE(fmi2DeSerializeFMUstate, fmi2Component c, const fmi2Byte *b, size_t n, fmi2FMUstate *s) {
    return (void)c, (void)b, (void)n, (void)s, fmi2Error;
}
NONE(fmi2GetDirectionalDerivative, fmi2Component c, References u, size_t n, References k, size_t m,
     const fmi2Real *dk, fmi2Real *du) {
    return (void)c, (void)u, (void)n, (void)k, (void)m, (void)dk, (void)du, fmi2Error;
}
NONE(fmi2SetRealInputDerivatives, fmi2Component c, References r, size_t n, const fmi2Integer *o, const fmi2Real *v) {
    return (void)c, (void)r, (void)n, (void)o, (void)v, fmi2Error;
}
NONE(fmi2GetRealOutputDerivatives, fmi2Component c, References r, size_t n, const fmi2Integer *o, fmi2Real *v) {
    return (void)c, (void)r, (void)n, (void)o, (void)v, fmi2Error;
}
NONE(fmi2GetStatus, fmi2Component c, fmi2StatusKind k, fmi2Status *v) { return (void)c, (void)k, (void)v, fmi2Discard; }
NONE(fmi2GetRealStatus, fmi2Component c, fmi2StatusKind k, fmi2Real *v) {
    return (void)c, (void)k, (void)v, fmi2Discard;
}
NONE(fmi2GetIntegerStatus, fmi2Component c, fmi2StatusKind k, fmi2Integer *v) {
    return (void)c, (void)k, (void)v, fmi2Discard;
}
NONE(fmi2GetBooleanStatus, fmi2Component c, fmi2StatusKind k, fmi2Boolean *v) {
    return (void)c, (void)k, (void)v, fmi2Discard;
}
NONE(fmi2GetStringStatus, fmi2Component c, fmi2StatusKind k, fmi2String *v) {
    return (void)c, (void)k, (void)v, fmi2Discard;
}
