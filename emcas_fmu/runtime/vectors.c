/* Many actuators, in vectors, as a library for the Python API. */
#include "kernel.h"
#include "vector.h"
#include "vector_kernel.h"

#include "tables.h"
