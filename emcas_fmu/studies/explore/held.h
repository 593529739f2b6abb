/* Conditions of the equations at rest: those of one call, in their order, which another call may keep. */
static int condition_kept[LINEAR_CONDITIONS];
static int conditions_hold;
static size_t next_condition;

/* Begins a call; its conditions hold as in the call before, or are kept for the next. */
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
