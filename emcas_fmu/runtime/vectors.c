/* Many actuators as a library for the Python API, by vectors. */
#include "kernel.h"
#include "vector.h"
#include "vector_kernel.h"

#include "tables.h"
