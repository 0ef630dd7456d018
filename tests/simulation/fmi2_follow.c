/* A unit of FMI 2 that follows the lead vehicle; `fault`: 1 aborts, 2 hangs, 3 answers an error, at the 20th step. */
#include "fmi2Functions.h"
#include <stdlib.h>
#include <unistd.h>

enum { V, GAP, LEAD_V, TIME_GAP, A, COUNT };
typedef struct { double real[COUNT]; int exists, fault, steps; const fmi2CallbackFunctions *host; } Unit;

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String place,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
    Unit *unit = calloc(1, sizeof(Unit));
    unit->real[TIME_GAP] = 1.5;
    unit->host = functions;
    return unit;
}
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean d, fmi2Real e, fmi2Real start, fmi2Boolean f, fmi2Real stop) {
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    for (size_t i = 0; i < n; i++) ((Unit *)c)->real[vr[i]] = value[i];
    return fmi2OK;
}
fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[]) {
    ((Unit *)c)->exists = value[0];
    return fmi2OK;
}
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[]) {
    ((Unit *)c)->fault = value[0];
    return fmi2OK;
}
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    for (size_t i = 0; i < n; i++) value[i] = ((Unit *)c)->real[vr[i]];
    return fmi2OK;
}
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real step, fmi2Boolean no) {
    Unit *unit = c;
    double *x = unit->real, a = 0.4 * (25.0 - x[V]);
    if (unit->exists) {
        double b = 0.25 * (x[GAP] - 4.0 - x[TIME_GAP] * x[V]) + 0.8 * (x[LEAD_V] - x[V]);
        if (b < a) a = b;
    }
    x[A] = a < -8.0 ? -8.0 : a > 2.0 ? 2.0 : a;
    if (++unit->steps == 20) {
        if (unit->fault == 1) abort();
        if (unit->fault == 2) sleep(1000);
        if (unit->fault == 3) {
            const char *why = "no\tplan for a gap of %s at step %d";
            unit->host->logger(0, "function", fmi2Error, "error", why, "80 m", unit->steps);
            return fmi2Error;
        }
    }
    return fmi2OK;
}
