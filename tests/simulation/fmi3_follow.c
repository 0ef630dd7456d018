/* The same unit as fmi2_follow.c, of FMI 3, without its faults. */
#include "fmi3Functions.h"
#include <stdlib.h>

enum { V, GAP, LEAD_V, TIME_GAP, A, COUNT };
typedef struct { double real[COUNT]; fmi3Boolean exists; fmi3LogMessageCallback say; } Unit;

const char *fmi3GetVersion(void) { return fmi3Version; }
fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String place, fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean events,
    fmi3Boolean early, const fmi3ValueReference wanted[], size_t n, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    Unit *unit = calloc(1, sizeof(Unit));
    unit->real[TIME_GAP] = 1.5;
    unit->say = log;
    return unit;
}
void fmi3FreeInstance(fmi3Instance c) { free(c); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean d, fmi3Float64 e, fmi3Float64 start, fmi3Boolean f,
                                       fmi3Float64 stop) {
    return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { return fmi3OK; }
fmi3Status fmi3Terminate(fmi3Instance c) { return fmi3OK; }
fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64 value[], size_t m) {
    for (size_t i = 0; i < n; i++) ((Unit *)c)->real[vr[i]] = value[i];
    return fmi3OK;
}
fmi3Status fmi3SetBoolean(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Boolean value[], size_t m) {
    ((Unit *)c)->exists = value[0];
    return fmi3OK;
}
fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 value[], size_t m) {
    for (size_t i = 0; i < n; i++) value[i] = ((Unit *)c)->real[vr[i]];
    return fmi3OK;
}
fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 step, fmi3Boolean no, fmi3Boolean *event,
                      fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last) {
    Unit *unit = c;
    double *x = unit->real, a = 0.4 * (25.0 - x[V]);
    if (unit->exists) {
        double b = 0.25 * (x[GAP] - 4.0 - x[TIME_GAP] * x[V]) + 0.8 * (x[LEAD_V] - x[V]);
        if (b < a) a = b;
    }
    x[A] = a < -8.0 ? -8.0 : a > 2.0 ? 2.0 : a;
    *event = *terminate = *early = 0;
    *last = t + step;
    return fmi3OK;
}
