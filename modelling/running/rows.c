/* Rows of beds in time: each a nonlinear bed, its sensors, and an exported controller, stepped from sample to sample.
 *
 * The bed's functions are CasADi's C of the equations, the controller is the step of the exported C sources: both are
 * called through pointers, so this file is compiled once. A row is stepped through a whole span of samples before the
 * next one. Arrays of the caller have strides in elements, so that what all rows share is stored once.
 *
 * A vehicle of others, an FMU of FMI 2.0, stands beside the controller of each row, or behind the specimen of each row
 * (modelling/running/vehicles.py). Its functions are called through pointers, too, so all of this runs in its process. */
#include <math.h>
#include <stddef.h>
#include <string.h>

typedef int (*function)(const double **, double **, long long *, double *, int);
typedef void (*showing)(const void *, double *);
typedef void (*controller)(void *, const double *, int, unsigned, int, double *, int *);

typedef struct {
    const double *at;
    long long sample, place, row; /* strides */
} shared;

typedef int (*setting)(void *, const unsigned *, size_t, const double *);
typedef int (*going_on)(void *, double, double, int);
typedef int (*getting)(void *, const unsigned *, size_t, double *);

typedef struct {
    setting set;
    going_on go_on;
    getting get;
    void *const *instance;          /* (b) */
    const unsigned *input, *output; /* (k + own), (k): references of the FMU */
    long long rows, cuts, own, steps, late, waits, behind; /* behind a specimen: 1, beside a controller: 0 */
    double inertia;                 /* kg*m^2 that a specimen's end has as it is turned */
    double *time;                   /* (b): s of the FMU */
    double *given;                  /* (k + own) */
    double *speed, *before, *momentum; /* (b, k): rad/s now and a step before, N*m*s since the last step */
    double *waiting;                /* (b, waits, k): speeds that are not read yet */
    long long *due;                 /* (b, waits): sample in which each is read, -1 of none */
    long long *stepped;             /* (b): samples */
    const long long *own_from;      /* (own): known torque beside a controller, drive behind a specimen */
    const long long *driven, *speed_state, *angle_state, *pushed; /* (k): drives, states; drive, -1 of none */
    const double *driven_trim;      /* (b, k) */
    double *asked;                  /* (b, k): N*m with which the ends are turned */
    long long *progress;            /* (1): samples of all rows, for those who wait */
    long long *wrong;               /* (3): row whose FMU failed, -1 without; 1: its answer, 2: not finite; its cut */
} vehicles;

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
    const vehicles *vehicle; /* 0: none */
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

/* One step of the FMU of a row; 0 where it goes well. */
static int step_vehicle(const vehicles *v, long long b, double span, double *speed)
{
    void *c = v->instance[b];
    int answer = v->set(c, v->input, (size_t)(v->cuts + v->own), v->given);
    if (answer <= 1) {
        answer = v->go_on(c, v->time[b], span, 1);
    }
    if (answer <= 1) {
        answer = v->get(c, v->output, (size_t)v->cuts, speed);
    }
    v->time[b] += span;
    if (answer > 1) {
        v->wrong[0] = b;
        v->wrong[1] = 1;
        return 1;
    }
    for (long long j = 0; j < v->cuts; j++) {
        if (!isfinite(speed[j])) {
            v->wrong[0] = b;
            v->wrong[1] = 2;
            v->wrong[2] = j;
            return 1;
        }
    }
    return 0;
}

/* One step of all FMUs with inputs (b, k + own); speeds (b, k). */
int step_vehicles(const vehicles *v, double span, const double *given, double *speed)
{
    for (long long b = 0; b < v->rows; b++) {
        memcpy(v->given, given + b * (v->cuts + v->own), (size_t)(v->cuts + v->own) * sizeof(double));
        if (step_vehicle(v, b, span, speed + b * v->cuts) && v->wrong[1] == 1) {
            return 1;
        }
        v->progress[0]++;
    }
    return 0;
}

/* Bring all FMUs to speeds `wanted` (b, k) by PI torques at their cuts; `now` and `kept` (b, k) are speeds and integrals.
 * Ends where all have been near for a time, or after the longest time, or where one is not finite (1: an FMU failed). */
int run_in_vehicles(const vehicles *v, double step, const double *wanted, const double *proportional,
                    const double *integral, const double *largest, double within, double settled, double longest,
                    double *now, double *kept)
{
    const long long k = v->cuts;
    double near = 0.0, time = 0.0;
    while (near < settled && time <= longest) {
        double farthest = 0.0;
        for (long long b = 0; b < v->rows; b++) {
            for (long long j = 0; j < k; j++) {
                const double slower = wanted[b * k + j] - now[b * k + j];
                const double torque = proportional[j] * slower + kept[b * k + j];
                const double most = largest[j];
                v->given[j] = (torque > most) ? most : (torque < -most) ? -most : torque;
                if (fabs(torque) <= most) {
                    kept[b * k + j] += integral[j] * step * slower;
                }
            }
            memset(v->given + k, 0, (size_t)v->own * sizeof(double));
            if (step_vehicle(v, b, step, now + b * k)) {
                return v->wrong[1] == 1;
            }
            for (long long j = 0; j < k; j++) {
                const double off = fabs(wanted[b * k + j] - now[b * k + j]);
                farthest = (off > farthest) ? off : farthest;
            }
        }
        time += step;
        near = (farthest < within) ? near + step : 0.0;
        v->progress[0]++;
    }
    return 0;
}

