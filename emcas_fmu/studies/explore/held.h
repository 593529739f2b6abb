/* The conditions of the equations at rest in one call, in order; the next call may reuse them. */
static int condition_kept[LINEAR_CONDITIONS];
static int conditions_hold;
static size_t next_condition;

/* Begins a call; it reuses the conditions of the last recorded call, or records its own. */
static void at_rest_begin(int hold)
{
    conditions_hold = hold;
    next_condition = 0;
}

static int held(int condition)
{
    int *kept = &condition_kept[next_condition++];
    if (!conditions_hold) *kept = condition;
    return *kept;
}
