/* Wrong calls, each on a new instance: prints `name=status messages`. The process must not crash. */
#ifndef MISUSE_H
#define MISUSE_H

#include "fmu.h"

enum Phase { INSTANTIATED, INITIALIZING, STEPPING, TERMINATED };

static Instance *in_phase(enum Phase phase) {
    Instance *i = new_instance("fin", UNIT_GUID);
    if (phase >= INITIALIZING) enter(i);
    if (phase >= STEPPING) leave(i);
    for (int n = 0; phase >= STEPPING && n < 5; n++) step(i, n * 1e-3, 1e-3);
    if (phase == TERMINATED) check(i, fmu.Terminate(i->component), "fmi2Terminate");
    i->messages = 0;
    return i;
}

/* Runs a call on a new instance in a phase, as `c`, and prints its status. */
#define TRY(name, phase, call) do { \
        Instance *i = in_phase(phase); \
        fmi2Component c = i->component; \
        int status = (call); \
        printf("%s=%d %d\n", name, status, i->messages); \
        free_instance(i); \
    } while (0)

static void instantiations(void) {
    static const struct { const char *what, *name, *guid; } cases[] = {
        {"no name", NULL, UNIT_GUID}, {"empty name", "", UNIT_GUID}, {"no guid", "fin", NULL},
        {"empty guid", "fin", ""}, {"wrong guid", "fin", "{00000000-0000-0000-0000-000000000000}"},
    };
    for (size_t k = 0; k < COUNT(cases); k++) {
        Instance *i = new_instance(cases[k].name, cases[k].guid);
        printf("%s=%d %d\n", cases[k].what, i->component != NULL, i->messages);
        if (i->component) fmu.FreeInstance(i->component);
        free(i);
    }
    Instance *i = new_instance("fin", UNIT_GUID);
    fmi2Component exchange = fmu.Instantiate("fin", fmi2ModelExchange, UNIT_GUID, resources, &i->callbacks, 0, 1);
    printf("model exchange=%d %d\n", exchange != NULL, i->messages);
    if (exchange) fmu.FreeInstance(exchange);
    fmi2Component bare = fmu.Instantiate("fin", fmi2CoSimulation, UNIT_GUID, resources, NULL, 0, 1);
    printf("no callbacks=%d 0\n", bare != NULL);
    if (bare) fmu.FreeInstance(bare);
    fmi2Component nowhere = fmu.Instantiate("fin", fmi2CoSimulation, UNIT_GUID, NULL, &i->callbacks, 0, 1);
    printf("no resources=%d 0\n", nowhere != NULL);
    if (nowhere) fmu.FreeInstance(nowhere);
    free_instance(i);
    fmu.FreeInstance(NULL);
}

static void nulls(void) {
    fmi2ValueReference reference = VR_fin_angle;
    double real = 0.0;
    size_t size;
    fmi2FMUstate state = NULL;
    printf("null doStep=%d 1\n", fmu.DoStep(NULL, 0.0, 1e-3, fmi2True));
#ifndef FMI3
    fmi2Status status;
    printf("null setup=%d 1\n", fmu.SetupExperiment(NULL, 0, 0.0, 0.0, 0, 0.0));
    printf("null status=%d 1\n", fmu.GetStatus(NULL, fmi2DoStepStatus, &status));
#endif
    printf("null enter=%d 1\n", fmu.EnterInitializationMode(NULL));
    printf("null leave=%d 1\n", fmu.ExitInitializationMode(NULL));
    printf("null terminate=%d 1\n", fmu.Terminate(NULL));
    printf("null reset=%d 1\n", fmu.Reset(NULL));
    printf("null get=%d 1\n", fmu.GetReal(NULL, &reference, 1, &real));
    printf("null set=%d 1\n", fmu.SetReal(NULL, &reference, 1, &real));
    printf("null save=%d 1\n", fmu.GetFMUstate(NULL, &state));
    printf("null logging=%d 1\n", fmu.SetDebugLogging(NULL, fmi2True, 0, NULL));
    TRY("nothing to get", STEPPING, fmu.GetReal(c, NULL, 0, NULL));
    TRY("nothing to set", STEPPING, fmu.SetReal(c, NULL, 0, NULL));
    TRY("no references", STEPPING, fmu.GetReal(c, NULL, 1, &real));
    TRY("no values", STEPPING, fmu.SetReal(c, &reference, 1, NULL));
    TRY("save to nowhere", STEPPING, fmu.GetFMUstate(c, NULL));
    TRY("no state to set", STEPPING, fmu.SetFMUstate(c, NULL));
    TRY("no state to size", STEPPING, fmu.SerializedFMUstateSize(c, NULL, &size));
    TRY("no bytes", STEPPING, fmu.DeSerializeFMUstate(c, NULL, 8, &state));
    TRY("free no state", STEPPING, fmu.FreeFMUstate(c, NULL));
    TRY("no categories", INSTANTIATED, fmu.SetDebugLogging(c, fmi2True, 0, NULL));
}

