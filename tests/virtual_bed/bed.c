/* A test bed as an FMU 2.0 for co-simulation, over the truth plant's engine: torque commands in, sensor readings out.
 *
 * Commands are held from their arrival on: each input has its own dead time, and a jitter of it drawn at every sample,
 * then factor, limit and lag of the engine. A sensor sees the motion through a first-order lag, late by its delay and the
 * jitter of the sampling, with gain, offset, noise and the steps of its converter. bed_data.h holds all numbers. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define INPUT_NOW arrived
#include "engine.c"
#include "bed_data.h" /* PLANT, INPUTS, SENSORS, DT, SUBSTEPS, SOURCE, FILTER, LATE, GAIN, OFFSET, NOISE, CONVERTER … */

#define KEPT 512     /* samples of commands that are kept: dead times stay below */
#define SEEN 8192    /* inner steps of readings that are kept */

typedef struct {
    Plant plant;
    Modes modes;
    double y[LARGEST], command[INPUTS], sent[KEPT][INPUTS], begins[KEPT][INPUTS];
    double filtered[SENSORS], before[SENSORS], history[SEEN][SENSORS], reading[SENSORS];
    double start_speed, moment;
    int64_t sample, steps;
    uint64_t random;
} Bed;

static Bed *running; /* the engine asks for its inputs without saying whose they are; beds are stepped one at a time */

static double even(Bed *b) { /* splitmix64 */
    uint64_t z = (b->random += 0x9E3779B97F4A7C15u);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return ((double)((z ^ (z >> 31)) >> 11) + 0.5) / 9007199254740992.0;
}

static double normal(Bed *b) { return sqrt(-2 * log(even(b))) * cos(6.283185307179586 * even(b)); }

/* what a staircase of commands gives at a moment, and since when */
static double stair(const Bed *b, int j, double moment, double *since) {
    for (int64_t n = b->sample; n >= 0 && n > b->sample - KEPT; n--)
        if (b->begins[n % KEPT][j] <= moment) {
            *since = b->begins[n % KEPT][j];
            return b->sent[n % KEPT][j];
        }
    *since = -INFINITY;
    return 0;
}

/* mean over an inner step: a command that arrives within it acts from then on */
static double arrived(const Plant *p, int j, double t) {
    const Bed *b = running;
    double h = DT / SUBSTEPS, since, before, value = stair(b, j, b->moment + h - 1e-12, &since);
    (void)t;
    if (since > b->moment) {
        double share = (b->moment + h - since) / h;
        value = share * value + (1 - share) * stair(b, j, b->moment, &before);
    }
    value *= p->factor[j];
    return value > p->limit[j] ? p->limit[j] : value < -p->limit[j] ? -p->limit[j] : value;
}

static double truth(const Bed *b, const double *row, int i) { return row[SOURCE[i]]; }

static void observe(Bed *b, double t) {
    double row[LARGEST];
    double h = DT / SUBSTEPS;
    write_row(&b->plant, t, b->y, &b->modes, 0, row);
    for (int i = 0; i < SENSORS; i++) {
        double now = truth(b, row, i);
        if (FILTER[i] > 0 && b->steps > 0) { /* exact for a signal that is straight between inner steps */
            double a = exp(-h / FILTER[i]), last = FILTER[i] / h * (1 - a) - a;
            b->filtered[i] = a * b->filtered[i] + last * b->before[i] + (1 - a - last) * now;
        } else b->filtered[i] = now;
        b->before[i] = now;
        b->history[b->steps % SEEN][i] = b->filtered[i];
    }
    b->steps++;
}

static void read_sensors(Bed *b) {
    double early = SAMPLING_JITTER > 0 ? fabs(SAMPLING_JITTER * normal(b)) : 0;
    for (int i = 0; i < SENSORS; i++) {
        double x = (LATE[i] + early) * SUBSTEPS / DT;
        int64_t whole = (int64_t)x, last = b->steps - 1;
        int64_t a = last - whole < 0 ? 0 : last - whole, c = a > 0 ? a - 1 : 0;
        double now = b->history[a % SEEN][i], before = b->history[c % SEEN][i];
        double value = GAIN[i] * (now + (before - now) * (x - (double)whole)) + OFFSET[i] + NOISE[i] * normal(b);
        b->reading[i] = CONVERTER[i] > 0 ? CONVERTER[i] * round(value / CONVERTER[i]) : value;
    }
}

static void begin(Bed *b) {
    const Plant *p = &PLANT;
    b->plant = *p;
    memset(b->y, 0, sizeof b->y);
    for (int i = 0; i < p->n; i++) b->y[p->n + i] = b->start_speed * TURNS[i];
    for (int i = 0; i < p->n; i++) b->modes.slide[i] = (b->y[p->n + i] > 0) - (b->y[p->n + i] < 0);
    for (int n = 0; n < KEPT; n++)
        for (int j = 0; j < p->u; j++) b->begins[n][j] = INFINITY;
    b->sample = 0;
    b->moment = -DT;
    b->steps = 0;
    b->random = SEED;
    running = b;
    event(p, 0, b->y, &b->modes, 0, 1);
    observe(b, 0);
    read_sensors(b);
}

