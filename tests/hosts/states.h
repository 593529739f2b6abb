/* FMU states: saved, restored, serialized, moved to other instances, damaged. */
#ifndef STATES_H
#define STATES_H

#include "fmu.h"

enum { BEFORE = 50, AFTER = 120 };
/* Not a multiple of the internal ticks, so that states are saved inside a tick. */
#define ODD 0.7e-3

static Instance *midway(void) {
    Instance *i = started(true);
    set_real(i, VR_fin_command, 0.2);
    set_real(i, VR_aero_torque, -20.0);
    for (int n = 0; n < BEFORE; n++) step(i, n * ODD, ODD);
    return i;
}

/* Continues with changes of a tunable parameter and an input, which belong to the state. */
static void onward(Instance *i, Outputs *into) {
    into[0] = outputs(i);
    set_real(i, VR_controller_position_ki, 20.0);
    for (int n = 0; n < AFTER; n++) {
        if (n == AFTER / 2) set_real(i, VR_fin_command, -0.3);
        step(i, (BEFORE + n) * ODD, ODD);
        into[n + 1] = outputs(i);
    }
}

static fmi2FMUstate save(Instance *i) {
    fmi2FMUstate state = NULL;
    check(i, fmu.GetFMUstate(i->component, &state), "fmi2GetFMUstate");
    return state;
}

static void release(Instance *i, fmi2FMUstate *state) {
    check(i, fmu.FreeFMUstate(i->component, state), "fmi2FreeFMUstate");
    if (*state) fail("fmi2FreeFMUstate leaves the pointer");
}

/* Whether an instance continues from `state` with the outputs `straight`. */
static bool continues(Instance *i, fmi2FMUstate state, const Outputs *straight) {
    static Outputs found[AFTER + 1];
    check(i, fmu.SetFMUstate(i->component, state), "fmi2SetFMUstate");
    onward(i, found);
    return same(found, straight, AFTER + 1);
}

/* Changes one byte at a time, and counts the damaged states that are refused. */
static void damage(Instance *i, const fmi2Byte *data, size_t size) {
    fmi2Byte *copy = malloc(size);
    int damaged = 0, refused = 0, silent = 0;
    if (!copy) fail("no memory");
    for (size_t k = 0; k < size; k += 7) {
        fmi2FMUstate state = NULL;
        int messages = i->messages;
        memcpy(copy, data, size);
        copy[k] ^= 0x15;
        fmi2Status status = fmu.DeSerializeFMUstate(i->component, copy, size, &state);
        damaged++;
        refused += status == fmi2Error && state == NULL;
        silent += i->messages == messages;
        if (state) fmu.FreeFMUstate(i->component, &state);
    }
    free(copy);
    printf("damaged=%d\nrefused=%d\nsilent=%d\n", damaged, refused, silent);
}

static void states(void) {
    static Outputs straight[AFTER + 1], again[AFTER + 1];
    Instance *i = midway();
    fmi2FMUstate state = save(i), none = NULL, other = NULL;
    size_t size = 0;
    onward(i, straight);
    printf("moved=%d\n", !same(&straight[0], &straight[AFTER], 1));
    printf("restored=%d\n", continues(i, state, straight));

    check(i, fmu.SerializedFMUstateSize(i->component, state, &size), "fmi2SerializedFMUstateSize");
    fmi2Byte *data = calloc(size + 1, 1);
    if (!data) fail("no memory");
    data[size] = 0x5a;
    check(i, fmu.SerializeFMUstate(i->component, state, data, size), "fmi2SerializeFMUstate");
    printf("within=%d\n", data[size] == 0x5a);
    release(i, &state);
    printf("free null=%d\n", fmu.FreeFMUstate(i->component, &none));
    free_instance(i);

    /* The instance that wrote the bytes is freed. */
    i = midway();
    check(i, fmu.DeSerializeFMUstate(i->component, data, size, &other), "fmi2DeSerializeFMUstate");
    printf("moved over=%d\n", continues(i, other, straight));
    Instance *fresh = new_instance("fresh", UNIT_GUID);
    printf("into fresh=%d\n", continues(fresh, other, straight));

    /* fmi2GetFMUstate overwrites an existing state with the present one. */
    check(i, fmu.SetFMUstate(i->component, other), "fmi2SetFMUstate");
    step(i, BEFORE * ODD, ODD);
    check(i, fmu.GetFMUstate(i->component, &other), "fmi2GetFMUstate");
    again[0] = outputs(i);
    step(i, (BEFORE + 1) * ODD, ODD);
    check(i, fmu.SetFMUstate(i->component, other), "fmi2SetFMUstate");
    again[1] = outputs(i);
    printf("overwritten=%d\n", same(&again[0], &again[1], 1));
    release(i, &other);

    damage(i, data, size);
    printf("cut=%d\n", fmu.DeSerializeFMUstate(i->component, data, size - 1, &none));
    printf("empty=%d\n", fmu.DeSerializeFMUstate(i->component, data, 0, &none));
    state = save(i);
    printf("no room=%d\n", fmu.SerializeFMUstate(i->component, state, data, size - 1));
    free(data);
    release(i, &state);
    free_instance(fresh);
    free_instance(i);
}

#endif
