/* Rows of beds in time: each a nonlinear bed, its sensors, and an exported controller, stepped from sample to sample.
 *
 * The bed's functions are CasADi's C of the equations, the controller is the step of the exported C sources: both are
 * called through pointers, so this file is compiled once. A row is stepped through a whole span of samples before the
 * next one. Arrays of the caller have strides in elements, so that what all rows share is stored once. */
#include <math.h>
#include <string.h>

typedef int (*function)(const double **, double **, long long *, double *, int);
typedef void (*showing)(const void *, double *);
typedef void (*controller)(void *, const double *, int, unsigned, int, double *, int *);

typedef struct {
    const double *at;
    long long sample, place, row; /* strides */
} shared;

typedef struct {
    function sample, reading;
    controller step; /* 0: no command acts */
    showing shown;   /* what the emulated vehicle does; 0: there is none */
    long long rows, physical, read, drives, dynamometers, pieces, longest, parameters;
    long long sensors, kept, law_sensors, known, every, controller_bytes, emulated_size;
    double span, largest; /* s of a sample; a state beyond it has left all bounds */
    double *state;        /* (b, physical + dynamometers * longest) */
    const double *parameter, *arriving; /* (b, parameters), (b, k, pieces, longest) */
    shared drive, known_torque, hold, added;
    const int *mode, *trigger; /* (t) */
    const double *middle;      /* (pieces): where in a sample a fine step has its middle */
    const long long *sensor;   /* (sensors): which of the model's readings */
    const long long *lagged;   /* (sensors): which state a sensor's lag is, -1 without one */
    const long long *keep;     /* (kept) */
    const long long *law;      /* (law_sensors): which of the sensors the controller reads */
    const double *trim;        /* (b, dynamometers): commands from which the bed counts */
    const double *gain, *zero, *drift, *count; /* (b, sensors) */
    const long long *out_from, *out_until;     /* (b, sensors): samples in which a sensor reads 0 */
    double *angle, *last, *rest;               /* (b, sensors) of encoders */
    const double *noise;                       /* (t, b, sensors) of this span; 0: none */
    long long drift_from, drift_samples, noise_from;
    unsigned char *controllers;
    int *state_of;       /* (b, 2): mode and fault of the controller */
    int *fault;          /* (b): the first fault in emulation */
    long long *fault_at; /* (b): its sample, -1 */
    long long *lost_at;  /* (b): sample at which a row left all bounds, -1 */
    double *readings, *commands, *states; /* (t', b, kept), (t', b, dynamometers), (t', b, physical) or 0 */
    double *emulated;                     /* (t', b, emulated_size), as it is when a sample of emulation begins */
    double *work;                         /* of the functions, then buffers */
    long long *integers;
    long long work_size;
} rows;

#define EMULATION 2
enum { ARGUMENTS = 64 };

static double whole(double x, double count)
{
    const double r = fmod(x, count);
    return (r < 0.0) ? (r + count) : r;
}

static void sense(const rows *r, long long b, long long n, long long first, const double *exact, double *read)
{
    for (long long i = 0; i < r->sensors; i++) {
        const long long at = b * r->sensors + i;
        const double true_value = r->gain[at] * exact[i];
        double value = true_value;
        if (n == 0) {
            r->last[at] = true_value; /* it turned as fast before */
        }
        if (r->count[at] > 0.0) {
            r->angle[at] = r->angle[at] + r->span * (r->last[at] + true_value) / 2;
            r->last[at] = true_value;
            const double rest = whole(r->angle[at], r->count[at]);
            if (n >= r->noise_from) {
                value += (r->rest[at] - rest) / r->span;
            }
            r->rest[at] = rest;
        }
        if (r->noise && n >= r->noise_from) {
            value += r->noise[((n - first) * r->rows + b) * r->sensors + i];
        }
        value += r->zero[at];
        if (n > r->drift_from) {
            const double share = (double)(n - r->drift_from) / (double)((r->drift_samples > 1) ? r->drift_samples : 1);
            value += r->drift[at] * ((share < 1.0) ? share : 1.0);
        }
        if (n >= r->out_from[at] && n < r->out_until[at]) {
            value = 0.0;
        }
        read[i] = value;
    }
}

