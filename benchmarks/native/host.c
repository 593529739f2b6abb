/* What FMUs cost a C simulation: times FMI 2.0 libraries in turn, round after round, in one process.
 *
 *     host ROUNDS STEPS INSTANCES (GUID RESOURCES LIBRARY)...
 *
 * A step sets two inputs, steps 1 ms and reads six outputs; the fin never rests (2 Hz at 10 deg against a load that
 * follows it). First, for each library, in nanoseconds of CPU: loading it with its first instance, a further instance
 * ready to step, then bytes that instance took from the host. Then each round's nanoseconds per step, one column for
 * each library and a last one for calls that do nothing, the host's own share.
 */
#define _POSIX_C_SOURCE 200809L
#include "fmi2.h"
#include "parameters.h"

#include <dlfcn.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define STEP 1e-3
#define ROWS 500  /* of one period of the signals */
#define MOST 8

typedef struct {
    fmi2Component (*instantiate)(fmi2String, fmi2Type, fmi2String, fmi2String, const fmi2CallbackFunctions *,
                                 fmi2Boolean, fmi2Boolean);
    fmi2Status (*setup)(fmi2Component, fmi2Boolean, fmi2Real, fmi2Real, fmi2Boolean, fmi2Real);
    fmi2Status (*enter)(fmi2Component);
    fmi2Status (*leave)(fmi2Component);
    fmi2Status (*terminate)(fmi2Component);
    void (*release)(fmi2Component);
    fmi2Status (*set)(fmi2Component, const fmi2ValueReference *, size_t, const fmi2Real *);
    fmi2Status (*step)(fmi2Component, fmi2Real, fmi2Real, fmi2Boolean);
    fmi2Status (*get)(fmi2Component, const fmi2ValueReference *, size_t, fmi2Real *);
    const char *guid, *resources;
    fmi2Component instance;
    long long steps;
} Slave;

static const fmi2ValueReference INPUTS[] = {VR_fin_command, VR_aero_torque};
static const fmi2ValueReference OUTPUTS[] = {VR_fin_angle, VR_fin_rate, VR_motor_current, VR_motor_voltage,
                                             VR_hinge_torque, VR_supply_power};
static double signals[ROWS][2];
static size_t allocated;

static void fail(const char *what) {
    fprintf(stderr, "host: %s\n", what);
    exit(1);
}

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

static void *allocate(size_t count, size_t size) {
    allocated += count * size;
    return calloc(count, size);
}

static void quiet(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String category,
                  fmi2String message, ...) {
    (void)e, (void)category;
    if (status > fmi2Warning)
        fprintf(stderr, "host: %s: %s\n", name, message);
}

static const fmi2CallbackFunctions CALLBACKS = {quiet, allocate, free, NULL, NULL};

static void find(void *library, const char *name, void *target) {
    void *symbol = dlsym(library, name);
    if (!symbol)
        fail(dlerror());
    memcpy(target, &symbol, sizeof symbol);
}

static void load(Slave *s, const char *path) {
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!library)
        fail(dlerror());
    find(library, "fmi2Instantiate", &s->instantiate);
    find(library, "fmi2SetupExperiment", &s->setup);
    find(library, "fmi2EnterInitializationMode", &s->enter);
    find(library, "fmi2ExitInitializationMode", &s->leave);
    find(library, "fmi2Terminate", &s->terminate);
    find(library, "fmi2FreeInstance", &s->release);
    find(library, "fmi2SetReal", &s->set);
    find(library, "fmi2DoStep", &s->step);
    find(library, "fmi2GetReal", &s->get);
}

static fmi2Component ready(const Slave *s) {
    fmi2Component c = s->instantiate("actuator", fmi2CoSimulation, s->guid, s->resources, &CALLBACKS, 0, 0);
    if (!c)
        fail("fmi2Instantiate gave no instance");
    if (s->setup(c, 0, 0.0, 0.0, 0, 0.0) || s->enter(c) || s->leave(c))
        fail("initialization failed");
    return c;
}

static void start(Slave *s, const char *path, int instances) {
    double begin = now();
    load(s, path);
    s->instance = ready(s);
    double first = now() - begin;
    fmi2Component *all = calloc((size_t)instances, sizeof *all);
    allocated = 0;
    begin = now();
    for (int i = 0; i < instances; i++)
        all[i] = ready(s);
    double further = (now() - begin) / instances;
    printf("%.0f %.0f %zu\n", first, further, allocated / (size_t)instances);
    for (int i = 0; i < instances; i++) {
        s->terminate(all[i]);
        s->release(all[i]);
    }
    free(all);
}

static double run(Slave *s, int steps) {
    double outputs[6], begin = now();
    int bad = 0;
    for (int i = 0; i < steps; i++, s->steps++) {
        bad |= s->set(s->instance, INPUTS, 2, signals[s->steps % ROWS]);
        bad |= s->step(s->instance, (double)s->steps * STEP, STEP, 1);
        bad |= s->get(s->instance, OUTPUTS, 6, outputs);
    }
    double spent = (now() - begin) / steps;
    if (bad || !(fabs(outputs[0]) < 0.5))
        fail("a step failed");
    return spent;
}

static fmi2Status set_nothing(fmi2Component c, const fmi2ValueReference *r, size_t n, const fmi2Real *v) {
    return (void)c, (void)r, (void)n, (void)v, fmi2OK;
}
static fmi2Status do_nothing(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean kept) {
    return (void)c, (void)time, (void)step, (void)kept, fmi2OK;
}
static fmi2Status get_nothing(fmi2Component c, const fmi2ValueReference *r, size_t n, fmi2Real *v) {
    return (void)c, (void)r, (void)n, v[0] = 0.0, fmi2OK;
}

int main(int count, char **argument) {
    int slaves = (count - 4) / 3;
    if (count < 7 || (count - 4) % 3 || slaves >= MOST)
        fail("arguments: ROUNDS STEPS INSTANCES (GUID RESOURCES LIBRARY)...");
    int rounds = atoi(argument[1]), steps = atoi(argument[2]), instances = atoi(argument[3]);
    Slave slave[MOST] = {{0}};
    for (int i = 0; i < ROWS; i++) {
        double wave = sin(2.0 * 3.14159265358979323846 * i / ROWS);
        signals[i][0] = 10.0 * 3.14159265358979323846 / 180.0 * wave;
        signals[i][1] = -60.0 * wave;
    }
    for (int k = 0; k < slaves; k++) {
        char **own = argument + 4 + 3 * k;
        slave[k].guid = own[0];
        slave[k].resources = own[1];
        start(&slave[k], own[2], instances);
        run(&slave[k], 1000);
    }
    slave[slaves] = (Slave){.set = set_nothing, .step = do_nothing, .get = get_nothing};
    for (int round = 0; round < rounds; round++)
        for (int k = 0; k <= slaves; k++)
            printf("%.2f%c", run(&slave[k], steps), k < slaves ? ' ' : '\n');
    for (int k = 0; k < slaves; k++) {
        slave[k].terminate(slave[k].instance);
        slave[k].release(slave[k].instance);
    }
    return 0;
}
