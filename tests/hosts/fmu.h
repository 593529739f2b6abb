/* A co-simulation FMU, loaded or (-DSTATIC_FMU) linked, and its instances. C11, POSIX or Windows.
 *
 * In FMI 2.0, or with -DFMI3 in FMI 3.0 behind the same calls (fmu3.h). */
#ifndef FMU_H
#define FMU_H

#include <math.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"
#include "variables.h" /* of this FMU: written by the test from modelDescription.xml */

#ifdef _WIN32
#include <windows.h>
#else
#include <dlfcn.h>
#include <pthread.h>
#endif

#define COUNT(array) (sizeof(array) / sizeof(array)[0])

/* Every function a co-simulation FMU of FMI 2.0 has to export. */
#define FUNCTIONS(X) \
    X(GetTypesPlatform) X(GetVersion) X(SetDebugLogging) X(Instantiate) X(FreeInstance) X(SetupExperiment) \
    X(EnterInitializationMode) X(ExitInitializationMode) X(Terminate) X(Reset) X(GetReal) X(GetInteger) \
    X(GetBoolean) X(GetString) X(SetReal) X(SetInteger) X(SetBoolean) X(SetString) X(GetFMUstate) X(SetFMUstate) \
    X(FreeFMUstate) X(SerializedFMUstateSize) X(SerializeFMUstate) X(DeSerializeFMUstate) \
    X(GetDirectionalDerivative) X(SetRealInputDerivatives) X(GetRealOutputDerivatives) X(DoStep) X(CancelStep) \
    X(GetStatus) X(GetRealStatus) X(GetIntegerStatus) X(GetBooleanStatus) X(GetStringStatus)

static struct {
#define MEMBER(name) fmi2##name##TYPE *name;
    FUNCTIONS(MEMBER)
#undef MEMBER
} fmu;

static const char *resources;

static void fail(const char *what) {
    fprintf(stderr, "host: %s\n", what);
    exit(3);
}

#ifdef FMI3
#include "fmu3.h"
#else
#define PREFIX "fmi2"
#define VERSIONED(name) fmi2##name
#define LIBRARY fmu
#define LIBRARY_FUNCTIONS FUNCTIONS
#define bind_calls() (void)0
#endif

#ifdef STATIC_FMU
static void load(const char *library) {
    (void)library;
#define BIND(name) LIBRARY.name = VERSIONED(name);
    LIBRARY_FUNCTIONS(BIND)
#undef BIND
    bind_calls();
}
#else
static void load(const char *library) {
#ifdef _WIN32
    HMODULE handle = LoadLibraryA(library);
    if (!handle) fail("LoadLibrary failed");
#define FIND(name) FARPROC address = GetProcAddress(handle, PREFIX #name)
#else
    void *handle = dlopen(library, RTLD_NOW | RTLD_LOCAL);
    if (!handle) fail(dlerror());
#define FIND(name) void *address = dlsym(handle, PREFIX #name)
#endif
    /* Copied: ISO C has no conversion between pointers to objects and to functions. */
#define BIND(name) { FIND(name); if (!address) fail("no " PREFIX #name); memcpy(&LIBRARY.name, &address, sizeof address); }
    LIBRARY_FUNCTIONS(BIND)
#undef BIND
#undef FIND
    bind_calls();
}
#endif

typedef struct {
    fmi2CallbackFunctions callbacks;
    fmi2Component component;
    int messages; /* logged so far */
    char last[1024];
} Instance;

static void logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                   fmi2String message, ...) {
    Instance *instance = environment;
    va_list arguments;
    (void)name, (void)status, (void)category;
    va_start(arguments, message);
    vsnprintf(instance->last, sizeof instance->last, message, arguments);
    va_end(arguments);
    instance->messages++;
}

