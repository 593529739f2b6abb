/* Runs the native FMU with a step of the fin command under a restoring hinge moment, and prints the response as CSV.
 *
 *     unzip -qo EMCAS.fmu -d emcas
 *     cc -std=c11 -I headers host.c -o host -ldl
 *     ./host emcas > response.csv
 *
 * The argument is the folder of the unpacked FMU. The program is C11 with POSIX; on Windows use LoadLibrary instead of dlopen.
 * The headers are those of FMI 2.0, from fmi-standard.org or from fmpy's folder c-code. It is also valid C++ (-x c++).
 */
#define _DEFAULT_SOURCE /* realpath */
#include <dlfcn.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

#define STEP 1e-3       /* s: the controllers' sample time */
#define STIFFNESS 200.0 /* N.m/rad: the restoring hinge moment is -STIFFNESS * angle */

#if defined(__APPLE__)
#define LIBRARY "binaries/darwin64/EMCAS.dylib"
#elif defined(__aarch64__)
#define LIBRARY "binaries/aarch64-linux/EMCAS.so"
#else
#define LIBRARY "binaries/linux64/EMCAS.so"
#endif

static void fail(const char *what, const char *why) {
    fprintf(stderr, "host: %s: %s\n", what, why);
    exit(1);
}

static void check(fmi2Status status, const char *call) {
    if (status > fmi2Warning) fail(call, "refused; the FMU says why above");
}

static void logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                   fmi2String message, ...) {
    va_list arguments;
    (void)environment, (void)status;
    fprintf(stderr, "%s [%s]: ", name, category);
    va_start(arguments, message);
    vfprintf(stderr, message, arguments);
    va_end(arguments);
    fputc('\n', stderr);
}

static char *read_text(const char *path) {
    FILE *file = fopen(path, "rb");
    char *text;
    long size;
    if (!file) fail(path, "cannot be opened; is this an unpacked FMU?");
    fseek(file, 0, SEEK_END);
    size = ftell(file);
    rewind(file);
    text = (char *)calloc((size_t)size + 1, 1);
    if (!text || fread(text, 1, (size_t)size, file) != (size_t)size) fail(path, "cannot be read");
    fclose(file);
    return text;
}

/* Returns the first value of an attribute after `from`; a host with an XML library does not need this function. */
static char *attribute(const char *from, const char *name) {
    char pattern[64];
    const char *begin, *end;
    char *value;
    snprintf(pattern, sizeof pattern, " %s=\"", name);
    begin = from ? strstr(from, pattern) : NULL;
    end = begin ? strchr(begin += strlen(pattern), '"') : NULL;
    if (!end) fail("modelDescription.xml has no", name);
    value = (char *)calloc((size_t)(end - begin) + 1, 1);
    if (!value) fail("memory", "none left");
    return (char *)memcpy(value, begin, (size_t)(end - begin));
}

/* Returns a value reference by name: value references may differ between versions of the FMU. */
static fmi2ValueReference reference(const char *description, const char *name) {
    char pattern[128];
    const char *found;
    char *text;
    fmi2ValueReference value;
    snprintf(pattern, sizeof pattern, "<ScalarVariable name=\"%s\"", name);
    found = strstr(description, pattern);
    if (!found) fail("modelDescription.xml has no variable", name);
    text = attribute(found, "valueReference");
    value = (fmi2ValueReference)strtoul(text, NULL, 10);
    free(text);
    return value;
}

static void *library;

/* Copies a function's address, since ISO C cannot convert a pointer to an object to a pointer to a function. */
static void find(const char *name, void *into) {
    void *address = dlsym(library, name);
    if (!address) fail(name, "is not in the library");
    memcpy(into, &address, sizeof address);
}

#define FUNCTION(name) fmi2##name##TYPE *name; find("fmi2" #name, &name)

int main(int count, char **arguments) {
    char path[4096], uri[4200];
    if (count != 2 || !realpath(arguments[1], path)) fail("usage", "host FOLDER, the unpacked FMU");
    snprintf(uri, sizeof uri, "file://%s/resources", path);

    strncat(path, "/modelDescription.xml", sizeof path - strlen(path) - 1);
    char *description = read_text(path);
    char *guid = attribute(description, "guid");
    fmi2ValueReference command = reference(description, "fin_command"), moment = reference(description, "aero_torque");
    fmi2ValueReference outputs[] = {reference(description, "fin_angle"), reference(description, "fin_rate"),
                                    reference(description, "supply_power")};

    snprintf(strrchr(path, '/') + 1, sizeof LIBRARY, "%s", LIBRARY);
    library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!library) fail("dlopen", dlerror());
    FUNCTION(Instantiate);
    FUNCTION(SetupExperiment);
    FUNCTION(EnterInitializationMode);
    FUNCTION(ExitInitializationMode);
    FUNCTION(SetReal);
    FUNCTION(GetReal);
    FUNCTION(DoStep);
    FUNCTION(Terminate);
    FUNCTION(FreeInstance);

    fmi2CallbackFunctions callbacks = {logger, calloc, free, NULL, NULL};
    fmi2Component fin = Instantiate("fin", fmi2CoSimulation, guid, uri, &callbacks, fmi2False, fmi2False);
    if (!fin) fail("fmi2Instantiate", "refused; the FMU says why above");
    check(SetupExperiment(fin, fmi2False, 0.0, 0.0, fmi2False, 0.0), "fmi2SetupExperiment");
    check(EnterInitializationMode(fin), "fmi2EnterInitializationMode");
    /* Set parameters here. */
    check(ExitInitializationMode(fin), "fmi2ExitInitializationMode");

    fmi2Real values[3];
    check(GetReal(fin, outputs, 3, values), "fmi2GetReal");
    printf("time,fin_angle,fin_rate,supply_power\n");
    for (int k = 0; k <= 300; k++) {
        printf("%.3f,%.17g,%.17g,%.17g\n", k * STEP, values[0], values[1], values[2]);
        fmi2Real target = k < 50 ? 0.0 : 0.2, load = -STIFFNESS * values[0];
        check(SetReal(fin, &command, 1, &target), "fmi2SetReal");
        check(SetReal(fin, &moment, 1, &load), "fmi2SetReal");
        /* A product: the sum of the steps would drift. */
        check(DoStep(fin, k * STEP, STEP, fmi2True), "fmi2DoStep");
        check(GetReal(fin, outputs, 3, values), "fmi2GetReal");
    }
    check(Terminate(fin), "fmi2Terminate");
    FreeInstance(fin);
    free(guid);
    free(description);
    dlclose(library);
    return 0;
}
