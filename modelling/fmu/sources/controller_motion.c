/* A controller as an FMU: its values, how they are set and read, and how it steps. Knows nothing of FMI.
 *
 * A communication step is a whole number of samples. The controller runs at the beginning of each, on the inputs that
 * stand then; what it commands can be read after the step and is meant for the step itself: step the controller before
 * the bed. Functions return 0 where they fail, and say why in the motion's message. */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#include "controller.c"

#include "model.h"

enum {
    TIME,
    INPUTS,
    OUTPUTS = INPUTS + N_INPUTS,
    PARAMETERS = OUTPUTS + N_OUTPUTS,
    N_VALUES = PARAMETERS + N_PARAMETERS
};

/* where things stand among the inputs */
enum { IN_KNOWN = CONTROLLER_READINGS, IN_HOLD = IN_KNOWN + CONTROLLER_KNOWN, IN_MODE = IN_HOLD + CONTROLLER_DYNAMOMETERS, IN_LIFE };

#define MOST_SAMPLES 1e7 /* in one communication step */
#define NEAR 1e-6        /* of a sample: how far a communication step may be from a whole number of them */
#define MESSAGE 400

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif
#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)

typedef enum { INSTANTIATED, INITIALISING, STEPPING, TERMINATED } Phase;

/* Flat, so that copying it saves it. */
typedef struct {
    Phase phase;
    double value[N_VALUES];
    double slope[N_INPUTS + 1]; /* inputs are held: slopes are taken and not used */
    controller running;
    char message[MESSAGE];
} Motion;

static int fail(Motion *m, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(m->message, MESSAGE, format, arguments);
    va_end(arguments);
    return 0;
}

static void begin(Motion *m) {
    memset(m, 0, sizeof *m);
    memcpy(m->value, START, sizeof m->value);
    controller_init(&m->running);
}

static int known(Motion *m, unsigned reference) {
    return reference < N_VALUES || fail(m, "no variable has the value reference %u; there are %d", reference, N_VALUES);
}

static int get(Motion *m, unsigned reference, double *value) {
    if (!known(m, reference)) return 0;
    *value = m->value[reference];
    return 1;
}

/* inputs that are not finite are what the controller watches for, so they may be set */
static int set(Motion *m, unsigned reference, double value) {
    if (!known(m, reference)) return 0;
    const char *name = NAME[reference];
    if (reference == TIME || (reference >= OUTPUTS && reference < PARAMETERS))
        return fail(m, "%s: is computed and cannot be set; inputs and parameters can", name);
    if (reference >= PARAMETERS) {
        double low = LOWER[reference - PARAMETERS], high = UPPER[reference - PARAMETERS];
        if (!(value >= low && value <= high))
            return fail(m, "%s: %g is not possible; %g ... %g is needed", name, value, low, high);
    }
    m->value[reference] = value;
    return 1;
}

static void take_settings(Motion *m) {
    const double *p = m->value + PARAMETERS;
    controller_settings *own = &m->running.settings;
    for (int j = 0; j < CONTROLLER_DYNAMOMETERS; j++) {
        own->torque_limit[j] = *p++;
        own->speed_limit[j] = *p++;
        own->hold_proportional[j] = *p++;
        own->hold_integral[j] = *p++;
        own->lost_torque[j] = *p++;
    }
    for (int i = 0; i < CONTROLLER_READINGS; i++) own->unexpected[i] = *p++;
    own->frozen_samples = (int32_t)*p++;
    own->life_samples = (int32_t)*p++;
}

static int advance(Motion *m, double span) {
    double samples = round(span / CONTROLLER_SAMPLE_TIME);
    if (!isfinite(span) || span < 0 || samples > MOST_SAMPLES || fabs(span / CONTROLLER_SAMPLE_TIME - samples) > NEAR)
        return fail(m, "a communication step of %g s is no whole number of samples of %g s", span, CONTROLLER_SAMPLE_TIME);
    const double *u = m->value + INPUTS;
    controller_input in;
    controller_output out;
    memset(&in, 0, sizeof in);
    for (int i = 0; i < CONTROLLER_READINGS; i++) in.reading[i] = u[i];
    for (int i = 0; i < CONTROLLER_KNOWN; i++) in.known[i] = u[IN_KNOWN + i];
    for (int j = 0; j < CONTROLLER_DYNAMOMETERS; j++) in.hold_speed[j] = u[IN_HOLD + j];
    in.mode = u[IN_MODE] >= 1.5 ? 2 : u[IN_MODE] >= 0.5 ? 1 : 0;
    in.life = isfinite(u[IN_LIFE]) ? (uint32_t)(int64_t)fmod(u[IN_LIFE], 4294967296.0) : 0;
    take_settings(m);
    for (double k = 0; k < samples; k++) {
        controller_step(&m->running, &in, &out);
        for (int j = 0; j < CONTROLLER_DYNAMOMETERS; j++) m->value[OUTPUTS + j] = out.command[j];
        m->value[OUTPUTS + CONTROLLER_DYNAMOMETERS] = out.mode;
        m->value[OUTPUTS + CONTROLLER_DYNAMOMETERS + 1] = out.fault;
    }
    m->value[TIME] += span;
    return 1;
}

static int to_phase(Motion *m, Phase from, Phase to, const char *otherwise) {
    if (m->phase != from) return fail(m, "%s", otherwise);
    m->phase = to;
    return 1;
}

static int enter_initialisation(Motion *m) {
    return to_phase(m, INSTANTIATED, INITIALISING, "initialisation begins after instantiation or reset only");
}

static int leave_initialisation(Motion *m) {
    return to_phase(m, INITIALISING, STEPPING, "initialisation has not begun");
}

static int terminate(Motion *m) { return to_phase(m, STEPPING, TERMINATED, "nothing runs that could be terminated"); }

static int start_at(Motion *m, double time) {
    if (m->phase != INSTANTIATED) return fail(m, "the start time is given before initialisation");
    if (!isfinite(time)) return fail(m, "the start time is not a finite number");
    m->value[TIME] = time;
    return 1;
}

static int step(Motion *m, double now, double span) {
    double own = m->value[TIME];
    if (m->phase != STEPPING) return fail(m, "a step needs initialisation to be over, and no termination");
    if (!(fabs(now - own) <= 1e-9 * fmax(1, fabs(own))))
        return fail(m, "the step begins at %.9g s, but the last one ended at %.9g s", now, own);
    return advance(m, span);
}