static Instance *new_instance(const char *name, const char *guid) {
    Instance *i = calloc(1, sizeof *i);
    /* The members of fmi2CallbackFunctions are const: filled by copying. */
    fmi2CallbackFunctions callbacks = {logger, calloc, free, NULL, i};
    if (!i) fail("no memory");
    memcpy(&i->callbacks, &callbacks, sizeof callbacks);
    i->component = fmu.Instantiate(name, fmi2CoSimulation, guid, resources, &i->callbacks, fmi2False, fmi2True);
    return i;
}

static void free_instance(Instance *i) {
    fmu.FreeInstance(i->component);
    free(i);
}

static void check(Instance *i, fmi2Status status, const char *what) {
    if (status != fmi2OK) {
        fprintf(stderr, "host: %s gave status %d: %s\n", what, status, i->last);
        exit(4);
    }
}

static void set_real(Instance *i, fmi2ValueReference reference, double value) {
    check(i, fmu.SetReal(i->component, &reference, 1, &value), "fmi2SetReal");
}

static void set_boolean(Instance *i, fmi2ValueReference reference, bool value) {
    fmi2Boolean number = value ? fmi2True : fmi2False;
    check(i, fmu.SetBoolean(i->component, &reference, 1, &number), "fmi2SetBoolean");
}

static void enter(Instance *i) {
    check(i, fmu.SetupExperiment(i->component, fmi2False, 0.0, 0.0, fmi2False, 0.0), "fmi2SetupExperiment");
    check(i, fmu.EnterInitializationMode(i->component), "fmi2EnterInitializationMode");
}

static void leave(Instance *i) {
    check(i, fmu.ExitInitializationMode(i->component), "fmi2ExitInitializationMode");
}

/* An initialized instance; without `encoder` the controllers use the true angle and speed. */
static Instance *started(bool encoder) {
    Instance *i = new_instance("fin", UNIT_GUID);
    if (!i->component) fail("fmi2Instantiate gave NULL");
    enter(i);
    set_boolean(i, VR_encoder_enabled, encoder);
    leave(i);
    return i;
}

static void finish(Instance *i) {
    check(i, fmu.Terminate(i->component), "fmi2Terminate");
    free_instance(i);
}

typedef struct {
    double real[COUNT(REAL_OUTPUTS)];
    fmi2Boolean flag[COUNT(BOOLEAN_OUTPUTS)];
} Outputs;

static Outputs outputs(Instance *i) {
    Outputs o;
    memset(&o, 0, sizeof o); /* padding too: compared with memcmp */
    check(i, fmu.GetReal(i->component, REAL_OUTPUTS, COUNT(REAL_OUTPUTS), o.real), "fmi2GetReal");
    check(i, fmu.GetBoolean(i->component, BOOLEAN_OUTPUTS, COUNT(BOOLEAN_OUTPUTS), o.flag), "fmi2GetBoolean");
    return o;
}

static bool same(const Outputs *a, const Outputs *b, size_t count) { return memcmp(a, b, count * sizeof *a) == 0; }

static bool all_finite(const Outputs *o) {
    for (size_t k = 0; k < COUNT(o->real); k++)
        if (!isfinite(o->real[k])) return false;
    return true;
}

static void step(Instance *i, double time, double size) {
    check(i, fmu.DoStep(i->component, time, size, fmi2True), "fmi2DoStep");
}

#ifdef _WIN32
typedef HANDLE Thread;
#define THREAD(name, argument) static DWORD WINAPI name(LPVOID argument)
#define THREAD_END return 0
static Thread start_thread(LPTHREAD_START_ROUTINE body, void *argument) {
    return CreateThread(NULL, 0, body, argument, 0, NULL);
}
static void join(Thread thread) { WaitForSingleObject(thread, INFINITE); CloseHandle(thread); }
#else
typedef pthread_t Thread;
#define THREAD(name, argument) static void *name(void *argument)
#define THREAD_END return NULL
static Thread start_thread(void *(*body)(void *), void *argument) {
    pthread_t thread;
    if (pthread_create(&thread, NULL, body, argument)) fail("no thread");
    return thread;
}
static void join(Thread thread) { pthread_join(thread, NULL); }
#endif

#endif