static void order(void) {
    TRY("step, instantiated", INSTANTIATED, fmu.DoStep(c, 0.0, 1e-3, fmi2True));
    TRY("step, initializing", INITIALIZING, fmu.DoStep(c, 0.0, 1e-3, fmi2True));
    TRY("step, terminated", TERMINATED, fmu.DoStep(c, 5e-3, 1e-3, fmi2True));
    TRY("leave, instantiated", INSTANTIATED, fmu.ExitInitializationMode(c));
    TRY("leave, stepping", STEPPING, fmu.ExitInitializationMode(c));
    TRY("enter, initializing", INITIALIZING, fmu.EnterInitializationMode(c));
    TRY("enter, stepping", STEPPING, fmu.EnterInitializationMode(c));
    TRY("terminate, instantiated", INSTANTIATED, fmu.Terminate(c));
    TRY("terminate, terminated", TERMINATED, fmu.Terminate(c));
#ifndef FMI3
    TRY("setup, stepping", STEPPING, fmu.SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0));
    TRY("cancel", STEPPING, fmu.CancelStep(c));
#endif
    TRY("reset, instantiated", INSTANTIATED, fmu.Reset(c));
    TRY("reset, initializing", INITIALIZING, fmu.Reset(c));
    TRY("reset, stepping", STEPPING, fmu.Reset(c));
    TRY("reset, terminated", TERMINATED, fmu.Reset(c));
}

static fmi2Status get_real(fmi2Component c, fmi2ValueReference reference) {
    double value;
    return fmu.GetReal(c, &reference, 1, &value);
}

static fmi2Status put_real(fmi2Component c, fmi2ValueReference reference, double value) {
    return fmu.SetReal(c, &reference, 1, &value);
}

static fmi2Status get_integer(fmi2Component c, fmi2ValueReference reference) {
    fmi2Integer value;
    return fmu.GetInteger(c, &reference, 1, &value);
}

static fmi2Status get_string(fmi2Component c, fmi2ValueReference reference) {
    fmi2String value;
    return fmu.GetString(c, &reference, 1, &value);
}

static fmi2Status put_boolean(fmi2Component c, fmi2ValueReference reference, fmi2Boolean value) {
    return fmu.SetBoolean(c, &reference, 1, &value);
}

#ifndef FMI3
static fmi2Status slope(fmi2Component c, fmi2ValueReference reference, fmi2Integer order_, double value) {
    return fmu.SetRealInputDerivatives(c, &reference, 1, &order_, &value);
}
#endif

/* Sets an input and steps; returns the worse status. */
static fmi2Status step_with(fmi2Component c, fmi2ValueReference reference, double value) {
    fmi2Status set = put_real(c, reference, value), stepped = fmu.DoStep(c, 5e-3, 1e-3, fmi2True);
    return set > stepped ? set : stepped;
}

