/* A thousand steps of an FMU that may make no system call:
 * `sealed LIBRARY TOKEN VALUES COMMAND TORQUE ANGLE ACTION`. COMMAND and TORQUE are inputs, ANGLE an output of VALUES
 * fins each: comma-separated value references. Prints allocations, events and the largest angle [urad]. ACTION is a
 * forbidden action of the host in each step, which must be detected: `call`, `allocate` or `none`. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <math.h>
#include <linux/seccomp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

#ifdef FMI3
#include "fmi3Functions.h"
#define VERSIONED(name) fmi3##name
#define TYPE(name) fmi3##name##TYPE
#define PREFIX "fmi3"
#define FUNCTIONS(X) X(InstantiateCoSimulation) X(EnterInitializationMode) X(ExitInitializationMode) X(EnterEventMode) \
    X(UpdateDiscreteStates) X(EnterStepMode) X(SetFloat64) X(GetFloat64) X(DoStep)
typedef fmi3Instance component;
#else
#include "fmi2Functions.h"
#define TYPE(name) fmi2##name##TYPE
#define PREFIX "fmi2"
#define FUNCTIONS(X) X(Instantiate) X(SetupExperiment) X(EnterInitializationMode) X(ExitInitializationMode) \
    X(SetReal) X(GetReal) X(DoStep)
typedef fmi2Component component;
#endif

enum { MOST = 8 };
typedef struct {
    unsigned reference[MOST];
    size_t count;
} references;

static struct {
#define MEMBER(name) TYPE(name) *name;
    FUNCTIONS(MEMBER)
} fmu;

static unsigned long allocations, events;

extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t count, size_t size);
extern void *__libc_realloc(void *block, size_t size);

void *malloc(size_t size) { return allocations++, __libc_malloc(size); }
void *calloc(size_t count, size_t size) { return allocations++, __libc_calloc(count, size); }
void *realloc(void *block, size_t size) { return allocations++, __libc_realloc(block, size); }

static void need(int good, const char *what) {
    if (good) return;
    fprintf(stderr, "sealed: %s\n", what);
    exit(3);
}

static references listed(char *text) {
    references found = {{0}, 0};
    for (char *one = strtok(text, ","); one && found.count < MOST; one = strtok(NULL, ","))
        found.reference[found.count++] = (unsigned)strtoul(one, NULL, 10);
    return found;
}

#ifdef FMI3
static component ready(const char *token) {
    component c = fmu.InstantiateCoSimulation("fin", token, NULL, 0, 0, 1, 1, NULL, 0, NULL, NULL, NULL);
    fmi3Boolean more = 0, end = 0, nominals = 0, values = 0, next = 0;
    fmi3Float64 time = 0.0;
    need(c && !fmu.EnterInitializationMode(c, 0, 0.0, 0.0, 0, 0.0) && !fmu.ExitInitializationMode(c)
         && !fmu.UpdateDiscreteStates(c, &more, &end, &nominals, &values, &next, &time) && !fmu.EnterStepMode(c),
         "no instance");
    return c;
}

static int set(component c, const references *of, const double *value, size_t values) {
    return fmu.SetFloat64(c, of->reference, of->count, value, values);
}

static int get(component c, const references *of, double *value, size_t values) {
    return fmu.GetFloat64(c, of->reference, of->count, value, values);
}

/* Steps to the end of a step through its events. */
static int moved(component c, double time, double size) {
    const double end = time + size;
    int status = 0;
    do {
        fmi3Boolean event = 0, stop = 0, early = 0, more = 0, nominals = 0, changed = 0, next = 0;
        fmi3Float64 reached = time, ahead = 0.0;
        status |= fmu.DoStep(c, time, end - time, 1, &event, &stop, &early, &reached);
        time = reached;
        if (!event) continue;
        events++;
        status |= fmu.EnterEventMode(c);
        status |= fmu.UpdateDiscreteStates(c, &more, &stop, &nominals, &changed, &next, &ahead);
        status |= fmu.EnterStepMode(c);
    } while (!status && time < end - 1e-9);
    return status;
}
#else
static void silent(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String category, fmi2String text,
                   ...) {
    (void)e, (void)name, (void)status, (void)category, (void)text;
}

static component ready(const char *token) {
    static const fmi2CallbackFunctions callbacks = {silent, calloc, free, NULL, NULL};
    component c = fmu.Instantiate("fin", fmi2CoSimulation, token, "", &callbacks, 0, 0);
    need(c && !fmu.SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0) && !fmu.EnterInitializationMode(c)
         && !fmu.ExitInitializationMode(c), "no instance");
    return c;
}

static int set(component c, const references *of, const double *value, size_t values) {
    (void)values;
    return fmu.SetReal(c, of->reference, of->count, value);
}

static int get(component c, const references *of, double *value, size_t values) {
    (void)values;
    return fmu.GetReal(c, of->reference, of->count, value);
}

static int moved(component c, double time, double size) {
    return fmu.DoStep(c, time, size, 1);
}
#endif

int main(int count, char **argument) {
    need(count == 8, "arguments: LIBRARY TOKEN VALUES COMMAND TORQUE ANGLE ACTION");
    void *library = dlopen(argument[1], RTLD_NOW | RTLD_LOCAL);
    need(library != NULL, "the library does not load");
#define FIND(name) { void *address = dlsym(library, PREFIX #name); need(address != NULL, #name); \
                     memcpy(&fmu.name, &address, sizeof address); }
    FUNCTIONS(FIND)
    const size_t values = strtoul(argument[3], NULL, 10);
    const references command = listed(argument[4]), torque = listed(argument[5]), angle = listed(argument[6]);
    const int calls = !strcmp(argument[7], "call"), allocates = !strcmp(argument[7], "allocate");
    need(values > 0 && values <= MOST, "number of values");
    component c = ready(argument[2]);
    double in[MOST], out[MOST], largest = 0.0, time = 0.0;
    int bad = 0;
    void *volatile block = NULL;
    need(!prctl(PR_SET_SECCOMP, SECCOMP_MODE_STRICT), "no strict mode");
    /* From here on any system call except read, write and exit kills the process. */
    allocations = 0;
    for (int n = 0; n < 1000; n++) {
        /* Reversals that reach the limits of voltage and current, and at the end a stop; in steps of 1 and 0.3 ms. */
        const double size = n % 3 ? 1e-3 : 3e-4;
        for (size_t fin = 0; fin < values; fin++) in[fin] = (n / 90) % 2 ? -0.1 : 0.1;
        bad |= set(c, &command, in, values);
        for (size_t fin = 0; fin < values; fin++) in[fin] = n < 900 ? 0.0 : 1e3;
        bad |= set(c, &torque, in, values);
        bad |= moved(c, time, size);
        time += size;
        bad |= get(c, &angle, out, values);
        for (size_t fin = 0; fin < values; fin++) largest = fmax(largest, fabs(out[fin]));
        if (calls) bad |= getppid() < 0;
        if (allocates) block = malloc(1);
    }
    (void)block;
    char text[128];
    const int length = snprintf(text, sizeof text, "allocations=%lu\nevents=%lu\nlargest=%ld\nbad=%d\n", allocations,
                                events, (long)(1e6 * largest), bad);
    const int wrong = write(1, text, (size_t)length) != length;
    syscall(SYS_exit, wrong); /* ends the thread; exit() would make a forbidden call */
    return 1;
}
