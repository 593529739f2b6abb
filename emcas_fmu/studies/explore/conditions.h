/* The conditions that a call of the equations at rest has evaluated, in order. */
static int conditions[LINEAR_CONDITIONS], reuses_conditions;
static size_t next_condition;

/* Begins a call: with `hold` it reuses the recorded conditions, otherwise it records its own. */
static void at_rest_begin(int hold)
{
    reuses_conditions = hold;
    next_condition = 0;
}

static int recorded(int condition)
{
    int *value = &conditions[next_condition++];
    if (!reuses_conditions) *value = condition;
    return *value;
}