/* samples first to end of every row; begin: the first of all; total: the last sample has no torques after it */
int run_rows(const rows *r, long long first, long long end, long long total)
{
    const long long k = r->dynamometers, d = r->drives, width = r->physical + k * r->longest;
    const long long in_size = r->law_sensors + r->known + 2 * k;
    double *buffer = r->work + r->work_size;
    double *torque = buffer, *exact = torque + d, *at_sensor = exact + r->read, *read = at_sensor + r->sensors;
    double *in = read + r->sensors, *command = in + in_size, *acting = command + k;
    double *next = acting + (k + d) * r->pieces;
    for (long long b = 0; b < r->rows; b++) {
        double *x = r->state + b * width;
        const double *p = r->parameter + b * r->parameters;
        for (long long n = first; n < end && r->lost_at[b] < 0; n++) {
            const long long after = (n + 1 < total) ? n + 1 : n;
            for (long long i = 0; i < d; i++) {
                torque[i] = r->drive.at[n * r->drive.sample + i * r->drive.place + b * r->drive.row];
            }
            const double *of_reading[ARGUMENTS] = {x, torque, p};
            double *to_reading[ARGUMENTS] = {exact};
            r->reading(of_reading, to_reading, r->integers, r->work, 0);
            const int kept_now = n % r->every == 0;
            const long long slot = n / r->every;
            if (kept_now) {
                for (long long i = 0; i < r->kept; i++) {
                    r->readings[(slot * r->rows + b) * r->kept + i] = exact[r->keep[i]];
                }
                if (r->states) {
                    memcpy(r->states + (slot * r->rows + b) * r->physical, x, (size_t)r->physical * sizeof(double));
                }
            }
            for (long long j = 0; j < k; j++) {
                command[j] = r->trim[b * k + j];
            }
            if (r->step) {
                for (long long i = 0; i < r->sensors; i++) {
                    at_sensor[i] = (r->lagged[i] < 0) ? exact[r->sensor[i]] : x[r->lagged[i]];
                }
                sense(r, b, n, first, at_sensor, read);
                for (long long i = 0; i < r->law_sensors; i++) {
                    in[i] = read[r->law[i]];
                }
                for (long long i = 0; i < r->known; i++) {
                    in[r->law_sensors + i] =
                        r->known_torque.at[n * r->known_torque.sample + i * r->known_torque.place + b * r->known_torque.row];
                }
                for (long long j = 0; j < k; j++) {
                    in[r->law_sensors + r->known + j] = r->hold.at[n * r->hold.sample + j * r->hold.place + b * r->hold.row];
                    in[r->law_sensors + r->known + k + j] =
                        r->added.at[n * r->added.sample + j * r->added.place + b * r->added.row];
                }
                if (kept_now && r->shown && r->state_of[2 * b] == EMULATION) {
                    r->shown(r->controllers + b * r->controller_bytes, r->emulated + (slot * r->rows + b) * r->emulated_size);
                }
                r->step(r->controllers + b * r->controller_bytes, in, r->mode[n], (unsigned)n, r->trigger[n], command,
                        r->state_of + 2 * b);
                if (r->mode[n] == EMULATION && r->fault_at[b] < 0 && r->state_of[2 * b + 1] != 0) {
                    r->fault_at[b] = n;
                    r->fault[b] = r->state_of[2 * b + 1];
                }
            }
            if (kept_now) {
                for (long long j = 0; j < k; j++) {
                    r->commands[(slot * r->rows + b) * k + j] = command[j];
                }
            }
            double *ring = x + r->physical; /* the newest first */
            for (long long i = k * r->longest - 1; i >= k; i--) {
                ring[i] = ring[i - k];
            }
            for (long long j = 0; j < k && r->longest > 0; j++) {
                ring[j] = command[j] - r->trim[b * k + j];
            }
            for (long long m = 0; m < r->pieces; m++) {
                double *now = acting + m * (k + d);
                for (long long j = 0; j < k; j++) {
                    const double *share = r->arriving + ((b * k + j) * r->pieces + m) * r->longest;
                    double sum = 0.0;
                    for (long long i = 0; i < r->longest; i++) {
                        sum += share[i] * ring[i * k + j];
                    }
                    now[j] = sum;
                }
                for (long long i = 0; i < d; i++) {
                    const double later = r->drive.at[after * r->drive.sample + i * r->drive.place + b * r->drive.row];
                    now[k + i] = torque[i] + (later - torque[i]) * r->middle[m];
                }
            }
            const double *of_sample[ARGUMENTS] = {x, acting, p};
            double *to_sample[ARGUMENTS] = {next};
            r->sample(of_sample, to_sample, r->integers, r->work, 0);
            double size = 0.0;
            for (long long i = 0; i < r->physical; i++) {
                const double each = fabs(next[i]);
                size = (each <= r->largest) ? size : INFINITY; /* NaN counts as lost */
                x[i] = next[i];
            }
            if (size > 0.0) {
                r->lost_at[b] = n + 1;
            }
        }
    }
    return 0;
}
