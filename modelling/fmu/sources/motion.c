/* A model in motion: its values, how they are set and read, and how it steps. Knows nothing of FMI.
 *
 * model.h holds sizes, names and start values, model.c the functions that CasADi wrote:
 *
 *   constants(p, contact) -> c            what follows from the parameters alone
 *   field(x, u, c)        -> xdot
 *   reading(x, u, c, t)   -> y
 *
 * Classical Runge-Kutta of order four. A communication step is cut into the fewest equal steps that are none longer
 * than 1/simulation.steps_per_second, so it may have any length. Inputs are held over it, or follow their slopes.
 * Nothing is allocated here. Functions return 0 where they fail, and say why in the motion's message.
 */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model.h"

#define CASADI_SYMBOL_EXPORT static
#include "model.c"

/* where things stand among the values; a value reference of FMI is an index into them */
enum {
    TIME,
    INPUTS,
    OUTPUTS = INPUTS + N_INPUTS,
    PARAMETERS = OUTPUTS + N_OUTPUTS,
    STATES = PARAMETERS + N_PARAMETERS,
    N_VALUES = STATES + N_STATES,
    STEPS_PER_SECOND = STATES - 1 /* the last parameter */
};

#define MOST_STEPS 1e7 /* in one communication step */
#define MESSAGE 400

/* what is seen outside the library; all else is static */
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
    double slope[N_INPUTS + 1]; /* of the inputs, over the next communication step */
    double contact;             /* s over which the damping of a closing lash sets in: one internal step */
    double constant[N_CONSTANTS + 1];
    int constants_due, outputs_due;
    char message[MESSAGE]; /* why the last call failed */
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
    m->contact = CONTACT;
    m->constants_due = m->outputs_due = 1;
}

static void renew_constants(Motion *m) {
    const double *arg[N_ARG] = {m->value + PARAMETERS, &m->contact};
    double *res[N_RES] = {m->constant}, w[N_W];
    casadi_int iw[N_IW];
    if (m->constants_due) constants(arg, res, iw, w, 0);
    m->constants_due = 0;
}

/* inputs `since` s into the communication step */
static void look(const Motion *m, double since, double *u) {
    for (int i = 0; i < N_INPUTS; i++) u[i] = m->value[INPUTS + i] + m->slope[i] * since;
}

static void rates(const Motion *m, double since, const double *x, double *xdot) {
    double u[N_INPUTS + 1], *res[N_RES] = {xdot}, w[N_W];
    casadi_int iw[N_IW];
    look(m, since, u);
    const double *arg[N_ARG] = {x, u, m->constant};
    field(arg, res, iw, w, 0);
}

static void read_at(const Motion *m, const double *x, const double *u, double *y) {
    const double *arg[N_ARG] = {x, u, m->constant, m->value + TIME};
    double *res[N_RES] = {y}, w[N_W];
    casadi_int iw[N_IW];
    reading(arg, res, iw, w, 0);
}

static void renew_outputs(Motion *m) {
    if (!m->outputs_due) return;
    double u[N_INPUTS + 1];
    renew_constants(m);
    look(m, 0, u);
    read_at(m, m->value + STATES, u, m->value + OUTPUTS);
    m->outputs_due = 0;
}

static int known(Motion *m, unsigned reference) {
    return reference < N_VALUES || fail(m, "no variable has the value reference %u; there are %d", reference, N_VALUES);
}

static int get(Motion *m, unsigned reference, double *value) {
    if (!known(m, reference)) return 0;
    if (reference >= OUTPUTS && reference < PARAMETERS) renew_outputs(m);
    *value = m->value[reference];
    return 1;
}

/* states may be set before the motion begins, inputs and parameters at any time */
static int set(Motion *m, unsigned reference, double value) {
    if (!known(m, reference)) return 0;
    const char *name = NAME[reference];
    if (!isfinite(value)) return fail(m, "%s: the value is not a finite number", name);
    if (reference == TIME || (reference >= OUTPUTS && reference < PARAMETERS))
        return fail(m, "%s: is computed and cannot be set; inputs, parameters and start states can", name);
    if (reference >= STATES && m->phase >= STEPPING)
        return fail(m, "%s: a state cannot be set once the motion has begun; reset first", name);
    if (reference >= PARAMETERS && reference < STATES) {
        double low = LOWER[reference - PARAMETERS], high = UPPER[reference - PARAMETERS];
        if (value < low || value > high || (value == 0 && NOT_ZERO[reference - PARAMETERS]))
            return fail(m, "%s: %g is not possible; %g ... %g%s is needed", name, value, low, high,
                        NOT_ZERO[reference - PARAMETERS] ? ", but not 0," : "");
        m->constants_due = 1;
    }
    m->outputs_due = 1;
    m->value[reference] = value;
    return 1;
}

/* One communication step; the motion stays where it was if it fails. */
static int advance(Motion *m, double span) {
    double begun = m->value[TIME], wanted = ceil(span * m->value[STEPS_PER_SECOND] - 1e-9);
    if (!isfinite(span) || span < 0) return fail(m, "a communication step of %g s is not possible", span);
    if (span == 0) return 1;
    if (wanted > MOST_STEPS) return fail(m, "a communication step of %g s would take %.3g internal steps", span, wanted);
    int steps = wanted < 1 ? 1 : (int)wanted;
    double h = span / steps, x[N_STATES], y[N_STATES], k1[N_STATES], k2[N_STATES], k3[N_STATES], k4[N_STATES];
    if (HAS_CONTACT && m->contact != h) m->contact = h, m->constants_due = 1;
    renew_constants(m);
    memcpy(x, m->value + STATES, sizeof x);
    for (int j = 0; j < steps; j++) {
        double since = j * h;
        rates(m, since, x, k1);
        for (int i = 0; i < N_STATES; i++) y[i] = x[i] + h / 2 * k1[i];
        rates(m, since + h / 2, y, k2);
        for (int i = 0; i < N_STATES; i++) y[i] = x[i] + h / 2 * k2[i];
        rates(m, since + h / 2, y, k3);
        for (int i = 0; i < N_STATES; i++) y[i] = x[i] + h * k3[i];
        rates(m, since + h, y, k4);
        for (int i = 0; i < N_STATES; i++) x[i] += h / 6 * (k1[i] + 2 * (k2[i] + k3[i]) + k4[i]);
    }
    for (int i = 0; i < N_STATES; i++)
        if (!isfinite(x[i]))
            return fail(m, "%s: is not finite after %g s; raise simulation.steps_per_second or check the parameters",
                        NAME[STATES + i], begun + span);
    memcpy(m->value + STATES, x, sizeof x);
    for (int i = 0; i < N_INPUTS; i++) m->value[INPUTS + i] += m->slope[i] * span, m->slope[i] = 0;
    m->value[TIME] = begun + span;
    m->outputs_due = 1;
    return 1;
}

/* the phases of a slave's life */

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
