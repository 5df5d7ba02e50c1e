/* A controller as an FMU: its values, how they are set and read, and how it steps. Knows nothing of FMI.
 *
 * A communication step is a whole number of samples. The controller runs at the beginning of each, on the inputs that
 * stand then; what it commands can be read after the step and is meant for the step itself: step the controller before
 * the bed. Functions return 0 where they fail, and say why in the motion's message. */
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
enum { IN_KNOWN = CONTROLLER_READINGS, IN_HOLD = IN_KNOWN + CONTROLLER_KNOWN, IN_MODE = IN_HOLD + CONTROLLER_DYNAMOMETERS, IN_LIFE, IN_ADDED, IN_TRIGGER = IN_ADDED + CONTROLLER_DYNAMOMETERS, IN_SHIFTING = IN_TRIGGER + (CONTROLLER_LEARNED > 0), IN_ROAD = IN_SHIFTING + MAY_SHIFT };

#define MOST_SAMPLES 1e7 /* in one communication step */
#define NEAR 1e-6        /* of a sample: how far a communication step may be from a whole number of them */

#include "slave.h"

/* Flat, so that copying it saves it. */
typedef struct {
    Phase phase;
    double value[N_VALUES];
    double slope[N_INPUTS + 1]; /* inputs are held: slopes are taken and not used */
    controller running;
    char message[MESSAGE];
} Motion;

#include "slave.c"

static void begin(Motion *m) {
    memset(m, 0, sizeof *m);
    memcpy(m->value, START, sizeof m->value);
    controller_init(&m->running);
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
        own->torque_gain[j] = *p++;
        own->power_limit[j] = *p++;
        own->check_torque[j] = *p++;
        own->check_speed[j] = *p++;
    }
    for (int i = 0; i < CONTROLLER_READINGS; i++) own->unexpected[i] = *p++;
    for (int i = 0; i < CONTROLLER_SHAFTS; i++) own->opened_torque[i] = *p++;
    if (CONTROLLER_SHAFTS > 0) own->opened_share = *p++;
    own->undelivered_share = *p++;
    own->frozen_samples = (int32_t)*p++;
    own->life_samples = (int32_t)*p++;
    own->ride_samples = (int32_t)*p++;
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
    for (int j = 0; j < CONTROLLER_DYNAMOMETERS; j++) in.added_torque[j] = u[IN_ADDED + j];
    in.mode = u[IN_MODE] >= 2.5 ? 3 : u[IN_MODE] >= 1.5 ? 2 : u[IN_MODE] >= 0.5 ? 1 : 0;
    in.life = isfinite(u[IN_LIFE]) ? (uint32_t)(int64_t)fmod(u[IN_LIFE], 4294967296.0) : 0;
    in.trigger = (CONTROLLER_LEARNED > 0 && u[IN_TRIGGER < N_INPUTS ? IN_TRIGGER : 0] >= 0.5) ? 1 : 0;
    in.shifting = (MAY_SHIFT > 0 && u[IN_SHIFTING < N_INPUTS ? IN_SHIFTING : 0] >= 0.5) ? 1 : 0;
    take_settings(m);
#if CONTROLLER_VEHICLE_STATES > 0
    for (int i = 0; i < CONTROLLER_TYRES; i++) m->running.settings.friction[i] = u[IN_ROAD + i];
    m->running.settings.mass = u[IN_ROAD + CONTROLLER_TYRES];
    m->running.settings.grade = u[IN_ROAD + CONTROLLER_TYRES + 1];
#endif
#if CONTROLLER_FOREIGN > 0
    for (int j = 0; j < CONTROLLER_DYNAMOMETERS; j++) in.cut_speed[j] = u[IN_ROAD + j];
#endif
    for (double k = 0; k < samples; k++) {
        controller_step(&m->running, &in, &out);
        for (int j = 0; j < CONTROLLER_DYNAMOMETERS; j++) m->value[OUTPUTS + j] = out.command[j];
        m->value[OUTPUTS + CONTROLLER_DYNAMOMETERS] = out.mode;
        m->value[OUTPUTS + CONTROLLER_DYNAMOMETERS + 1] = out.fault;
        m->value[OUTPUTS + CONTROLLER_DYNAMOMETERS + 2] = out.fault_sensor + 1;
        m->value[OUTPUTS + CONTROLLER_DYNAMOMETERS + 3] = out.missed_samples;
#if CONTROLLER_VEHICLE_STATES > 0
        double *vehicle = m->value + OUTPUTS + CONTROLLER_DYNAMOMETERS + 4;
        *vehicle++ = out.vehicle_speed;
        *vehicle++ = out.vehicle_distance;
        for (int j = 0; j < CONTROLLER_DYNAMOMETERS; j++) *vehicle++ = out.wheel_speed[j];
        for (int i = 0; i < CONTROLLER_TYRES; i++) *vehicle++ = out.slip[i];
        for (int i = 0; i < CONTROLLER_TYRES; i++) *vehicle++ = out.tyre_torque[i];
#endif
#if CONTROLLER_FOREIGN > 0
        for (int j = 0; j < CONTROLLER_DYNAMOMETERS; j++)
            m->value[OUTPUTS + CONTROLLER_DYNAMOMETERS + 4 + j] = out.cut_torque[j];
#endif
        double *tracked = m->value + PARAMETERS - 7 * CONTROLLER_DYNAMOMETERS; /* the last outputs */
        for (int j = 0; j < CONTROLLER_DYNAMOMETERS; j++) {
            *tracked++ = out.tracked_gain[j];
            *tracked++ = out.gain_uncertainty[j];
            *tracked++ = out.tracked_zero[j];
            *tracked++ = out.zero_uncertainty[j];
            *tracked++ = out.tracked_delay[j];
            *tracked++ = out.delay_uncertainty[j];
            *tracked++ = out.drifted[j];
        }
    }
    m->value[TIME] += span;
    return 1;
}