static void variables(void) {
    TRY("get output, terminated", TERMINATED, get_real(c, VR_fin_angle));
    TRY("get unknown", STEPPING, get_real(c, 1000000u));
    TRY("get last", STEPPING, get_real(c, 4294967295u));
    TRY("get wrong type", STEPPING, get_integer(c, VR_fin_angle));
    TRY("get string", STEPPING, get_string(c, VR_fin_angle));
    TRY("set unknown", STEPPING, put_real(c, 1000000u, 1.0));
    TRY("set wrong type", STEPPING, put_boolean(c, VR_fin_command, 1));
    TRY("set output", STEPPING, put_real(c, VR_fin_angle, 1.0));
    TRY("set fixed", STEPPING, put_real(c, VR_motor_resistance, 1.0));
    TRY("set tunable", STEPPING, put_real(c, VR_controller_position_kp, 50.0));
    TRY("set input, terminated", TERMINATED, put_real(c, VR_fin_command, 0.1));
#ifndef FMI3
    TRY("slope", STEPPING, slope(c, VR_fin_command, 1, 0.1));
    TRY("slope of an output", STEPPING, slope(c, VR_fin_angle, 1, 0.1));
    TRY("slope of order 0", STEPPING, slope(c, VR_fin_command, 0, 0.1));
    TRY("slope of order 9", STEPPING, slope(c, VR_fin_command, 9, 0.1));
    TRY("slope unknown", STEPPING, slope(c, 1000000u, 1, 0.1));
#endif
    TRY("bad parameter", INITIALIZING,
        put_real(c, VR_motor_resistance, -1.0) > fmi2Warning ? fmi2Error : fmu.ExitInitializationMode(c));
    TRY("nan parameter", INITIALIZING,
        put_real(c, VR_motor_resistance, NAN) > fmi2Warning ? fmi2Error : fmu.ExitInitializationMode(c));
}

static void steps(void) {
    TRY("nan command", STEPPING, step_with(c, VR_fin_command, NAN));
    TRY("infinite torque", STEPPING, step_with(c, VR_aero_torque, INFINITY));
    TRY("nan attitude", STEPPING, step_with(c, VR_attitude_roll, NAN));
    TRY("nan supply", STEPPING, step_with(c, VR_supply_voltage, NAN));
    TRY("huge command", STEPPING, step_with(c, VR_fin_command, 1e300));
    TRY("step back", STEPPING, fmu.DoStep(c, 5e-3, -1e-3, fmi2True));
    TRY("step of nothing", STEPPING, fmu.DoStep(c, 5e-3, 0.0, fmi2True));
    TRY("step of nan", STEPPING, fmu.DoStep(c, 5e-3, NAN, fmi2True));
    TRY("step without end", STEPPING, fmu.DoStep(c, 5e-3, INFINITY, fmi2True));
    TRY("step from nan", STEPPING, fmu.DoStep(c, NAN, 1e-3, fmi2True));
    TRY("step from the past", STEPPING, fmu.DoStep(c, 1e-3, 1e-3, fmi2True));
    TRY("step from the future", STEPPING, fmu.DoStep(c, 1.0, 1e-3, fmi2True));
}

static void misuse(void) {
#ifndef FMI3
    printf("types=%s\n", fmu.GetTypesPlatform());
#endif
    printf("version=%s\n", fmu.GetVersion());
    instantiations();
    nulls();
    order();
    variables();
    steps();
    /* Another instance still works after all wrong calls. */
    Instance *i = in_phase(STEPPING);
    set_real(i, VR_fin_command, 0.1);
    for (int n = 5; n < 300; n++) step(i, n * 1e-3, 1e-3);
    printf("angle=%.17g\n", outputs(i).real[OUTPUT_fin_angle]);
    finish(i);
}

#endif
