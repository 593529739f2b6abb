/* A host for the FMU: `host LIBRARY RESOURCES COMMAND [NUMBER]`. Prints lines `name=value`, which the test judges. */
#define _GNU_SOURCE /* feenableexcept */
#include <fenv.h>

#include "fmu.h"
#ifdef __GLIBC__
#include <malloc.h>
#endif
#include "misuse.h"
#include "states.h"

#define STEP 1e-3
enum { INSTANCES = 4, THREADS = 8, STEPS = 300 };

/* Triangular wave from -1 to 1 that begins at 0. One rounded division only: the same bits on every machine. */
static double triangle(long k, long period) {
    long phase = (4 * k) % (4 * period);
    if (phase >= 3 * period) return (double)(phase - 4 * period) / (double)period;
    if (phase >= period) return (double)(2 * period - phase) / (double)period;
    return (double)phase / (double)period;
}

/* Prints a step response under load as CSV: names, then time and outputs. */
static void plain(bool encoder) {
    Instance *i = started(encoder);
    printf("time");
    for (size_t k = 0; k < COUNT(REAL_OUTPUTS); k++) printf(",%s", REAL_OUTPUT_NAMES[k]);
    for (size_t k = 0; k < COUNT(BOOLEAN_OUTPUTS); k++) printf(",%s", BOOLEAN_OUTPUT_NAMES[k]);
    printf("\n");
    set_real(i, VR_fin_command, 0.2);
    for (int n = 0; n < STEPS; n++) {
        set_real(i, VR_aero_torque, n < 100 ? 0.0 : -40.0);
        step(i, n * STEP, STEP);
        Outputs o = outputs(i);
        printf("%.17g", (n + 1) * STEP);
        for (size_t k = 0; k < COUNT(o.real); k++) printf(",%.17g", o.real[k]);
        for (size_t k = 0; k < COUNT(o.flag); k++) printf(",%d", o.flag[k]);
        printf("\n");
    }
    finish(i);
}

static void nth_step(Instance *i, int which, int n) {
    set_real(i, VR_fin_command, n < STEPS / 2 ? 0.05 * (which + 1) : -0.03 * (which + 1));
    set_real(i, VR_aero_torque, -10.0 * which);
    step(i, n * STEP, STEP);
}

static void alone(int which, Outputs *into) {
    Instance *i = started(true);
    for (int n = 0; n < STEPS; n++) {
        nth_step(i, which, n);
        into[n] = outputs(i);
    }
    finish(i);
}

/* Compares instances that are stepped in turns with each instance alone. */
static void four(void) {
    static Outputs together[INSTANCES][STEPS], single[INSTANCES][STEPS];
    Instance *all[INSTANCES];
    int equal = 0, distinct = 0;
    for (int w = 0; w < INSTANCES; w++) all[w] = started(true);
    for (int n = 0; n < STEPS; n++)
        for (int w = 0; w < INSTANCES; w++) {
            nth_step(all[w], w, n);
            together[w][n] = outputs(all[w]);
        }
    for (int w = 0; w < INSTANCES; w++) {
        finish(all[w]);
        alone(w, single[w]);
        equal += same(together[w], single[w], STEPS);
        distinct += w == 0 || !same(&single[w][STEPS - 1], &single[w - 1][STEPS - 1], 1);
    }
    printf("equal=%d\ndistinct=%d\n", equal, distinct);
}

typedef struct {
    int which;
    Outputs found[STEPS];
} Job;

THREAD(work, argument) {
    Job *job = argument;
    alone(job->which, job->found);
    THREAD_END;
}

/* Compares instances that are created, run and freed in separate threads with the same in one thread. */
static void threads(void) {
    static Job jobs[THREADS];
    static Outputs single[STEPS];
    Thread running[THREADS];
    int equal = 0;
    for (int w = 0; w < THREADS; w++) jobs[w].which = w % INSTANCES;
    for (int w = 0; w < THREADS; w++) running[w] = start_thread(work, &jobs[w]);
    for (int w = 0; w < THREADS; w++) join(running[w]);
    for (int w = 0; w < THREADS; w++) {
        alone(jobs[w].which, single);
        equal += same(jobs[w].found, single, STEPS);
    }
    printf("equal=%d\n", equal);
}

static long heap(void) {
#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__)
    struct mallinfo2 info = mallinfo2();
    return (long)(info.uordblks + info.hblkhd);
#else
    return 0;
#endif
}