/* 0: fine; 1: the motion is not finite */
static int sample(Bed *b) {
    const Plant *p = &b->plant;
    double t = (double)b->sample * DT, h = DT / SUBSTEPS;
    running = b;
    for (int j = 0; j < p->u; j++) {
        double late = p->delay[j] + (COMMAND_JITTER > 0 ? fabs(COMMAND_JITTER * normal(b)) : 0);
        b->sent[b->sample % KEPT][j] = b->command[j];
        b->begins[b->sample % KEPT][j] = t + late;
    }
    for (int l = 0; l < SUBSTEPS; l++) {
        b->moment = t + l * h;
        advance(p, t + l * h, b->y, &b->modes, 0, h);
        observe(b, t + (l + 1) * h);
    }
    b->sample++;
    read_sensors(b);
    for (int i = 0; i < 2 * p->n; i++)
        if (!isfinite(b->y[i])) return 1;
    return 0;
}

/* what FMI 2.0 asks of a slave; value references: commands, readings, start_speed */
typedef unsigned int Reference;
typedef int Status;
enum { OK = 0, ERROR = 3 };
#define NO(name, arguments) Status name arguments { return ERROR; }
#define YES(name, arguments) Status name arguments { return OK; }

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
void *fmi2Instantiate(const char *n, int t, const char *g, const char *r, const void *f, int v, int l) {
    Bed *b = calloc(1, sizeof(Bed));
    (void)n, (void)t, (void)g, (void)r, (void)f, (void)v, (void)l;
    b->start_speed = 0;
    return b;
}
void fmi2FreeInstance(void *b) { free(b); }
YES(fmi2SetDebugLogging, (void *b, int on, size_t n, const char *const c[]))
YES(fmi2SetupExperiment, (void *b, int d, double tol, double start, int e, double stop))
YES(fmi2EnterInitializationMode, (void *b))
Status fmi2ExitInitializationMode(void *b) { begin(b); return OK; }
YES(fmi2Terminate, (void *b))
Status fmi2Reset(void *b) { memset(b, 0, sizeof(Bed)); return OK; }
Status fmi2SetReal(void *c, const Reference r[], size_t n, const double v[]) {
    Bed *b = c;
    for (size_t i = 0; i < n; i++) {
        if (r[i] < INPUTS) b->command[r[i]] = v[i];
        else if (r[i] == INPUTS + SENSORS) b->start_speed = v[i];
        else return ERROR;
    }
    return OK;
}
Status fmi2GetReal(void *c, const Reference r[], size_t n, double v[]) {
    const Bed *b = c;
    for (size_t i = 0; i < n; i++)
        v[i] = r[i] < INPUTS ? b->command[r[i]] : r[i] < INPUTS + SENSORS ? b->reading[r[i] - INPUTS] : b->start_speed;
    return OK;
}
Status fmi2DoStep(void *c, double now, double span, int keep) {
    Bed *b = c;
    (void)keep, (void)now;
    for (long n = lround(span / DT); n > 0; n--)
        if (sample(b)) return ERROR;
    return OK;
}
NO(fmi2GetInteger, (void *b, const Reference r[], size_t n, int v[]))
NO(fmi2GetBoolean, (void *b, const Reference r[], size_t n, int v[]))
NO(fmi2GetString, (void *b, const Reference r[], size_t n, const char *v[]))
NO(fmi2SetInteger, (void *b, const Reference r[], size_t n, const int v[]))
NO(fmi2SetBoolean, (void *b, const Reference r[], size_t n, const int v[]))
NO(fmi2SetString, (void *b, const Reference r[], size_t n, const char *const v[]))
NO(fmi2GetFMUstate, (void *b, void **s))
NO(fmi2SetFMUstate, (void *b, void *s))
NO(fmi2FreeFMUstate, (void *b, void **s))
NO(fmi2SerializedFMUstateSize, (void *b, void *s, size_t *n))
NO(fmi2SerializeFMUstate, (void *b, void *s, char *d, size_t n))
NO(fmi2DeSerializeFMUstate, (void *b, const char *d, size_t n, void **s))
NO(fmi2GetDirectionalDerivative, (void *b, const Reference u[], size_t n, const Reference k[], size_t m, const double d[], double e[]))
NO(fmi2SetRealInputDerivatives, (void *b, const Reference r[], size_t n, const int o[], const double v[]))
NO(fmi2GetRealOutputDerivatives, (void *b, const Reference r[], size_t n, const int o[], double v[]))
YES(fmi2CancelStep, (void *b))
NO(fmi2GetStatus, (void *b, int k, int *v))
NO(fmi2GetRealStatus, (void *b, int k, double *v))
NO(fmi2GetIntegerStatus, (void *b, int k, int *v))
NO(fmi2GetBooleanStatus, (void *b, int k, int *v))
NO(fmi2GetStringStatus, (void *b, int k, const char **v))
