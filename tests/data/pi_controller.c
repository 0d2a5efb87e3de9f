/* SPDX-License-Identifier: LGPL-3.0-or-later */
/* A PI controller with a rate feedback as an FMU: of FMI 3 with -DFMI3, else of FMI 2.
 *
 * u = proportional (setpoint - y) - damping rate + x,  x' = integral (setpoint - y) by Euler's method. */
#include <stdlib.h>

enum { Y, RATE, U, PROPORTIONAL, DAMPING, INTEGRAL, SETPOINT, REVERSED, COUNT };

typedef struct {
    double value[COUNT];
    double state;
} Controller;

static Controller *create(void) { return calloc(1, sizeof(Controller)); }

static double value(const Controller *c, unsigned int reference) {
    const double *v = c->value;
    if (reference != U)
        return v[reference];
    double u = v[PROPORTIONAL] * (v[SETPOINT] - v[Y]) - v[DAMPING] * v[RATE] + c->state;
    return v[REVERSED] ? -u : u;
}

static void step(Controller *c, double h) {
    c->state += h * c->value[INTEGRAL] * (c->value[SETPOINT] - c->value[Y]);
}

/* In the place of all that an FMU must export and that nobody calls here. */
int unsupported(void) { return 3; }

#ifdef FMI3
#include "fmi3Functions.h"

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
    const fmi3ValueReference intermediate[], size_t count, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    return create();
}
void fmi3FreeInstance(fmi3Instance c) { free(c); }
fmi3Status fmi3EnterInitializationMode(
    fmi3Instance c, fmi3Boolean has_tolerance, fmi3Float64 tolerance, fmi3Float64 start,
    fmi3Boolean has_stop, fmi3Float64 stop) {
    return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { return fmi3OK; }
fmi3Status fmi3Terminate(fmi3Instance c) { return fmi3OK; }
fmi3Status fmi3SetFloat64(
    fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64 v[], size_t m) {
    for (size_t i = 0; i < n; ++i)
        ((Controller *)c)->value[vr[i]] = v[i];
    return fmi3OK;
}
fmi3Status fmi3SetBoolean(
    fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Boolean v[], size_t m) {
    for (size_t i = 0; i < n; ++i)
        ((Controller *)c)->value[vr[i]] = v[i];
    return fmi3OK;
}
fmi3Status fmi3GetFloat64(
    fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 v[], size_t m) {
    for (size_t i = 0; i < n; ++i)
        v[i] = value(c, vr[i]);
    return fmi3OK;
}
fmi3Status fmi3DoStep(
    fmi3Instance c, fmi3Float64 t, fmi3Float64 h, fmi3Boolean no_reset, fmi3Boolean *event,
    fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last) {
    step(c, h);
    *event = *early = 0;
    *terminate = t + h > 1e3;
    *last = t + h;
    return fmi3OK;
}
#else
#include "fmi2Functions.h"

fmi2Component fmi2Instantiate(
    fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
    const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
    return create();
}
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetupExperiment(
    fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
    fmi2Boolean has_stop, fmi2Real stop) {
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real v[]) {
    for (size_t i = 0; i < n; ++i)
        ((Controller *)c)->value[vr[i]] = v[i];
    return fmi2OK;
}
fmi2Status fmi2SetBoolean(
    fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean v[]) {
    for (size_t i = 0; i < n; ++i)
        ((Controller *)c)->value[vr[i]] = v[i];
    return fmi2OK;
}
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real v[]) {
    for (size_t i = 0; i < n; ++i)
        v[i] = value(c, vr[i]);
    return fmi2OK;
}
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean no_set) {
    step(c, h);
    return t + h > 1e3 ? fmi2Error : fmi2OK;
}
#endif
