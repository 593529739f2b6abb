/* The calls of FMI 3.0 for fuzz.c. */
enum { REFERENCES = ARRAYS, INPUT_REFERENCES = FMU_INPUTS / FINS, MOST_VALUES = 96 };

#define EXIT_INITIALIZATION fmi3ExitInitializationMode
#define TERMINATE fmi3Terminate
#define RESET fmi3Reset
#define FREE_INSTANCE fmi3FreeInstance
#define GET_STATE fmi3GetFMUState
#define SET_STATE fmi3SetFMUState
#define FREE_STATE fmi3FreeFMUState
#define SERIALIZE fmi3SerializeFMUState
#define DESERIALIZE fmi3DeserializeFMUState
#define SET_LOGGING fmi3SetDebugLogging

static void logger(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String message)
{
    (void)environment, (void)status;
    if (!category || !message || strlen(message) >= MESSAGE) abort();
}

/* Two thirds with event mode, half of these with early return. */
static instance *make(const char *name, const char *token, int logging, int kind)
{
    if (kind == 7) return fmi3InstantiateModelExchange(name, token, NULL, 0, logging, NULL, logger);
    return fmi3InstantiateCoSimulation(name, token, NULL, 0, logging, kind >= 85, kind >= 170, NULL, 0, NULL, logger,
                                       NULL);
}

static void begin(instance *m, double start)
{
    fmi3EnterInitializationMode(m, 0, 0.0, start, 0, 0.0);
}

static void after_initialization(instance *m)
{
    fmi3EnterStepMode(m);
}

static int do_step(instance *m, double time, double size)
{
    bool event, end, early;
    double reached;
    if (m->s.phase == HANDLING_EVENT) fmi3EnterStepMode(m);
    const int status = fmi3DoStep(m, time, size, 1, &event, &end, &early, &reached);
    if (status == FMI(OK) && (!core_finite(reached) || end || (early && !m->early_return))) abort();
    return status;
}

/* The number of the variables' elements, or sometimes a wrong number. */
static size_t elements(const uint32_t *vr, size_t n, uint8_t any)
{
    size_t count = any % 5;
    if (any < 40) return count;
    count = 0;
    for (size_t i = 0; i < n; ++i) count += vr[i] < ARRAYS ? ARRAY[vr[i]].size * ARRAY[vr[i]].fins : 1;
    return count < MOST_VALUES ? count : MOST_VALUES;
}

#define DEFINE_CALLS(kinds, Kind, type)                                                                  \
    static void set_##kinds(instance *m, const uint32_t *vr, size_t n, const type *given, uint8_t any)    \
    {                                                                                                    \
        fmi3##Kind values[MOST_VALUES];                                                                  \
        for (size_t i = 0; i < MOST_VALUES; ++i) values[i] = (fmi3##Kind)given[i];                       \
        fmi3Set##Kind(m, vr, n, values, elements(vr, n, any));                                           \
    }                                                                                                    \
    static void get_##kinds(instance *m, const uint32_t *vr, size_t n, type *values, uint8_t any)         \
    {                                                                                                    \
        fmi3##Kind here[MOST_VALUES];                                                                    \
        (void)values;                                                                                    \
        fmi3Get##Kind(m, vr, n, here, elements(vr, n, any));                                             \
    }

DEFINE_CALLS(reals, Float64, double)
DEFINE_CALLS(integers, Int32, int32_t)
DEFINE_CALLS(booleans, Boolean, int32_t)

/* Only in FMI 3.0: event mode and the clock. */
static void special(bytes *b, instance *m, uint32_t *vr, size_t n)
{
    bool flags[5], clocks[3] = {byte(b) < 200, byte(b) < 200, byte(b) < 200};
    double interval[3], next;
    fmi3IntervalQualifier qualifiers[3];
    for (size_t i = 0; i < n; ++i)
        if (byte(b) < 230) vr[i] = ARRAYS - 1; /* the clock */
    switch (byte(b) % 6) {
    case 0: fmi3EnterEventMode(m); break;
    case 1: fmi3EnterStepMode(m); break;
    case 2: fmi3SetClock(m, vr, n, clocks); break;
    case 3: fmi3GetClock(m, vr, n, clocks); break;
    case 4: fmi3UpdateDiscreteStates(m, &flags[0], &flags[1], &flags[2], &flags[3], &flags[4], &next); break;
    default:
        fmi3GetIntervalDecimal(m, vr, n, interval, qualifiers);
        fmi3GetShiftDecimal(m, vr, n, interval);
    }
}

static void rest(bytes *b, instance *m, const uint32_t *vr, size_t n)
{
    double reals[3] = {0.0};
    uint32_t words[3] = {byte(b), 0, 0};
    int64_t longs[3] = {byte(b), 0, 0};
    fmi3SetUInt32(m, vr, n, words, n);
    fmi3GetUInt32(m, vr, n, words, n);
    fmi3SetInt64(m, vr, n, longs, n);
    fmi3GetInt64(m, vr, n, longs, n);
    fmi3GetDirectionalDerivative(m, vr, n, vr, n, reals, n, reals, n);
    fmi3GetOutputDerivatives(m, vr, n, NULL, reals, n);
    fmi3EvaluateDiscreteStates(m);
    fmi3SetTime(m, 0.0);
    fmi3GetString(m, vr, n, NULL, n);
    fmi3SetBinary(m, vr, n, NULL, NULL, n);
    fmi3SetFloat64(m, NULL, n, NULL, n);
    fmi3GetBoolean(m, vr, n, NULL, n);
    fmi3DoStep(m, 0.0, 1e-3, 1, NULL, NULL, NULL, NULL);
}