/* Periodic command and load for `count` steps; compares the last period of 6 s with an early one. */
static void moving(long count) {
    enum { PERIOD = 6000, EARLY = 50 };
    Instance *i = started(false);
    bool sound = true;
    long before = 0;
    double time = 0.0, reach = 0.0, lag = 0.0, repeat = 0.0;
    static double early[PERIOD];
    for (long n = 0; n < count; n++) {
        set_real(i, VR_fin_command, 0.3 * triangle(n, 500));
        set_real(i, VR_aero_torque, -80.0 * triangle(n, 750));
        step(i, (double)n * STEP, STEP);
        Outputs o = outputs(i);
        sound = sound && all_finite(&o);
        reach = fmax(reach, fabs(o.real[OUTPUT_fin_angle]));
        lag = fmax(lag, fabs(o.real[OUTPUT_tracking_error]));
        if (n / PERIOD == EARLY) early[n % PERIOD] = o.real[OUTPUT_fin_angle];
        if (n >= count - PERIOD) repeat = fmax(repeat, fabs(o.real[OUTPUT_fin_angle] - early[n % PERIOD]));
        if (n == 1000) before = heap();
    }
    long growth = heap() - before;
    check(i, fmu.GetRealStatus(i->component, fmi2LastSuccessfulTime, &time), "fmi2GetRealStatus");
    printf("time=%.17g\nfinite=%d\ngrowth=%ld\nreach=%.17g\nlag=%.17g\nrepeat=%.17g\n", time, sound, growth, reach,
           lag, repeat);
    finish(i);
}

typedef struct {
    const char *name;
    double command, torque, supply, acceleration;
    bool enable, encoder;
} Case;

/* Runs that reach every limit; a floating-point exception kills the process. */
static void traps(void) {
    static const Case cases[] = {
        {"step", 0.2, 0.0, 39.0, 0.0, true, true},
        {"beyond the limit", 1.0, 0.0, 39.0, 0.0, true, true},
        {"no encoder", -0.2, 50.0, 39.0, 0.0, true, false},
        {"back-driven", 0.3, -900.0, 39.0, 0.0, true, true},
        {"low supply", 0.3, -20.0, 6.0, 0.0, true, true},
        {"no supply", 0.3, 0.0, 0.0, 0.0, true, true},
        {"disabled, onto the stop", 0.1, 300.0, 39.0, 0.0, false, true},
        {"disabled, at rest", 0.1, 0.0, 39.0, 0.0, false, true},
        {"accelerated", -0.1, 0.0, 39.0, 300.0, true, true},
        {"huge", 1e30, 1e6, 1000.0, -1e4, true, true},
    };
#ifdef __GLIBC__
    if (feenableexcept(FE_INVALID | FE_DIVBYZERO | FE_OVERFLOW) == -1) fail("no traps");
#else
    fail("no traps here");
#endif
    for (size_t c = 0; c < COUNT(cases); c++) {
        const Case *x = &cases[c];
        int saturated = 0, stopped = 0, moved = 0;
        bool sound = true;
        fprintf(stderr, "%s\n", x->name); /* the last line names the case that trapped */
        Instance *i = started(x->encoder);
        set_real(i, VR_supply_voltage, x->supply);
        set_boolean(i, VR_enable, x->enable);
        for (int n = 0; n < 600; n++) {
            double sign = n < 400 ? 1.0 : -1.0;
            set_real(i, VR_fin_command, sign * x->command);
            set_real(i, VR_aero_torque, sign * x->torque);
            set_real(i, VR_acceleration_z, x->acceleration);
            set_real(i, VR_attitude_roll, 0.01 * n);
            step(i, n * STEP, STEP);
            Outputs o = outputs(i);
            sound = sound && all_finite(&o);
            saturated += o.flag[OUTPUT_saturated] != 0;
            stopped += o.flag[OUTPUT_at_stop] != 0;
            moved += o.real[OUTPUT_fin_rate] != 0.0;
        }
        finish(i);
        printf("%s=finite %d saturated %d at_stop %d moved %d\n", x->name, sound, saturated > 0, stopped > 0,
               moved > 0);
    }
    /* On request 0/0 proves that an exception kills the process. */
    if (getenv("HOST_PROVE_TRAP")) {
        volatile double zero = 0.0;
        printf("%g\n", zero / zero);
    }
}

int main(int argc, char **argv) {
    if (argc < 4) fail("usage: host LIBRARY RESOURCES COMMAND [NUMBER]");
    long number = argc > 4 ? strtol(argv[4], NULL, 10) : 0;
    const char *command = argv[3];
    load(argv[1]);
    resources = argv[2];
    if (!strcmp(command, "plain")) plain(number != 0);
    else if (!strcmp(command, "four")) four();
    else if (!strcmp(command, "threads")) threads();
    else if (!strcmp(command, "moving")) moving(number);
    else if (!strcmp(command, "traps")) traps();
    else if (!strcmp(command, "states")) states();
    else if (!strcmp(command, "misuse")) misuse();
    else fail("unknown command");
    return fflush(stdout) ? 5 : 0;
}
