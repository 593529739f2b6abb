/* Calls the native FMU's functions with random values and random bytes of states.
 *
 * After every call the state must be finite, and no sanitizer may report an error. The FMU's source (unit.c) is
 * included, so that its state can be read; calls.h is calls2.h or calls3.h. Built for libFuzzer, or with -DSTANDALONE
 * as a program that generates its own bytes: fuzz SECONDS SEED.
 */
#include "unit.c"

#include <time.h>

enum { UNITS = 3, STATES = 4, LONGEST_RUN = 400 };

typedef struct {
    const uint8_t *at, *end;
} bytes;

static uint8_t byte(bytes *b)
{
    return b->at < b->end ? *b->at++ : 0;
}

static void fill(bytes *b, void *target, size_t size)
{
    uint8_t *out = target;
    for (size_t i = 0; i < size; ++i) out[i] = byte(b);
}

/* Mostly a usual number, sometimes any bits. */
static double number(bytes *b)
{
    static const double odd[] = {0.0, -0.0, 1.0, -1.0, 1e-300, 1e300, -1e300, 4.9e-324, HUGE_VAL, -HUGE_VAL, NAN,
                                 1e-6, 1e6, 1e15, -1e-9, 0.5};
    const uint8_t kind = byte(b);
    double any;
    if (kind < 160) {
        const int16_t small = (int16_t)(byte(b) | byte(b) << 8);
        return small / 32768.0 * (kind < 80 ? 1.0 : kind < 120 ? 100.0 : 1e-3);
    }
    if (kind < 230) return odd[kind % (sizeof odd / sizeof *odd)];
    fill(b, &any, sizeof any);
    return any;
}

/* A value for a variable: often within its limits. */
static double value_for(bytes *b, size_t vr)
{
    if (vr >= FMU_VARIABLES || byte(b) < 90) return number(b);
    const variable *v = &VARIABLE[vr];
    const double share = byte(b) / 255.0;
    if (!core_finite(v->minimum) || !core_finite(v->maximum)) return number(b);
    return share < 0.5 ? START[vr] * (1.0 + share) : v->minimum + (v->maximum - v->minimum) * (2.0 * share - 1.0);
}

/* Sizes of steps that keep a run short, and nonsense. */
static double step_size(bytes *b)
{
    static const double usual[] = {1e-3, 1e-4, 3.7e-4, 2.5e-3, 7e-3, 1e-6};
    const uint8_t kind = byte(b);
    if (kind < 200) return usual[kind % (sizeof usual / sizeof *usual)];
    const double any = number(b);
    return core_finite(any) && any > 0.05 && any < 1e5 ? 0.05 : any;
}

#include "calls.h"

/* Whether ticks are so short that a run would take too long. */
static int runs_long(const instance *m)
{
    multi_fin bound;
    multi_fin_bind(&bound, m->s.values + PARAMETER_BEGIN, parameters(m, 0));
    for (size_t fin = 0; fin < FINS; ++fin) {
        const core_schedule plan = core_scheduled(bound.p[fin], bound.c[fin]);
        if (plan.h_before < 2e-5 || plan.h_after < 2e-5) return 1;
    }
    return 0;
}

static void check(const instance *m)
{
    if (!m || m->s.phase != RUNNING) return;
    for (size_t fin = 0; fin < FINS; ++fin) {
        const core_state *core = &m->s.fins.core[fin];
        if (!core_all_finite(core->plant.x, CORE_PLANT) || !core_all_finite(core->tentative.x, CORE_PLANT)
            || !core_all_finite(core->sampled, CORE_SAMPLED) || !core_finite(core->active) || !core_finite(m->s.now))
            abort();
    }
}

static void damaged_state(bytes *b, instance *m, void **state)
{
    static uint8_t data[sizeof(state_head) + sizeof(model_state) + 8];
    size_t size = sizeof(state_head) + sizeof(model_state);
    if (SERIALIZE(m, *state, data, size) != FMI(OK)) return;
    for (int changes = byte(b) % 6; changes > 0; --changes) {
        const size_t at = (byte(b) | byte(b) << 8) % size;
        if (byte(b) < 128) {
            data[at] = byte(b);
        } else { /* one of the state's doubles */
            const double any = number(b);
            memcpy(data + sizeof(state_head) + at % sizeof(model_state) / 8 * 8, &any, sizeof any);
        }
    }
    if (byte(b) < 200) { /* with a correct checksum, so that the FMU checks the content */
        const uint64_t right = checksum(data + sizeof(state_head), sizeof(model_state));
        memcpy(data + offsetof(state_head, check), &right, sizeof right);
    }
    if (byte(b) < 20) size -= byte(b) % 9;
    void *made = NULL;
    if (DESERIALIZE(m, data, size, &made) == FMI(OK)) {
        SET_STATE(m, made);
        check(m);
    }
    FREE_STATE(m, &made);
}

static void started(instance *m)
{
    begin(m, 0.0);
    EXIT_INITIALIZATION(m);
    after_initialization(m);
}

