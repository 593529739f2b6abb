/* Many actuators, and many whole runs in one call, as a library for the Python API, in vectors. */
#include "kernel.h"
#include "vector.h"
#include "vector_kernel.h"

#include "tables.h"
