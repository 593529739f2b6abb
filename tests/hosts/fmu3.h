/* The host's calls of FMI 2.0 implemented with FMI 3.0, without event mode and without arrays. */
#ifndef FMU3_H
#define FMU3_H

#ifdef __clang__ /* the standard's header has functions without prototypes */
#pragma clang diagnostic ignored "-Wstrict-prototypes"
#endif
#include "fmi3Functions.h"

#define PREFIX "fmi3"
#define VERSIONED(name) fmi3##name
#define LIBRARY library3

#define LIBRARY_FUNCTIONS(X) \
    X(GetVersion) X(SetDebugLogging) X(InstantiateModelExchange) X(InstantiateCoSimulation) X(FreeInstance) \
    X(EnterInitializationMode) X(ExitInitializationMode) X(Terminate) X(Reset) X(GetFloat64) X(GetInt32) X(GetBoolean) \
    X(GetString) X(SetFloat64) X(SetInt32) X(SetBoolean) X(GetFMUState) X(SetFMUState) X(FreeFMUState) \
    X(SerializedFMUStateSize) X(SerializeFMUState) X(DeserializeFMUState) X(DoStep)

static struct {
#define MEMBER(name) fmi3##name##TYPE *name;
    LIBRARY_FUNCTIONS(MEMBER)
#undef MEMBER
} library3;

/* The environment is the host's structure for an instance, which begins with the callbacks of FMI 2.0. */
static void logger3(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String message) {
    const fmi2CallbackFunctions *callbacks = environment;
    callbacks->logger(callbacks->componentEnvironment, "", (fmi2Status)status, category, "%s", message);
}

static fmi2Component instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resource_path,
                                 const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    fmi3LogMessageCallback log = callbacks ? logger3 : NULL;
    fmi3InstanceEnvironment environment = NULL;
    memcpy(&environment, &callbacks, sizeof environment); /* removes const; the FMU only passes the pointer back */
    return type == fmi2CoSimulation
        ? LIBRARY.InstantiateCoSimulation(name, guid, resource_path, visible, logging, 0, 0, NULL, 0, environment, log,
                                          NULL)
        : LIBRARY.InstantiateModelExchange(name, guid, resource_path, visible, logging, environment, log);
}

static fmi2Status set_up(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                         fmi2Boolean stop_defined, fmi2Real stop) {
    (void)c, (void)tolerance_defined, (void)tolerance, (void)start, (void)stop_defined, (void)stop;
    return fmi2OK;
}

static fmi2Status enter_initialization(fmi2Component c) {
    return (fmi2Status)LIBRARY.EnterInitializationMode(c, 0, 0.0, 0.0, 0, 0.0);
}

static fmi2Status get_reals(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    return (fmi2Status)LIBRARY.GetFloat64(c, vr, n, value, n);
}

static fmi2Status set_reals(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    return (fmi2Status)LIBRARY.SetFloat64(c, vr, n, value, n);
}

static fmi2Status get_integers(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[]) {
    return (fmi2Status)LIBRARY.GetInt32(c, vr, n, value, n);
}

static fmi2Status get_strings(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[]) {
    return (fmi2Status)LIBRARY.GetString(c, vr, n, value, n);
}

enum { MOST_FLAGS = 16 };

static fmi2Status get_booleans(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[]) {
    fmi3Boolean flags[MOST_FLAGS] = {0};
    if (n > MOST_FLAGS) fail("too many flags");
    const fmi3Status status = LIBRARY.GetBoolean(c, vr, n, flags, n);
    for (size_t k = 0; k < n; k++) value[k] = flags[k];
    return (fmi2Status)status;
}

static fmi2Status set_booleans(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[]) {
    fmi3Boolean flags[MOST_FLAGS] = {0};
    if (n > MOST_FLAGS) fail("too many flags");
    for (size_t k = 0; k < n; k++) flags[k] = value[k] != 0;
    return (fmi2Status)LIBRARY.SetBoolean(c, vr, n, flags, n);
}

static fmi2Status do_step(fmi2Component c, fmi2Real time, fmi2Real size, fmi2Boolean no_set_state) {
    fmi3Boolean event = 0, end = 0, early = 0;
    fmi3Float64 reached = 0.0;
    const fmi3Status status = LIBRARY.DoStep(c, time, size, no_set_state, &event, &end, &early, &reached);
    if (event || early) fail("an event in an instance without event mode");
    return (fmi2Status)status;
}

static fmi2Status real_status(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    const fmi2ValueReference time = VR_time;
    return kind == fmi2LastSuccessfulTime ? get_reals(c, &time, 1, value) : fmi2Discard;
}

#define SAME(name, name3, parameters, arguments) \
    static fmi2Status same_##name parameters { return (fmi2Status)LIBRARY.name3 arguments; }
SAME(logging, SetDebugLogging, (fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]),
     (c, on, n, categories))
SAME(exit, ExitInitializationMode, (fmi2Component c), (c))
SAME(terminate, Terminate, (fmi2Component c), (c))
SAME(reset, Reset, (fmi2Component c), (c))
SAME(get_state, GetFMUState, (fmi2Component c, fmi2FMUstate *state), (c, state))
SAME(set_state, SetFMUState, (fmi2Component c, fmi2FMUstate state), (c, state))
SAME(free_state, FreeFMUState, (fmi2Component c, fmi2FMUstate *state), (c, state))
SAME(size, SerializedFMUStateSize, (fmi2Component c, fmi2FMUstate state, size_t *size), (c, state, size))
SAME(serialize, SerializeFMUState, (fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size),
     (c, state, (fmi3Byte *)bytes, size))
SAME(deserialize, DeserializeFMUState, (fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state),
     (c, (const fmi3Byte *)bytes, size, state))

static void bind_calls(void) {
    fmu.GetVersion = LIBRARY.GetVersion;
    fmu.Instantiate = instantiate;
    fmu.FreeInstance = LIBRARY.FreeInstance;
    fmu.SetDebugLogging = same_logging;
    fmu.SetupExperiment = set_up;
    fmu.EnterInitializationMode = enter_initialization;
    fmu.ExitInitializationMode = same_exit;
    fmu.Terminate = same_terminate;
    fmu.Reset = same_reset;
    fmu.GetReal = get_reals;
    fmu.SetReal = set_reals;
    fmu.GetInteger = get_integers;
    fmu.GetString = get_strings;
    fmu.GetBoolean = get_booleans;
    fmu.SetBoolean = set_booleans;
    fmu.GetFMUstate = same_get_state;
    fmu.SetFMUstate = same_set_state;
    fmu.FreeFMUstate = same_free_state;
    fmu.SerializedFMUstateSize = same_size;
    fmu.SerializeFMUstate = same_serialize;
    fmu.DeSerializeFMUstate = same_deserialize;
    fmu.DoStep = do_step;
    fmu.GetRealStatus = real_status;
}

#endif
