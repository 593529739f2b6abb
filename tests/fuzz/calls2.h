/* The calls of FMI 2.0 for fuzz.c. */
enum { REFERENCES = FMU_VARIABLES, INPUT_REFERENCES = FMU_INPUTS, MOST_VALUES = 3 };

#define EXIT_INITIALIZATION fmi2ExitInitializationMode
#define TERMINATE fmi2Terminate
#define RESET fmi2Reset
#define FREE_INSTANCE fmi2FreeInstance
#define GET_STATE fmi2GetFMUstate
#define SET_STATE fmi2SetFMUstate
#define FREE_STATE fmi2FreeFMUstate
#define SERIALIZE fmi2SerializeFMUstate
#define DESERIALIZE fmi2DeSerializeFMUstate
#define SET_LOGGING fmi2SetDebugLogging

static void logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                   fmi2String message, ...)
{
    (void)environment, (void)status;
    if (!name || !category || !message || strlen(message) >= MESSAGE) abort();
}

static instance *make(const char *name, const char *guid, int logging, int kind)
{
    static const fmi2CallbackFunctions callbacks = {logger, calloc, free, NULL, NULL};
    return fmi2Instantiate(name, kind == 7 ? fmi2ModelExchange : fmi2CoSimulation, guid, NULL, &callbacks, 0, logging);
}

static void begin(instance *m, double start)
{
    fmi2SetupExperiment(m, 0, 0.0, start, 0, 0.0);
    fmi2EnterInitializationMode(m);
}

static void after_initialization(instance *m)
{
    (void)m;
}

static int do_step(instance *m, double time, double size)
{
    return fmi2DoStep(m, time, size, 1);
}

#define DEFINE_CALLS(kinds, Kind, type)                                                                 \
    static void set_##kinds(instance *m, const uint32_t *vr, size_t n, const type *values, uint8_t any)  \
    {                                                                                                   \
        (void)any;                                                                                      \
        fmi2Set##Kind(m, vr, n, values);                                                                \
    }                                                                                                   \
    static void get_##kinds(instance *m, const uint32_t *vr, size_t n, type *values, uint8_t any)        \
    {                                                                                                   \
        (void)any;                                                                                      \
        fmi2Get##Kind(m, vr, n, values);                                                                \
    }

DEFINE_CALLS(reals, Real, double)
DEFINE_CALLS(integers, Integer, int32_t)
DEFINE_CALLS(booleans, Boolean, int32_t)

/* Only in FMI 2.0: derivatives of inputs. */
static void special(bytes *b, instance *m, uint32_t *vr, size_t n)
{
    fmi2Real rates[3] = {0.0};
    fmi2Integer orders[3] = {0};
    for (size_t i = 0; i < n; ++i) {
        rates[i] = number(b);
        orders[i] = byte(b) < 240 ? 1 : byte(b);
        if (byte(b) < 200) vr[i] %= FMU_INPUTS;
    }
    fmi2SetRealInputDerivatives(m, vr, n, orders, rates);
}

static void rest(bytes *b, instance *m, const uint32_t *vr, size_t n)
{
    fmi2Real real, reals[3] = {0.0};
    fmi2Integer integers[3] = {0};
    fmi2Boolean boolean;
    fmi2Status status;
    fmi2GetRealStatus(m, byte(b) % 5, &real);
    fmi2GetBooleanStatus(m, byte(b) % 5, &boolean);
    fmi2GetStatus(m, byte(b) % 5, &status);
    fmi2CancelStep(m);
    fmi2GetRealOutputDerivatives(m, vr, n, integers, reals);
    fmi2GetDirectionalDerivative(m, vr, n, vr, n, reals, reals);
    fmi2GetIntegerStatus(m, fmi2PendingStatus, integers);
    fmi2GetStringStatus(m, fmi2PendingStatus, NULL);
    fmi2GetString(m, vr, n, NULL);
    fmi2SetString(m, vr, n, NULL);
    fmi2SetReal(m, NULL, n, NULL);
    fmi2GetBoolean(m, vr, n, NULL);
}