/* Speeds that a controller reads in this sample, into `in`. */
static void read_vehicle(const vehicles *v, long long b, double *in)
{
    const long long k = v->cuts;
    for (long long i = 0; i < v->waits; i++) {
        const long long at = b * v->waits + i;
        if (v->due[at] >= 0 && v->due[at] <= v->stepped[b]) {
            memcpy(v->speed + b * k, v->waiting + at * k, (size_t)k * sizeof(double));
            v->due[at] = -1;
        }
    }
    memcpy(in, v->speed + b * k, (size_t)k * sizeof(double));
}

/* The vehicle beside a controller goes on by a sample under the torques at its cuts and what is known. */
static int beside(const vehicles *v, long long b, double span, const double *cut_torque, const double *known)
{
    if (v->stepped[b] % v->steps == 0) {
        long long at = b * v->waits;
        while (v->due[at] >= 0) {
            at++; /* there is always a free one: as many as steps can be late */
        }
        memcpy(v->given, cut_torque, (size_t)v->cuts * sizeof(double));
        for (long long i = 0; i < v->own; i++) {
            v->given[v->cuts + i] = known[v->own_from[i]];
        }
        if (step_vehicle(v, b, (double)v->steps * span, v->waiting + at * v->cuts)) {
            return 1;
        }
        v->due[at] = v->stepped[b] + 1 + v->late;
    }
    v->stepped[b]++;
    return 0;
}

/* The vehicle behind a specimen after a sample; x is that of the specimen, later its torques at the next sample. */
static int behind(const vehicles *v, long long b, double span, double *x, const double *begun, const double *later)
{
    const long long k = v->cuts;
    const double all = (double)v->steps * span;
    double *now = v->speed + b * k, *before = v->before + b * k, *momentum = v->momentum + b * k;
    for (long long j = 0; j < k; j++) {
        momentum[j] += v->inertia * (x[v->speed_state[j]] - begun[j]) - v->asked[b * k + j] * span;
    }
    v->stepped[b]++;
    if (v->stepped[b] % v->steps) {
        return 0;
    }
    for (long long j = 0; j < k; j++) {
        v->given[j] = momentum[j] / all + ((v->pushed[j] < 0) ? 0.0 : later[v->pushed[j]]);
        momentum[j] = 0.0;
    }
    for (long long i = 0; i < v->own; i++) {
        v->given[k + i] = later[v->own_from[i]];
    }
    double *after = v->waiting + b * v->waits * k;
    if (step_vehicle(v, b, all, after)) {
        return 1;
    }
    for (long long j = 0; j < k; j++) {
        const double expected = now[j] + (now[j] - before[j]);
        x[v->angle_state[j]] += all / 2 * (after[j] - expected);
        x[v->speed_state[j]] = after[j];
        before[j] = now[j];
        now[j] = after[j];
    }
    return 0;
}

/* samples first to end of every row; begin: the first of all; total: the last sample has no torques after it */
int run_rows(const rows *r, long long first, long long end, long long total)
{
    const long long k = r->dynamometers, d = r->drives, width = r->physical + k * r->longest;
    const vehicles *v = r->vehicle;
    const long long cuts = v ? v->cuts : 0, others = v && v->behind ? v->own + cuts : 0;
    const long long in_size = r->law_sensors + r->known + 2 * k + cuts;
    double *buffer = r->work + r->work_size;
    double *torque = buffer, *exact = torque + d, *at_sensor = exact + r->read, *read = at_sensor + r->sensors;
    double *in = read + r->sensors, *command = in + in_size, *acting = command + k + cuts;
    double *next = acting + (k + d) * r->pieces, *begun = next + r->physical, *behind_at = begun + cuts;
    for (long long b = 0; b < r->rows; b++) {
        double *x = r->state + b * width;
        const double *p = r->parameter + b * r->parameters;
        for (long long n = first; n < end && r->lost_at[b] < 0; n++) {
            const long long after = (n + 1 < total) ? n + 1 : n;
            for (long long i = 0; i < d; i++) {
                torque[i] = r->drive.at[n * r->drive.sample + i * r->drive.place + b * r->drive.row];
            }
            for (long long j = 0; v && v->behind && j < cuts; j++) {
                torque[v->driven[j]] = (n > 0) ? v->asked[b * cuts + j] - v->driven_trim[b * cuts + j] : 0.0;
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
                if (v) {
                    read_vehicle(v, b, in + in_size - cuts);
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
                /* while the speeds are held the vehicle waits at them */
                if (v && r->mode[n] == EMULATION && beside(v, b, r->span, command + k, in + r->law_sensors)) {
                    return 1;
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
            for (long long j = 0; v && v->behind && j < cuts; j++) {
                const long long at = b * cuts + j;
                v->asked[at] = v->inertia * (v->speed[at] - v->before[at]) / ((double)v->steps * r->span);
                torque[v->driven[j]] = v->asked[at] - v->driven_trim[at];
                begun[j] = x[v->speed_state[j]];
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
                for (long long j = 0; v && v->behind && j < cuts; j++) {
                    now[k + v->driven[j]] = torque[v->driven[j]];
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
            if (v) {
                for (long long i = 0; i < others; i++) {
                    behind_at[d + i] = r->drive.at[after * r->drive.sample + (d + i) * r->drive.place + b * r->drive.row];
                }
                if (v->behind && r->lost_at[b] < 0 && behind(v, b, r->span, x, begun, behind_at)) {
                    return 1;
                }
                v->progress[0]++;
            }
        }
    }
    return 0;
}