static void call(bytes *b, instance **unit, void **state)
{
    const unsigned k = byte(b) % UNITS, s = byte(b) % STATES;
    instance *m = unit[k];
    const uint8_t which = byte(b) % 40;
    uint32_t vr[3];
    double reals[MOST_VALUES] = {0.0};
    int32_t integers[MOST_VALUES] = {0};
    size_t n = byte(b) % 4;
    for (size_t i = 0; i < 3; ++i) {
        vr[i] = (FINS > 1 ? byte(b) | byte(b) << 8 : byte(b)) % (REFERENCES + 4);
        if (byte(b) == 7) fill(b, &vr[i], sizeof vr[i]);
    }
    switch (which) {
    case 0:
        if (m) FREE_INSTANCE(m);
        unit[k] = byte(b) < 30 ? NULL
                               : make(byte(b) < 10 ? "" : "fin", byte(b) < 10 ? "nonsense" : MODEL_GUID, byte(b) < 128,
                                      byte(b));
        return;
    case 1: begin(m, number(b)); break;
    case 2: begin(m, 0.0); break;
    case 3: EXIT_INITIALIZATION(m); break;
    case 4: TERMINATE(m); break;
    case 5: RESET(m); break;
    case 6: case 7: started(m); break;
    case 8: case 9: case 10: case 11: case 12: case 13:
        for (size_t i = 0; i < n; ++i)
            if (byte(b) < 150) vr[i] %= INPUT_REFERENCES;
        for (size_t i = 0; i < MOST_VALUES; ++i) reals[i] = b->at < b->end ? value_for(b, vr[i % 3]) : 0.0;
        set_reals(m, vr, n, reals, byte(b));
        break;
    case 14: case 15: case 16: get_reals(m, vr, n, reals, byte(b)); break;
    case 17:
        for (size_t i = 0; i < n; ++i) integers[i] = (int32_t)(byte(b) | (uint32_t)byte(b) << 24);
        set_integers(m, vr, n, integers, byte(b));
        break;
    case 18: get_integers(m, vr, n, integers, byte(b)); break;
    case 19:
        for (size_t i = 0; i < n; ++i) integers[i] = byte(b) - 1;
        if (byte(b) < 150) vr[0] = INPUT_ENABLE;
        set_booleans(m, vr, n, integers, byte(b));
        break;
    case 20: get_booleans(m, vr, n, integers, byte(b)); break;
    case 21: case 22: special(b, m, vr, n); break;
    case 23: GET_STATE(m, &state[s]); break;
    case 24: if (state[s]) SET_STATE(m, state[s]); break;
    case 25: if (m) FREE_STATE(m, &state[s]); break;
    case 26: case 27: if (state[s]) damaged_state(b, m, &state[s]); break;
    case 28: {
        const char *categories[] = {"logStatusError", "logAll", "nonsense", NULL};
        const char *const chosen[] = {categories[byte(b) % 4], categories[byte(b) % 4]};
        SET_LOGGING(m, byte(b) < 128, byte(b) % 3, chosen);
        break;
    }
    case 29: rest(b, m, vr, n); break;
    default:
        if (m && m->s.phase == RUNNING && runs_long(m)) break;
        for (int i = 1 + byte(b) % 8; m && i > 0; --i) {
            const double now = m->s.start + m->s.now;
            if (do_step(m, byte(b) < 245 ? now : number(b), step_size(b)) == FMI(OK)) {
                double out[FMU_OUTPUTS];
                memcpy(out, m->s.values + OUTPUT_BEGIN, sizeof out);
                for (size_t j = 0; j < FMU_OUTPUTS; ++j)
                    if (!core_finite(out[j])) abort();
            }
        }
    }
    check(m);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    bytes b = {data, data + size};
    instance *unit[UNITS] = {0};
    void *state[STATES] = {0};
    for (int k = 0; k < UNITS; ++k) unit[k] = make("fin", MODEL_GUID, 1, k * 90);
    started(unit[0]);
    for (int i = 0; i < LONGEST_RUN && b.at < b.end; ++i) call(&b, unit, state);
    instance *keeper = make("fin", MODEL_GUID, 0, 0);
    for (int s = 0; s < STATES; ++s) FREE_STATE(keeper, &state[s]);
    FREE_INSTANCE(keeper);
    for (int k = 0; k < UNITS; ++k) FREE_INSTANCE(unit[k]);
    return 0;
}

#ifdef STANDALONE
int main(int count, char **arguments)
{
    const double seconds = count > 1 ? atof(arguments[1]) : 5.0;
    uint64_t x = count > 2 ? strtoull(arguments[2], NULL, 10) : 1;
    const clock_t begin = clock();
    unsigned long runs = 0, length = 0;
    uint8_t data[2000];
    for (; (double)(clock() - begin) / CLOCKS_PER_SEC < seconds; ++runs) {
        /* xorshift64* (Vigna 2016): the same bytes for the same seed. */
        const size_t size = 200 + runs * 37 % 1800;
        for (size_t i = 0; i < size; ++i) {
            x ^= x >> 12;
            x ^= x << 25;
            x ^= x >> 27;
            data[i] = (uint8_t)(x * UINT64_C(2685821657736338717) >> 56);
        }
        LLVMFuzzerTestOneInput(data, size);
        length += size;
    }
    printf("%lu runs of %lu bytes\n", runs, length);
    return 0;
}
#endif
