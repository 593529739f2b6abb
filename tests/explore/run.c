/* The actuator as a program: rows, step, parameters and inputs as hexadecimal floats in, the outputs' bytes out. */
#include "batch.c"

#include <stdio.h>
#include <stdlib.h>

static double *numbers(size_t count)
{
    double *made = malloc(count * sizeof *made);
    for (size_t i = 0; made && i < count; ++i)
        if (scanf("%la", made + i) != 1) exit(2);
    return made;
}

int main(void)
{
    size_t rows;
    double step;
    int result = 0;
    if (scanf("%zu %la", &rows, &step) != 2) return 2;
    const double *parameters = numbers(MODEL_PARAMETERS), *in = numbers(rows * MODEL_INPUTS);
    double *out = malloc(rows * MODEL_OUTPUTS * sizeof *out);
    actuator *one = malloc(sizeof *one);
    if (!parameters || !in || !out || !one) return 3;
    if (!actuator_start(one, parameters) || actuator_simulate(one, rows, step, in, out, &result) != rows) return 1;
    return fwrite(out, sizeof *out, rows * MODEL_OUTPUTS, stdout) != rows * MODEL_OUTPUTS;
}
